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
use crate::folds::{Inner, Scaled};
use crate::gram::Gram;
use crate::solve::{Net, ridge};
use crate::statistics::{count, least_sum};

/// Ridges of the forward search, on columns of root mean square 1. Few runs choose badly among them: a weaker one is
/// taken only where it leaves less than [`CLEARLY`] times as much on runs that were left out.
const HELD: [f64; 2] = [0.3, 0.01];
const CLEARLY: f64 = 0.4;
const MOST_TERMS: usize = 10;
/// L2 of the elastic net, likewise: sensors of one machine are nearly alike.
const SHARED: [f64; 2] = [0.1, 0.003];
/// How far below the first penalty the path goes, in steps of a quarter decade.
const STEPS: usize = 13;
/// Where one run gives no validation: this many steps down, this many terms.
const UNVALIDATED: usize = 5;

/// With at most `terms` of them, where there is a limit.
pub(super) fn fit(grams: &[Gram], runs: &[usize], columns: &[usize], terms: Option<usize>) -> Gains {
    let inner = Inner::of(grams, runs).of_columns(columns).or_itself();
    let folds = inner.scaled();
    let forward = by_forward(&inner.all, &folds, most_terms(runs, terms), &HELD, terms.is_none());
    let gains = match terms {
        Some(_) => forward,
        // One run that was judged by itself chooses nothing here.
        None => (forward + by_net(&inner.all, if runs.len() < 2 { &[] } else { &folds })) * 0.5,
    };
    in_columns(&gains, columns)
}

/// The most terms of a forward search.
pub(super) fn most_terms(runs: &[usize], asked: Option<usize>) -> usize {
    let most = asked.unwrap_or(MOST_TERMS);
    if runs.len() < 2 { most.min(UNVALIDATED) } else { most }
}

/// The gains that are not zero, each with its column.
pub(super) fn in_columns(gains: &DVector<f64>, columns: &[usize]) -> Gains {
    let gains = columns.iter().copied().zip(gains.iter().copied());
    gains.filter(|(_, gain)| gain.abs() > 0.0).collect()
}

/// The forward search with each of these ridges, the first unless a later one leaves clearly less; `is_mean`: the mean of
/// the searches without one of the folds.
pub(super) fn by_forward(
    all: &Gram,
    folds: &[Scaled],
    most: usize,
    ridges: &[f64],
    is_mean: bool,
) -> DVector<f64> {
    let each: Vec<&Scaled> = folds.iter().collect();
    let tried = ridges.iter().map(|penalty| {
        let (chosen, cost) = forward(&each, *penalty, most);
        (cost, (chosen, *penalty))
    });
    let (chosen, penalty) = first_unless_clearly(tried).unwrap_or_default();
    let mut searches = vec![chosen];
    if is_mean && folds.len() > 2 {
        let without = |left_out: usize| {
            let mut few = each.clone();
            few.remove(left_out);
            forward(&few, penalty, most).0
        };
        searches = (0..folds.len()).map(without).collect();
    }
    let mut gains = DVector::zeros(all.cross.len());
    let share = 1.0 / count(searches.len());
    for chosen in searches.iter().filter(|chosen| !chosen.is_empty()) {
        let found = ridge(all, chosen, penalty);
        chosen.iter().zip(found.iter()).for_each(|(column, gain)| gains[*column] += gain * share);
    }
    gains
}

fn by_net(all: &Gram, folds: &[Scaled]) -> DVector<f64> {
    let tried = SHARED.iter().map(|shared| {
        let costs = folds.iter().map(|fold| {
            path(&fold.training, *shared, STEPS).iter().map(|gains| fold.held.left(gains)).collect()
        });
        let (step, cost) = least_sum(costs).unwrap_or((UNVALIDATED, 0.0));
        (cost, (step, *shared))
    });
    let (step, shared) = first_unless_clearly(tried).unwrap_or_default();
    let (scaled, scales) = all.scaled();
    let last = path(&scaled, shared, step + 1).pop();
    last.map_or_else(|| DVector::zeros(0), |gains| gains.component_div(&scales))
}

/// The first of these, unless a later one costs clearly less.
fn first_unless_clearly<T>(tried: impl Iterator<Item = (f64, T)>) -> Option<T> {
    let better = |best: (f64, T), next: (f64, T)| if next.0 < CLEARLY * best.0 { next } else { best };
    tried.reduce(better).map(|(_, best)| best)
}

/// The gains after each of the first steps of the path, in scaled columns.
fn path(scaled: &Gram, shared: f64, steps: usize) -> Vec<DVector<f64>> {
    let mut net = Net::new(scaled, shared);
    let first = net.first_penalty();
    (0..steps).map(|step| net.at(first * 10f64.powf(-0.25 * count(step))).clone()).collect()
}
