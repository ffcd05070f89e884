//! Simulation of frozen sensors on rows of one minute, with the rules by which the gateway detects them. The results
//! are the effect on the residual error, and the time to detection. A predictor is a sensor from which the frozen
//! sensor is predicted. A rise is a reading minus its reference value.

use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use serde::Serialize;

use super::{Gains, Others};
use crate::setup::Ready;
use crate::statistics::{least_and_most, range};
use crate::validate::HeldOut;

/// Number of consecutive rows in which D must exceed the threshold, so that the sensor is suspected to be frozen. D is
/// the motion of the prediction while the reading is constant. A row is one minute.
const MISSED: usize = 3;
/// Tolerance for a predictor and for the value of a stand-in: distance outside their range in the other runs, as a
/// share of this range.
const EDGE: f64 = 0.01;
/// Tolerance for the sensor itself and for a lagged predictor: distance outside their range in the other runs, as a
/// share of this range.
const FAR: f64 = 0.10;
/// Largest step of Cz (the compensation value) that is assumed if the axis is not known, µm.
const USUAL_STEP: f64 = 1.0;

/// Result of the simulated freeze of one sensor in a held-out run.
#[derive(Clone, Debug, Serialize)]
pub struct Frozen {
    /// Name of the signal of the frozen sensor.
    pub signal: String,
    /// Name of the held-out run.
    pub run: String,
    /// Time of the freeze, s since the first row of the run.
    pub at: f64,
    /// Time from the freeze to its detection, s; `None` if it was not detected.
    pub noticed_after: Option<f64>,
    /// Time from the freeze to the use of a stand-in, s; `None` if no stand-in was used.
    pub replaced_after: Option<f64>,
    /// Whether the other sensors and the predicted value stayed within their ranges in the other runs after the freeze.
    pub inside: bool,
    /// Range of the residual error with the freeze, and range without the freeze, µm. The model was identified without
    /// this run.
    pub range: (f64, f64),
    /// Range of the residual error that would result if the freeze were not detected, µm.
    pub range_unnoticed: f64,
    /// Whether the sensor is reported as frozen at any time in this run without a simulated freeze, although
    /// it is good.
    pub false_alarm: bool,
}

/// Sensor that is tested in one run, with its predictions by models from the other runs.
struct WatchedSensor {
    sensor: usize,
    run: usize,
    gains: Gains,
    threshold: f64,
    /// Smallest and largest rise of the sensor in the other runs, °C.
    span: (f64, f64),
    /// Predicted rise of the sensor in each row of one minute.
    predicted: Vec<f64>,
    /// For each row: whether a predictor is outside its range in the other runs, or a lagged predictor is far outside.
    outside: Vec<bool>,
}

/// Simulates a freeze of each sensor of the model in each run, at a random time. Model, predictions, thresholds and
/// ranges are calculated from the other runs only.
pub fn frozen(ready: &Ready<'_>, held_out: &[HeldOut], seed: u64) -> Vec<Frozen> {
    let campaign = &ready.campaign;
    let others = Others::new(campaign, &campaign.sensors());
    let axis = campaign.axes.iter().find(|axis| axis.name == ready.axis);
    let step = axis.map_or(USUAL_STEP, |axis| axis.guard.step.get());
    let mut chance = rand_pcg::Pcg64::seed_from_u64(seed);
    let mut inputs = held_out.first().map(|held| held.learned.inputs()).unwrap_or_default();
    inputs.retain(|input| others.sensors.contains(input));
    let pairs = (0..held_out.len()).flat_map(|run| inputs.iter().map(move |sensor| (run, *sensor)));
    let pairs: Vec<(usize, usize, f64)> =
        pairs.map(|(run, sensor)| (run, sensor, chance.random_range(0.05..0.9))).collect();
    let one = |(run, sensor, when): &(usize, usize, f64)| {
        let training: Vec<usize> = (0..held_out.len()).filter(|other| other != run).collect();
        others.frozen_once(&others.watched(*sensor, &training, *run), &held_out[*run], *when, step)
    };
    pairs.par_iter().map(one).collect()
}

