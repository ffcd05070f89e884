//! Virtual sensors (stand-ins): predictions of the reading of a frozen or lost sensor from the other sensors. The rise
//! of a sensor is its reading minus its reference value.
//!
//! The rise of each sensor is predicted from the other sensors through the usual lags, by ridge regression on whitened
//! rows. x̂(t) is the predicted reading at the time t. A sensor is suspected to be frozen if its reading has been
//! constant, while the prediction has moved by more than the threshold θ:
//!
//! ```text
//! D(t) = |x̂(t) − x̂(s)|   s: time of the last change of the reading; D is 0 in the 3 minutes after s
//! θ    = max(0.05 °C, 2 × the largest D of all runs)
//!        With four runs or more, the run with the largest D is ignored
//!        if its D exceeds three times the largest D of the other runs.
//! ```
//!
//! From then on, the value x̂(t) + (constant reading − x̂(s)) replaces the reading. The model uses this value, also for
//! its lags.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Value, json};

use crate::bank::{Bank, Candidate, Rows, Traced};
use crate::campaign::Campaign;
use crate::folds::folds;
use crate::gram::Gram;
use crate::method::whitened::usual_lags;
use crate::solve::{Ridge, decades};
use crate::statistics::least_sum;
use crate::validate::{HeldOut, Means, RunScore};
use crate::whiten;

pub(crate) mod freeze;
mod frozen;

pub use frozen::{Frozen, frozen};

/// Time after a change of the reading within which a sensor is never suspected, s.
const LATELY: f64 = 180.0;
/// Minimum of the threshold θ, °C. A smaller difference is noise.
const LEAST: f64 = 0.05;
/// Factor from the largest D on good runs to the threshold θ. D is the predicted motion while the reading is constant.
const TIMES: f64 = 2.0;
/// Minimum number of runs with which the run with the largest D may be ignored. The sensor may have been faulty in that
/// run.
const ENOUGH_RUNS: usize = 4;
/// Factor by which the largest D must exceed the second largest D, so that its run is ignored.
const FAR: f64 = 3.0;
/// Ridge penalty if there is only one run, because no validation is possible then.
const UNCHOSEN: f64 = 0.3;

/// Stand-in of one sensor: the prediction of its reading from other sensors.
#[derive(Clone, Debug, Serialize)]
pub struct StandIn {
    /// Name of the signal of the sensor.
    pub signal: String,
    /// Threshold θ, °C. If the prediction moves by more than θ while the reading is constant, the sensor is suspected
    /// to be frozen.
    pub threshold: f64,
    /// Whether the gateway may use the stand-in. It must depend on at least two other sensors, and no fallback model
    /// may have a smaller error.
    pub stands_in: bool,
    /// Terms of the prediction. Each item is the name of another sensor, the time constant in s, and the gain in °C per
    /// °C.
    #[serde(skip)]
    pub terms: Vec<(String, f64, f64)>,
    /// Means of the held-out results if the sensor is lost from the start of each run.
    #[serde(flatten)]
    pub means: Means,
}

impl StandIn {
    /// Returns whether the stand-in depends on at least two other sensors. The gateway does not use a stand-in that
    /// depends on one sensor, because a fault of that sensor would fully change the stand-in.
    pub(crate) fn has_others_enough(&self) -> bool {
        let mut names = self.terms.iter().filter(|(_, _, gain)| gain.abs() > 0.0).map(|(name, ..)| name);
        names.next().is_some_and(|first| names.any(|name| name != first))
    }

    /// Returns the entry of the sensor in the file of stand-ins.
    pub(crate) fn file(&self) -> Value {
        let term = |(signal, lag_s, gain): &(String, f64, f64)| json!({ "signal": signal, "lag_s": lag_s, "gain": gain });
        let terms: Vec<Value> = self.terms.iter().map(term).collect();
        json!({ "signal": self.signal, "threshold": self.threshold, "stands_in": self.stands_in, "terms": terms })
    }
}

/// Data for the predictions: rises of the sensors in every log row, including rows without a measured error. Each
/// sensor is predicted from the other sensors.
pub(crate) struct Others<'a> {
    campaign: &'a Campaign<'a>,
    bank: Bank,
    white: Vec<Gram>,
    /// Indices of the sensors among the inputs.
    sensors: Vec<usize>,
}

