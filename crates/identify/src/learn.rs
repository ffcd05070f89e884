//! What every method does: learn from some runs, and say what it would have compensated on another.

use nalgebra::DVector;

use crate::bank::{Bank, Candidate, Rows, trace};
use crate::campaign::Campaign;
use isotherm_core::compensation::model::network::Net;

/// A method that has its data.
pub(crate) trait Learner: Sync {
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
    /// The mean of two such sums over the same terms. How far they are apart says how far it may be believed.
    Mean {
        /// Of the mean.
        gains: Vec<(Candidate, f64)>,
        /// Term by term: of the ridge, and of the net.
        halves: Vec<[f64; 2]>,
    },
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
    /// The terms of a sum.
    pub(crate) fn sum(&self) -> Option<&[(Candidate, f64)]> {
        match self {
            Learned::Sum(gains) | Learned::Mean { gains, .. } => Some(gains),
            Learned::Net { .. } => None,
        }
    }

    /// The places of the inputs that it needs, ascending.
    pub(crate) fn inputs(&self) -> Vec<usize> {
        let mut inputs: Vec<usize> = match self {
            Learned::Sum(gains) | Learned::Mean { gains, .. } => {
                gains.iter().map(|(candidate, _)| candidate.input).collect()
            }
            Learned::Net { inputs, .. } => inputs.iter().map(|candidate| candidate.input).collect(),
        };
        inputs.sort_unstable();
        inputs.dedup();
        inputs
    }

    /// Cz over a run, µm, row by row of the bank.
    pub(crate) fn predict(&self, campaign: &Campaign<'_>, bank: &Bank, run: usize) -> Vec<f64> {
        let rises = &bank.runs[run].rises;
        match self {
            Learned::Sum(gains) | Learned::Mean { gains, .. } => {
                // Time constants that are not in the bank are followed once more, over the same rows.
                let is_foreign = |candidate: &Candidate| bank.column(candidate).is_none();
                let foreign: Vec<Candidate> = gains.iter().map(|term| term.0).filter(is_foreign).collect();
                let extra =
                    (!foreign.is_empty()).then(|| trace(campaign, run, &foreign, Rows::WithError).rises);
                let extra = extra.filter(|extra| extra.nrows() == rises.nrows());
                let mut cz = DVector::zeros(rises.nrows());
                for (candidate, gain) in gains {
                    if let Some(column) = bank.column(candidate) {
                        cz.axpy(*gain, &rises.column(column), 1.0);
                    } else if let (Some(extra), Some(column)) =
                        (&extra, foreign.iter().position(|other| other == candidate))
                    {
                        cz.axpy(*gain, &extra.column(column), 1.0);
                    }
                }
                cz.data.into()
            }
            Learned::Net { inputs, net, .. } => {
                let columns: Vec<usize> = inputs.iter().filter_map(|input| bank.column(input)).collect();
                let row =
                    |row: usize| columns.iter().map(|column| rises[(row, *column)]).collect::<Vec<f64>>();
                (0..rises.nrows()).map(|place| net.output(&row(place))).collect()
            }
        }
    }
}
