//! Interface of all identification methods. A method identifies a model from some runs, and predicts Cz (the
//! compensation value of an axis) on another run.

use nalgebra::DVector;

use crate::bank::{Bank, Candidate, Rows, trace};
use crate::campaign::Campaign;
use isotherm_core::compensation::model::network::Net;

/// Identification method, together with the data from which it learns: a campaign (the logged runs, as the
/// gateway would read them).
pub(crate) trait Learner: Sync {
    /// Matrix of candidate terms. The method identifies models from its rows, and models are validated on its rows.
    fn bank(&self) -> &Bank;

    /// Identifies a model from the runs `runs`. The inputs in `without` are not used.
    ///
    /// # Errors
    /// No model can be identified from these runs. The message says what to do.
    fn learn(&self, runs: &[usize], without: &[usize]) -> Result<Learned, String>;
}

/// Identified model: a sum of gains times rises, a mean of two such sums, or a network. A rise is the value of an input
/// minus its reference.
#[derive(Clone, Debug)]
pub enum Learned {
    /// Terms of a sum of gains times rises, each with its gain. The gain is in µm of Cz per unit of the input.
    Sum(Vec<(Candidate, f64)>),
    /// Mean of two sums over the same terms. The smaller their difference, the more reliable is the mean.
    Mean {
        /// Terms with their gains in the mean of the two sums.
        gains: Vec<(Candidate, f64)>,
        /// Gains of each term in the two sums: first in the ridge regression, then in the elastic net.
        halves: Vec<[f64; 2]>,
    },
    /// Network whose inputs are rises.
    Net {
        /// Inputs in the order of the network. Each is a candidate term.
        inputs: Vec<Candidate>,
        /// Network that computes Cz from the rises.
        net: Box<Net>,
        /// Content of the model file of the network.
        file: Box<serde_json::Value>,
    },
}

impl Learned {
    /// Returns the terms of a sum or of a mean of two sums; `None` for a network.
    pub(crate) fn sum(&self) -> Option<&[(Candidate, f64)]> {
        match self {
            Learned::Sum(gains) | Learned::Mean { gains, .. } => Some(gains),
            Learned::Net { .. } => None,
        }
    }

    /// Returns the indices of the inputs that the model needs, in ascending order.
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

    /// Returns the Cz of the model in each matrix row of a run, µm. `bank` is the matrix of candidate terms.
    pub(crate) fn predict(&self, campaign: &Campaign<'_>, bank: &Bank, run: usize) -> Vec<f64> {
        let rises = &bank.runs[run].rises;
        match self {
            Learned::Sum(gains) | Learned::Mean { gains, .. } => {
                // Lags with time constants that the bank does not contain are calculated here, over the same rows.
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
