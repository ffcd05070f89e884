//! Common part of the network methods `rbf` and `network` (after Ren et al., Chen and Wang).
//!
//! The two methods use each input directly and through a few lags, as the gateway calculates them. If all
//! rises (values minus references) are zero, the output of the network is zero, as with the linear methods.
//! The smoothness of a network depends on its penalty and width, or on the number of training rounds. These
//! settings are chosen on runs that are held out of the training runs, never on the run of the final
//! validation. The criterion is the residual minus its mean in the run, because the range of the error in a
//! run is the most important result.
//!
//! If rows are averaged, the training uses means of rises. A gateway with a shorter period applies the network to each
//! single rise. The results of a non-linear network then differ a little, by much less than the noise of a probe.

use std::time::Duration;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde_json::json;

use super::Settings;
use crate::bank::{Bank, Candidate};
use crate::campaign::Campaign;
use crate::folds::folds;
use crate::learn::{Learned, Learner};
use crate::statistics::{count, least_sum, rms};
use isotherm_core::compensation::model::network::WIDEST;
use isotherm_profile::network;

mod neurons;
mod radial;
#[cfg(test)]
mod tests;

/// Default time constants of the lags, min. Each input is also used without a lag.
const LAGS_MIN: [u64; 2] = [12, 50];
/// Time between the log rows that are used for training, s. Neighbouring rows are similar, so most rows are skipped.
/// The validation uses all rows.
const APART: f64 = 600.0;

/// Type of the network, with its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// Number of radial basis functions.
    Radial(usize),
    /// Number of neurons in one layer, trained by back-propagation. The model is the mean of several such networks.
    Neurons(usize),
}

/// Network method (`rbf` or `network`), together with the data from which it learns.
pub(super) struct Trained {
    bank: Bank,
    /// Indices of the candidate terms that the network may use.
    columns: Vec<usize>,
    /// Names of the inputs, for the model file.
    names: Vec<String>,
    every: usize,
    shape: Shape,
    seed: u64,
}

/// Rows of one or more runs for the training: scaled rises of the temperatures, and the scaled Cz (compensation value)
/// that would leave no error.
#[derive(Clone, Debug)]
struct Samples {
    rises: DMatrix<f64>,
    target: DVector<f64>,
}

impl Samples {
    fn stacked(parts: &[&Samples]) -> Samples {
        let rows: Vec<_> = parts.iter().flat_map(|part| part.rises.row_iter()).collect();
        let width = parts.first().map_or(0, |part| part.rises.ncols());
        let target: Vec<f64> = parts.iter().flat_map(|part| part.target.iter().copied()).collect();
        Samples {
            rises: DMatrix::from_fn(rows.len(), width, |row, column| rows[row][column]),
            target: DVector::from_vec(target),
        }
    }
}

/// Fold of the inner validation: the rows of the training runs, and the rows of each held-out run.
#[derive(Debug)]
struct Fold<'a> {
    /// Index of the fold, from zero.
    number: u64,
    training: Samples,
    held: Vec<&'a Samples>,
}

impl Fold<'_> {
    /// Returns the squared residual of the network `output`, summed over the held-out runs. The mean residual of each
    /// run is subtracted first.
    fn left(&self, output: impl Fn(&DMatrix<f64>) -> DVector<f64>) -> f64 {
        self.held.iter().map(|run| about_mean(&(output(&run.rises) - &run.target))).sum()
    }
}

fn about_mean(left: &DVector<f64>) -> f64 {
    left.norm_squared() - left.mean().powi(2) * count(left.len())
}

/// Returns the index of the choice with the smallest sum of costs over all folds; `None` if there are no
/// folds. `costs` calculates the cost of each choice in a fold.
fn least(folds: &[Fold<'_>], costs: impl Fn(&Fold<'_>) -> Vec<f64> + Sync + Send) -> Option<usize> {
    let costs: Vec<Vec<f64>> = folds.par_iter().map(costs).collect();
    least_sum(costs).map(|(place, _)| place)
}

