//! Effect of a frozen sensor, and the time until it is detected.

use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use serde::Serialize;

use super::Others;
use crate::setup::Ready;
use crate::statistics::range;
use crate::validate::HeldOut;

/// Result for a sensor that froze in a held-out run.
#[derive(Clone, Debug, Serialize)]
pub struct Frozen {
    /// Name of the signal.
    pub signal: String,
    /// Name of the run.
    pub run: String,
    /// Time of the freeze, s since the first row of the run.
    pub at: f64,
    /// Time from the freeze to its detection, s; `None` if it was not detected.
    pub noticed_after: Option<f64>,
    /// Ranges of the residual error with and without the frozen sensor, µm; both held out.
    pub range: (f64, f64),
    /// Range if the freeze had not been detected, µm.
    pub range_unnoticed: f64,
    /// Whether the test reported the sensor in this run while it was good.
    pub false_alarm: bool,
}

/// Freezes each sensor of the model once in each run, at a random time. Model, predictions and thresholds come from the
/// other runs only.
pub fn frozen(ready: &Ready<'_>, held_out: &[HeldOut], seed: u64) -> Vec<Frozen> {
    let campaign = &ready.campaign;
    let others = Others::new(campaign, &campaign.sensors());
    let mut chance = rand_pcg::Pcg64::seed_from_u64(seed);
    let mut inputs = held_out.first().map(|held| held.learned.inputs()).unwrap_or_default();
    inputs.retain(|input| others.sensors.contains(input));
    let pairs = (0..held_out.len()).flat_map(|run| inputs.iter().map(move |sensor| (run, *sensor)));
    let pairs: Vec<(usize, usize, f64)> =
        pairs.map(|(run, sensor)| (run, sensor, chance.random_range(0.05..0.9))).collect();
    let one = |(run, sensor, when): &(usize, usize, f64)| {
        let (run, sensor) = (*run, *sensor);
        let held = &held_out[run];
        let training: Vec<usize> = (0..held_out.len()).filter(|other| *other != run).collect();
        let gains = others.learn(sensor, &training);
        let threshold = others.threshold(sensor, &training);
        let predicted = others.predicted(&gains, run);
        let seconds = &others.bank.runs[run].seconds;
        let rise = others.rise(sensor, run);
        let at =
            seconds.partition_point(|second| *second < when * seconds.last().copied().unwrap_or_default());
        let at = at.min(seconds.len().saturating_sub(1));
        let apart = |row: usize| {
            if seconds[row] - seconds[at] < super::LATELY {
                0.0
            } else {
                (predicted[row] - predicted[at]).abs()
            }
        };
        let noticed = (at..seconds.len()).find(|row| apart(*row) > threshold);
        let from = |instead: &dyn Fn(usize) -> f64| -> Vec<f64> {
            (0..seconds.len()).map(|row| if row < at { 0.0 } else { instead(row) - rise[row] }).collect()
        };
        let learned = held.learned.sum().unwrap_or_default();
        let stuck = others.changes(sensor, learned, run, &from(&|_| rise[at]));
        let virtually = from(&|row| predicted[row] + rise[at] - predicted[at]);
        let virtually = others.changes(sensor, learned, run, &virtually);
        let seen = |row: usize| {
            if noticed.is_some_and(|noticed| row >= noticed) { virtually[row] } else { stuck[row] }
        };
        let seen: Vec<f64> = (0..seconds.len()).map(seen).collect();
        Frozen {
            signal: campaign.inputs[sensor].name.clone(),
            run: held.score.name.clone(),
            at: seconds[at],
            noticed_after: noticed.map(|row| seconds[row] - seconds[at]),
            range: (others.score(held, run, &seen).range_um, range(held.residual(None))),
            range_unnoticed: others.score(held, run, &stuck).range_um,
            false_alarm: others.apart(sensor, &gains, run).into_iter().any(|apart| apart > threshold),
        }
    };
    pairs.par_iter().map(one).collect()
}