impl Others<'_> {
    fn watched(&self, sensor: usize, training: &[usize], run: usize) -> WatchedSensor {
        let gains = self.learn(sensor, training);
        WatchedSensor {
            sensor,
            run,
            threshold: self.threshold(sensor, training),
            span: self.span(sensor, training),
            predicted: self.predicted(&gains, run),
            outside: self.outside(&gains, training, run),
            gains,
        }
    }

    /// Returns the smallest and the largest rise of a sensor in these runs. If there are no rises, the bounds are
    /// infinite.
    fn span(&self, sensor: usize, runs: &[usize]) -> (f64, f64) {
        let rises = runs.iter().flat_map(|run| self.rise(sensor, *run));
        least_and_most(rises).unwrap_or((f64::NEG_INFINITY, f64::INFINITY))
    }

    /// Returns for each row of a run whether a predictor in `gains` is outside its range in the training runs. A lagged
    /// predictor has a larger tolerance.
    fn outside(&self, gains: &Gains, training: &[usize], run: usize) -> Vec<bool> {
        let mut outside = vec![false; self.bank.runs[run].seconds.len()];
        for (candidate, _) in gains.iter().filter(|(_, gain)| gain.abs() > 0.0) {
            let span = self.span(candidate.input, training);
            let late = self.bank.column(candidate).map(|column| self.bank.runs[run].rises.column(column));
            let late = late.into_iter().flat_map(|column| column.iter().copied().collect::<Vec<f64>>());
            let mut is_beyond = false;
            let rows = self.rise(candidate.input, run).into_iter().zip(late).zip(&mut outside);
            for ((now, late), outside) in rows {
                is_beyond = beyond(span, now) > if is_beyond { 0.0 } else { EDGE };
                *outside |= is_beyond || beyond(span, late) > FAR;
            }
        }
        outside
    }

    /// Simulates one freeze of the sensor, and returns the result. The freeze begins after the share `when` of the run.
    /// `step` is the largest step of Cz on this axis, µm.
    fn frozen_once(&self, watched: &WatchedSensor, held: &HeldOut, when: f64, step: f64) -> Frozen {
        let WatchedSensor { sensor, run, ref predicted, ref outside, .. } = *watched;
        let (seconds, rise) = (&self.bank.runs[run].seconds, self.rise(sensor, run));
        let at =
            seconds.partition_point(|second| *second < when * seconds.last().copied().unwrap_or_default());
        let at = at.min(seconds.len().saturating_sub(1));
        let from = |instead: &dyn Fn(usize) -> f64| -> Vec<f64> {
            (0..seconds.len()).map(|row| if row < at { 0.0 } else { instead(row) - rise[row] }).collect()
        };
        let learned = held.learned.sum().unwrap_or_default();
        let stuck = self.changes(sensor, learned, run, &from(&|_| rise[at]));
        let noticed = watched.noticed(seconds, rise[at], at);
        let values = watched.values(rise[at], at);
        let virtually = self.changes(sensor, learned, run, &from(&|row| values[row]));
        // A stand-in is first used when it moves the target by at most one step. Then it stays.
        let may = |row: &usize| !outside[*row] && (virtually[*row] - stuck[*row]).abs() <= step;
        let mut late = noticed.unwrap_or(seconds.len())..seconds.len();
        let replaced = late.find(may).filter(|_| watched.has_others_enough());
        let seen = |row: usize| match replaced {
            Some(replaced) if row >= replaced => virtually[row],
            _ => stuck[row],
        };
        let seen: Vec<f64> = (0..seconds.len()).map(seen).collect();
        let after = |row: usize| seconds[row] - seconds[at];
        let alarms = self.apart(sensor, &watched.gains, run);
        Frozen {
            signal: self.campaign.inputs[sensor].name.clone(),
            run: held.score.name.clone(),
            at: seconds[at],
            noticed_after: noticed.map(after),
            replaced_after: replaced.map(after),
            inside: (at..seconds.len())
                .all(|row| !outside[row] && beyond(watched.span, predicted[row]) <= EDGE),
            range: (self.score(held, run, &seen).range_um, range(held.residual(None))),
            range_unnoticed: self.score(held, run, &stuck).range_um,
            false_alarm: watched.first_missed(&rise, 0, |row| alarms[row]).is_some(),
        }
    }
}

impl WatchedSensor {
    /// Returns the first row in which the sensor is suspected to be frozen if its rise is constant from the row `at`
    /// on. `None` if it is never suspected.
    fn noticed(&self, seconds: &[f64], reads: f64, at: usize) -> Option<usize> {
        let base = self.base(at)?;
        let apart = |row: usize| match seconds[row] - seconds[at] < super::LATELY {
            true => 0.0,
            false => (self.predicted[row] - self.predicted[base]).abs(),
        };
        self.first_missed(&vec![reads; seconds.len()], at, apart)
    }

    /// Returns the row with which the later predictions are compared: the first row from `at` on that has a prediction.
    /// `None` if there is no such row.
    fn base(&self, at: usize) -> Option<usize> {
        (at..self.outside.len()).find(|row| !self.outside[*row])
    }

    /// Returns the value of the stand-in in each row, if the rise of the sensor is constant from the row `at` on. While
    /// a predictor or the stand-in is outside its range, the previous value is kept.
    fn values(&self, reads: f64, at: usize) -> Vec<f64> {
        let base = self.base(at);
        let mut value = reads;
        let row = |row: usize| {
            let says =
                base.filter(|base| row >= *base).map(|base| self.predicted[row] - self.predicted[base]);
            let says = says.map(|moved| reads + moved).filter(|_| !self.outside[row]);
            value = says.filter(|says| beyond(self.span, *says) <= EDGE).unwrap_or(value);
            value
        };
        (0..self.outside.len()).map(row).collect()
    }

    /// Returns the first row from `from` on in which the sensor is suspected to be frozen; `None` if there is none.
    /// `rises` contains the rise of the sensor in each row. `apart` returns D of a row, °C.
    fn first_missed(&self, rises: &[f64], from: usize, apart: impl Fn(usize) -> f64) -> Option<usize> {
        let mut missed = 0;
        (from..self.outside.len()).find(|row| {
            let is_silent = self.outside[*row] || beyond(self.span, rises[*row]) > FAR;
            missed = if !is_silent && apart(*row) > self.threshold { missed + 1 } else { 0 };
            missed >= MISSED
        })
    }

    fn has_others_enough(&self) -> bool {
        let mut inputs = self.gains.iter().filter(|(_, gain)| gain.abs() > 0.0).map(|(own, _)| own.input);
        inputs.next().is_some_and(|first| inputs.any(|input| input != first))
    }
}

/// Returns how far a rise is outside a range, as a share of this range; negative if the rise is inside.
fn beyond((least, most): (f64, f64), rise: f64) -> f64 {
    if most > least { (least - rise).max(rise - most) / (most - least) } else { f64::NEG_INFINITY }
}