/// Candidate terms (inputs with a lag) with their gains.
type Gains = Vec<(Candidate, f64)>;

impl<'a> Others<'a> {
    /// Creates the data for the inputs in `among` that are not speeds.
    pub(crate) fn new(campaign: &'a Campaign<'a>, among: &[usize]) -> Others<'a> {
        let mut sensors = campaign.sensors();
        sensors.retain(|sensor| among.contains(sensor));
        let bank = Bank::of_inputs(campaign, &sensors, &usual_lags(), Rows::Every);
        let gram = |run: &Traced| whiten::gram(&run.seconds, &run.rises, &DVector::zeros(run.seconds.len()));
        Others { campaign, white: bank.runs_in_parallel(gram), bank, sensors }
    }

    /// Returns the Gram products (X'X, X'y, y'y) of these candidate terms over these runs. The target y is the rise of
    /// the sensor in the column `own`.
    fn products(&self, own: usize, columns: &[usize], runs: &[usize]) -> Gram {
        let sum = Gram::sum(&self.white, runs);
        Gram {
            square: DMatrix::from_fn(columns.len(), columns.len(), |i, j| {
                sum.square[(columns[i], columns[j])]
            }),
            cross: DVector::from_fn(columns.len(), |i, _| sum.square[(columns[i], own)]),
            power: sum.square[(own, own)],
            rows: sum.rows,
        }
    }

    /// Fits the gains that predict a sensor from the other sensors, on these runs. The penalty is chosen on held-out
    /// runs.
    fn learn(&self, sensor: usize, runs: &[usize]) -> Gains {
        self.learn_with(sensor, runs, self.penalty(sensor, runs))
    }

    /// Returns the column of a sensor without a lag, and all columns of the other sensors. `None` if there is no other
    /// sensor, or no run.
    fn columns(&self, sensor: usize, runs: &[usize]) -> Option<(usize, Vec<usize>)> {
        let candidates = self.bank.candidates.iter().enumerate();
        let others = candidates.filter(|(_, candidate)| candidate.input != sensor);
        let columns: Vec<usize> = others.map(|(column, _)| column).collect();
        let own = self.bank.plain(sensor).filter(|_| !columns.is_empty() && !runs.is_empty())?;
        Some((own, columns))
    }

    /// Returns the ridge penalty for the prediction of a sensor that gives the smallest error on held-out runs.
    fn penalty(&self, sensor: usize, runs: &[usize]) -> f64 {
        let Some((own, columns)) = self.columns(sensor, runs) else { return UNCHOSEN };
        let all = self.products(own, &columns, runs);
        let penalties = decades(-3, 1, 1);
        let costs = folds(runs).into_iter().filter(|held| held.len() < runs.len()).map(|held| {
            let held = self.products(own, &columns, &held);
            let ridge = Ridge::of(&all.less(&held));
            penalties.iter().map(|penalty| held.left(&ridge.at(*penalty))).collect()
        });
        least_sum(costs).map_or(UNCHOSEN, |(place, _)| penalties[place])
    }

    /// Fits the gains that predict a sensor from the other sensors, on these runs and with this ridge penalty.
    fn learn_with(&self, sensor: usize, runs: &[usize], penalty: f64) -> Gains {
        let Some((own, columns)) = self.columns(sensor, runs) else { return Gains::new() };
        let gains = Ridge::of(&self.products(own, &columns, runs)).at(penalty);
        columns.iter().map(|column| self.bank.candidates[*column]).zip(gains.iter().copied()).collect()
    }

    /// Returns the predicted rise of a sensor in every row of a run.
    fn predicted(&self, gains: &Gains, run: usize) -> Vec<f64> {
        let rises = &self.bank.runs[run].rises;
        let mut sum = DVector::zeros(rises.nrows());
        for (candidate, gain) in gains {
            if let Some(column) = self.bank.column(candidate) {
                sum.axpy(*gain, &rises.column(column), 1.0);
            }
        }
        sum.data.into()
    }

    /// Returns D in each row of a run, °C: the predicted motion of the sensor since its reading last changed.
    fn apart(&self, sensor: usize, gains: &Gains, run: usize) -> Vec<f64> {
        let seconds = &self.bank.runs[run].seconds;
        apart(seconds, &self.predicted(gains, run), &self.changed(sensor, run))
    }

    /// Returns for each row of a run the time of the last change of the sensor's reading, s.
    fn changed(&self, sensor: usize, run: usize) -> Vec<f64> {
        let recorded = &self.campaign.dataset.runs[run];
        let values = &recorded.values[self.campaign.inputs[sensor].column];
        let mut rows = recorded.seconds().zip(values).filter(|(_, value)| value.is_finite()).peekable();
        let (mut last, mut changed) = (f64::NAN, f64::NEG_INFINITY);
        let mut until = |second: f64| {
            while let Some((at, value)) = rows.next_if(|(at, _)| *at <= second) {
                if value.to_bits() != last.to_bits() {
                    (last, changed) = (value, at);
                }
            }
            changed
        };
        self.bank.runs[run].seconds.iter().map(|second| until(*second)).collect()
    }

    /// Returns D (the predicted motion since the reading last changed, °C) in each row of these runs. The gains of the
    /// prediction for a run are fitted on the other runs.
    fn held_out(&self, sensor: usize, runs: &[usize]) -> Vec<(usize, Vec<f64>)> {
        let mut each = Vec::new();
        for held in folds(runs) {
            let others: Vec<usize> = runs.iter().copied().filter(|run| !held.contains(run)).collect();
            let gains = self.learn(sensor, if others.is_empty() { runs } else { &others });
            each.extend(held.into_iter().map(|run| (run, self.apart(sensor, &gains, run))));
        }
        each
    }

    fn threshold(&self, sensor: usize, runs: &[usize]) -> f64 {
        threshold(&self.held_out(sensor, runs))
    }

    /// Returns the change of Cz (the compensation value) in each row of a run, µm, if `other` is added to the rise of a
    /// sensor.
    fn changes(&self, sensor: usize, learned: &[(Candidate, f64)], run: usize, other: &[f64]) -> Vec<f64> {
        let seconds = &self.bank.runs[run].seconds;
        let mut cz = vec![0.0; seconds.len()];
        for (candidate, gain) in learned.iter().filter(|(candidate, _)| candidate.input == sensor) {
            let lag = candidate.lag.map_or(0.0, |lag| lag.as_secs_f64());
            let late = lagged(seconds, other, lag);
            cz.iter_mut().zip(late).for_each(|(cz, late)| *cz += gain * late);
        }
        cz
    }

    /// Scores a held-out run after the change `cz` is added to its residual error. `cz` has a value for each log row.
    /// The held-out run contains only the rows in which the error and all inputs have values.
    fn score(&self, held: &HeldOut, run: usize, cz: &[f64]) -> RunScore {
        let change =
            |window: &u128| self.bank.runs[run].windows.binary_search(window).map_or(0.0, |row| cz[row]);
        let rows = held.residual(None).into_iter().zip(&held.windows);
        let left: Vec<f64> = rows.map(|(left, window)| left + change(window)).collect();
        RunScore::new(&held.score.name, &held.error, &left)
    }

    fn rise(&self, sensor: usize, run: usize) -> Vec<f64> {
        let rises = &self.bank.runs[run].rises;
        let column = self.bank.plain(sensor).map(|column| rises.column(column));
        column.map(|column| column.iter().copied().collect()).unwrap_or_default()
    }

    /// Returns the means of the held-out results if the sensor is lost from the start of each run, and its stand-in is
    /// used.
    fn lost(&self, sensor: usize, held_out: &[HeldOut]) -> Means {
        let all = 0..held_out.len();
        let score = |(out, held): (usize, &HeldOut)| {
            let others: Vec<usize> = all.clone().filter(|run| *run != out).collect();
            let predicted = self.predicted(&self.learn(sensor, &others), out);
            let other: Vec<f64> =
                predicted.iter().zip(self.rise(sensor, out)).map(|(other, own)| other - own).collect();
            let learned = held.learned.sum().unwrap_or_default();
            self.score(held, out, &self.changes(sensor, learned, out, &other))
        };
        let scores: Vec<RunScore> = held_out.par_iter().enumerate().map(score).collect();
        Means::of(&scores)
    }
}

