//! `ridge-lag`: every sensor through every lag, all gains held small by a penalty that run-wise validation chooses.
//!
//! Best inside the envelope; a sparse model is safer outside it.

use super::Gains;
use crate::folds::inner;
use crate::gram::Gram;
use crate::solve::ridge;
use crate::statistics::least_sum;

/// Where one run gives no validation: mild.
const UNVALIDATED: f64 = 0.1;

pub(super) fn fit(grams: &[Gram], runs: &[usize], columns: &[usize]) -> Gains {
    // Half decades from 1e-4 to 1e2.
    let penalties: Vec<f64> = (0..=12).map(|half| 10f64.powf(f64::from(half) / 2.0 - 4.0)).collect();
    let costs = inner(grams, runs).into_iter().map(|fold| {
        let held = fold.held.of_columns(columns);
        penalties.iter().map(|penalty| held.left(&ridge(&fold.training, columns, *penalty))).collect()
    });
    let penalty = least_sum(costs).map_or(UNVALIDATED, |(place, _)| penalties[place]);
    let gains = ridge(&Gram::sum(grams, runs), columns, penalty);
    columns.iter().copied().zip(gains.iter().copied()).collect()
}
