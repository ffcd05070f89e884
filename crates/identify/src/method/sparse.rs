//! `sparse-lag`: the mean of two searches over (sensor, lag) that err differently.
//!
//! - Forward by run-wise validation: the term that helps most on runs that were left out comes in next, as long as one
//!   helps, at most ten, with a ridge. Few sensors, and safe outside the envelope; but which of two sensors that
//!   are nearly alike is chosen hangs on little. So the search is made once without each of the folds, and averaged.
//! - An elastic net, as far along its path as run-wise validation says: its L1 part takes most terms out, its L2 part
//!   shares a gain among sensors that move together. Steadier inside the envelope, with more terms.
//!
//! Both are linear, and so is their mean. With a limit on the number of terms it is the first alone.

use nalgebra::DVector;

use super::Gains;
use super::forward::forward;
use crate::folds::{Fold, inner, inner_or_itself};
use crate::gram::Gram;
use crate::solve::{elastic_net, first_penalty, ridge};
use crate::statistics::{count, least_sum};

/// Ridges of the forward search, on columns of root mean square 1. Few runs choose badly among them: a weaker one is
/// taken only where it leaves less than [`CLEARLY`] times as much on runs that were left out.
const HELD: [f64; 2] = [0.3, 0.01];
const CLEARLY: f64 = 0.4;
pub(super) const MOST_TERMS: usize = 10;
/// L2 of the elastic net, likewise: sensors of one machine are nearly alike.
const SHARED: [f64; 2] = [0.1, 0.003];
/// How far below the first penalty the path goes, in steps of a quarter decade.
const STEPS: usize = 13;
/// Where one run gives no validation: this many steps down, this many terms.
const UNVALIDATED: usize = 5;

/// With at most `terms` of them, where there is a limit.
pub(super) fn fit(grams: &[Gram], runs: &[usize], columns: &[usize], terms: Option<usize>) -> Gains {
    let few: Vec<Gram> = grams.iter().map(|gram| gram.of_columns(columns)).collect();
    let forward = by_forward(&few, runs, terms.unwrap_or(MOST_TERMS), &HELD, terms.is_none());
    let gains = match terms {
        Some(_) => forward,
        None => (forward + by_net(&few, runs)) * 0.5,
    };
    in_columns(&gains, columns)
}

/// The gains that are not zero, each with its column.
pub(super) fn in_columns(gains: &DVector<f64>, columns: &[usize]) -> Gains {
    let gains = columns.iter().copied().zip(gains.iter().copied());
    gains.filter(|(_, gain)| gain.abs() > 0.0).collect()
}

/// The forward search with each of these ridges, the first unless a later one leaves clearly less; `is_mean`: the mean of
/// the searches without one of the folds.
pub(super) fn by_forward(
    grams: &[Gram],
    runs: &[usize],
    most: usize,
    ridges: &[f64],
    is_mean: bool,
) -> DVector<f64> {
    let folds = inner_or_itself(grams, runs);
    let most = if runs.len() < 2 { most.min(UNVALIDATED) } else { most };
    let tried = ridges.iter().map(|penalty| {
        let (chosen, cost) = forward(&folds, *penalty, most);
        (cost, (chosen, *penalty))
    });
    let (chosen, penalty) = first_unless_clearly(tried).unwrap_or_default();
    let mut searches = vec![chosen];
    if is_mean && folds.len() > 2 {
        let without = |left_out: usize| {
            let mut few: Vec<Fold> = folds.clone();
            few.remove(left_out);
            forward(&few, penalty, most).0
        };
        searches = (0..folds.len()).map(without).collect();
    }
    let sum = Gram::sum(grams, runs);
    let mut gains = DVector::zeros(sum.cross.len());
    let share = 1.0 / count(searches.len());
    for chosen in searches.iter().filter(|chosen| !chosen.is_empty()) {
        let found = ridge(&sum, chosen, penalty);
        chosen.iter().zip(found.iter()).for_each(|(column, gain)| gains[*column] += gain * share);
    }
    gains
}

fn by_net(grams: &[Gram], runs: &[usize]) -> DVector<f64> {
    let inner = inner(grams, runs);
    let tried = SHARED.iter().map(|shared| {
        let costs = inner.iter().map(|fold| {
            path(&fold.training, *shared, STEPS).iter().map(|gains| fold.held.left(gains)).collect()
        });
        let (step, cost) = least_sum(costs).unwrap_or((UNVALIDATED, 0.0));
        (cost, (step, *shared))
    });
    let (step, shared) = first_unless_clearly(tried).unwrap_or_default();
    path(&Gram::sum(grams, runs), shared, step + 1).pop().unwrap_or_else(|| DVector::zeros(0))
}

/// The first of these, unless a later one costs clearly less.
fn first_unless_clearly<T>(tried: impl Iterator<Item = (f64, T)>) -> Option<T> {
    let better = |best: (f64, T), next: (f64, T)| if next.0 < CLEARLY * best.0 { next } else { best };
    tried.reduce(better).map(|(_, best)| best)
}

/// The gains after each of the first steps of the path, in the columns' own units.
fn path(gram: &Gram, shared: f64, steps: usize) -> Vec<DVector<f64>> {
    let (scaled, scales) = gram.scaled();
    let first = first_penalty(&scaled);
    let mut gains = DVector::zeros(scaled.cross.len());
    let step = |step: usize| {
        let l1 = first * 10f64.powf(-0.25 * count(step));
        elastic_net(&scaled, l1, shared, &mut gains);
        gains.component_div(&scales)
    };
    (0..steps).map(step).collect()
}