/// Returns a stand-in for each of these inputs of a model. The stand-ins are predicted from the sensors in `among`.
pub(crate) fn stand_ins(
    campaign: &Campaign<'_>,
    among: &[usize],
    inputs: &[usize],
    held_out: &[HeldOut],
) -> Vec<StandIn> {
    let others = Others::new(campaign, among);
    let all: Vec<usize> = (0..campaign.dataset.runs.len()).collect();
    let one = |sensor: &&usize| {
        let terms = others.learn(**sensor, &all).into_iter().map(|(candidate, gain)| {
            let lag = candidate.lag.map_or(0.0, |lag| lag.as_secs_f64());
            (campaign.inputs[candidate.input].name.clone(), lag, gain)
        });
        StandIn {
            signal: campaign.inputs[**sensor].name.clone(),
            threshold: others.threshold(**sensor, &all),
            stands_in: true,
            terms: terms.collect(),
            means: others.lost(**sensor, held_out),
        }
    };
    let sensors: Vec<&usize> = inputs.iter().filter(|input| others.sensors.contains(input)).collect();
    if others.sensors.len() < 2 { Vec::new() } else { sensors.iter().map(one).collect() }
}

/// Returns the threshold θ, °C, calculated from D (the predicted motion since the reading last changed) of all runs.
fn threshold(each: &[(usize, Vec<f64>)]) -> f64 {
    let mut largest: Vec<f64> =
        each.iter().map(|(_, apart)| apart.iter().copied().fold(0.0, f64::max)).collect();
    largest.sort_by(|one, other| other.total_cmp(one));
    let seen = match largest.as_slice() {
        [first, second, ..] if each.len() >= ENOUGH_RUNS && *first > FAR * second => *second,
        [first, ..] => *first,
        [] => 0.0,
    };
    (TIMES * seen).max(LEAST)
}

