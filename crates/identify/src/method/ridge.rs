//! `ridge-lag`: every sensor through every lag. A ridge penalty, chosen by validation on held-out runs, keeps all gains
//! small.
//!
//! This method is best inside the envelope, which is the range of the inputs in the logs. Outside the envelope, a model
//! with few terms is safer.

use crate::folds::Inner;
use crate::gram::{Gains, Gram};
use crate::solve::least_squares;
use crate::statistics::least_sum;

/// Ridge penalty if there is only one run, because no validation is possible then. The penalty is small.
const UNVALIDATED: f64 = 0.1;

pub(super) fn fit(grams: &[Gram], runs: &[usize], columns: &[usize]) -> Gains {
    // Two penalties per decade, from 1e-4 to 1e2.
    let penalties: Vec<f64> = (0..=12).map(|half| 10f64.powf(f64::from(half) / 2.0 - 4.0)).collect();
    let inner = Inner::of(grams, runs).of_columns(columns);
    let costs = inner.scaled().into_iter().map(|fold| {
        let left = |penalty: &f64| fold.held.left(&least_squares(&fold.training, *penalty));
        penalties.iter().map(left).collect()
    });
    let penalty = least_sum(costs).map_or(UNVALIDATED, |(place, _)| penalties[place]);
    let (scaled, scales) = inner.all.scaled();
    let gains = least_squares(&scaled, penalty).component_div(&scales);
    columns.iter().copied().zip(gains.iter().copied()).collect()
}
