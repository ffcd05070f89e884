//! What every method does: learn from some runs, and say what it would have compensated on another.

use nalgebra::DVector;

use crate::bank::{Bank, Candidate, Traced, trace};
use crate::campaign::Campaign;
use isotherm_core::compensation::model::network::Net;

/// A method that has its data.
pub trait Learner: Sync {
    /// The rows that it learns from and is judged on.
    fn bank(&self) -> &Bank;

    /// Learns from these runs, without these inputs.
    ///
    /// # Errors
    /// A sentence that says what to do.
    fn learn(&self, runs: &[usize], without: &[usize]) -> Result<Learned, String>;
}

/// What was learnt.
#[derive(Clone, Debug)]
pub enum Learned {
    /// A sum of gains times rises: µm per unit, for Cz.
    Sum(Vec<(Candidate, f64)>),
    /// A network over rises.
    Net {
        /// What it takes, in its order: columns of the bank.
        inputs: Vec<Candidate>,
        /// What computes.
        net: Box<Net>,
        /// The same as its file.
        file: Box<serde_json::Value>,
    },
}

impl Learned {
    /// Cz over a run, row by row of the bank.
    pub fn predict(&self, campaign: &Campaign<'_>, bank: &Bank, run: usize) -> Vec<f64> {
        let traced = &bank.runs[run];
        match self {
            Learned::Sum(gains) => sum(campaign, bank, run, gains),
            Learned::Net { inputs, net, .. } => {
                let place = |input| bank.candidates.iter().position(|known| known == input);
                let columns: Vec<usize> = inputs.iter().filter_map(place).collect();
                (0..traced.rises.nrows())
                    .map(|row| {
                        let rises: Vec<f64> =
                            columns.iter().map(|column| traced.rises[(row, *column)]).collect();
                        net.output(&rises)
                    })
                    .collect()
            }
        }
    }
}

/// The bank's column of an input without a lag.
pub(super) fn plain(bank: &Bank, input: usize) -> Option<usize> {
    let is_plain =
        |candidate: &Candidate| candidate.input == input && candidate.lag.is_none() && !candidate.along;
    bank.candidates.iter().position(is_plain)
}

fn sum(campaign: &Campaign<'_>, bank: &Bank, run: usize, gains: &[(Candidate, f64)]) -> Vec<f64> {
    let traced = &bank.runs[run];
    let mut cz = DVector::zeros(traced.rises.nrows());
    // Time constants that are not in the bank are followed once more, over the same rows.
    let foreign: Vec<Candidate> =
        gains.iter().map(|(candidate, _)| *candidate).filter(|own| !bank.candidates.contains(own)).collect();
    let extra: Option<Traced> = (!foreign.is_empty()).then(|| trace(campaign, run, &foreign));
    for (candidate, gain) in gains {
        let own = bank.candidates.iter().position(|known| known == candidate);
        if let Some(column) = own {
            cz.axpy(*gain, &traced.rises.column(column), 1.0);
        } else if let (Some(extra), Some(column)) =
            (&extra, foreign.iter().position(|known| known == candidate))
            && extra.rises.nrows() == cz.len()
        {
            cz.axpy(*gain, &extra.rises.column(column), 1.0);
        }
    }
    cz.iter().copied().collect()
}