/// Returns D in each log row, °C: the motion of `predicted` since the last change of the reading. `changed` contains
/// the time of the last change for each row, s.
fn apart(seconds: &[f64], predicted: &[f64], changed: &[f64]) -> Vec<f64> {
    let then = |changed: f64| seconds.partition_point(|second| *second <= changed).saturating_sub(1);
    let rows = seconds.iter().zip(predicted).zip(changed);
    rows.map(|((second, now), changed)| match second - changed < LATELY {
        true => 0.0,
        false => (now - predicted[then(*changed)]).abs(),
    })
    .collect()
}

/// Returns the values after a first-order lag with this time constant, s. The initial value is zero. Between two rows,
/// the values are assumed to follow a straight line.
fn lagged(seconds: &[f64], values: &[f64], constant: f64) -> Vec<f64> {
    if constant <= 0.0 {
        return values.to_vec();
    }
    let mut follower = 0.0;
    let mut before: Option<(f64, f64)> = None;
    let rows = seconds.iter().zip(values);
    rows.map(|(second, value)| {
        if let Some((then, last)) = before {
            let share = (second - then) / constant;
            if share > 0.0 {
                let gone = -(-share).exp_m1();
                follower += gone * (last - follower) + (1.0 - gone / share) * (value - last);
            }
        }
        before = Some((*second, *value));
        follower
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_threshold_is_twice_the_largest_unless_that_is_a_fault_of_its_own() {
        for (largest, wanted) in [
            (vec![0.3, 0.5, 0.2, 0.4], 1.0),
            (vec![0.3, 0.89, 0.2, 0.3], 1.78),
            (vec![0.3, 0.91, 0.2, 0.3], 0.6),
            (vec![0.2, 0.91, 0.3], 1.82),
            (vec![0.01, 0.0, 0.01, 0.02], 0.05),
            (vec![], 0.05),
        ] {
            let each: Vec<(usize, Vec<f64>)> =
                largest.iter().enumerate().map(|(run, apart)| (run, vec![0.0, *apart])).collect();
            assert!((threshold(&each) - wanted).abs() < 1e-12, "{largest:?}");
        }
    }
}