impl Trained {
    pub(super) fn new(campaign: &Campaign<'_>, settings: &Settings, shape: Shape) -> Result<Trained, String> {
        if let Some(speed) = campaign.inputs.iter().find(|input| input.is_speed()) {
            return Err(format!(
                "{} accepts only temperatures, as rises since the start, and {} is a speed: leave the speed \
                 out of --inputs",
                settings.method, speed.name
            ));
        }
        let lags = match settings.lags.as_slice() {
            [] => LAGS_MIN.iter().map(|minutes| Some(Duration::from_secs(minutes * 60))).collect(),
            named => named.to_vec(),
        };
        let takes_plain = settings.lags.is_empty() || lags.contains(&None);
        let lagged = lags.into_iter().filter(Option::is_some);
        // The rises without lag are always in the bank, because the envelope is calculated from them.
        let lags: Vec<Option<Duration>> = [None].into_iter().chain(lagged).collect();
        let bank = Bank::of(campaign, &lags);
        let may = |(_, candidate): &(usize, &Candidate)| takes_plain || candidate.lag.is_some();
        let columns: Vec<usize> =
            bank.candidates.iter().enumerate().filter(may).map(|(place, _)| place).collect();
        if columns.len() > WIDEST {
            return Err(format!(
                "{} inputs, each with {} lags, give {} input numbers, but a network accepts at most {WIDEST}. \
                 Name fewer sensors with --inputs, or fewer lags with --lags",
                campaign.inputs.len(),
                lags.len(),
                columns.len()
            ));
        }
        let (nodes, most, option) = match shape {
            Shape::Radial(centres) => (centres, WIDEST, "--centres"),
            Shape::Neurons(neurons) => (neurons, WIDEST / neurons::MEMBERS, "--neurons"),
        };
        if nodes == 0 || nodes > most {
            return Err(format!("{option} {nodes}: the number must be between 1 and {most}"));
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 600 rows")]
        let every = (APART / campaign.row_seconds()).round().clamp(1.0, APART) as usize;
        let names = campaign.inputs.iter().map(|input| input.name.clone()).collect();
        Ok(Trained { bank, columns, names, every, shape, seed: settings.seed })
    }

    fn samples(&self, run: usize, columns: &[usize]) -> Samples {
        let traced = &self.bank.runs[run];
        let rows: Vec<usize> = (0..traced.target.len()).step_by(self.every).collect();
        Samples {
            rises: traced.rises.select_columns(columns).select_rows(&rows),
            target: traced.target.select_rows(&rows),
        }
    }
}

impl Learner for Trained {
    fn bank(&self) -> &Bank {
        &self.bank
    }

    fn learn(&self, runs: &[usize], without: &[usize]) -> Result<Learned, String> {
        let may = |column: &&usize| !without.contains(&self.bank.candidates[**column].input);
        let columns: Vec<usize> = self.columns.iter().filter(may).copied().collect();
        let mut each: Vec<Samples> = runs.iter().map(|run| self.samples(*run, &columns)).collect();
        let all = Samples::stacked(&each.iter().collect::<Vec<_>>());
        let scales: Vec<f64> = all.rises.column_iter().map(|column| scale(column.as_slice())).collect();
        let output = scale(all.target.as_slice());
        for samples in &mut each {
            for (mut column, scale) in samples.rises.column_iter_mut().zip(&scales) {
                column /= *scale;
            }
            samples.target /= output;
        }
        let all = Samples::stacked(&each.iter().collect::<Vec<_>>());
        let places: Vec<usize> = (0..each.len()).collect();
        let fold = |(number, held): (u64, Vec<usize>)| {
            let (out, rest): (Vec<_>, Vec<_>) =
                each.iter().enumerate().partition(|(place, _)| held.contains(place));
            let samples = |part: Vec<(usize, _)>| part.into_iter().map(|(_, own)| own).collect::<Vec<_>>();
            Fold { number, training: Samples::stacked(&samples(rest)), held: samples(out) }
        };
        let held = if each.len() < 2 { Vec::new() } else { folds(&places) };
        let folds: Vec<Fold<'_>> = (0..).zip(held).map(fold).collect();
        let mut file = match self.shape {
            Shape::Radial(centres) => radial::file(&radial::fit(&all, &folds, centres, self.seed)),
            Shape::Neurons(neurons) => neurons::file(&neurons::fit(&all, &folds, neurons, self.seed)),
        };
        let inputs: Vec<Candidate> = columns.iter().map(|column| self.bank.candidates[*column]).collect();
        let names: Vec<&String> = inputs.iter().map(|candidate| &self.names[candidate.input]).collect();
        file["format"] = json!("isotherm-network");
        file["version"] = json!(1);
        file["inputs"] = json!({ "names": names, "mean": vec![0.0; columns.len()], "scale": scales });
        file["output"] = json!({ "mean": 0.0, "scale": output });
        // The network is parsed from its file, so that the validated network is the one that runs.
        let (net, _) = network::parse(file.to_string().as_bytes())?;
        Ok(Learned::Net { inputs, net: Box::new(net), file: Box::new(file) })
    }
}

/// Returns the root mean square of the values; 1 if all are zero.
fn scale(values: &[f64]) -> f64 {
    Some(rms(values)).filter(|scale| *scale > 1e-9).unwrap_or(1.0)
}

fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}
