//! `sparse-lag`: mean of two searches for the best pairs of sensor and lag. The two searches make different errors.
//!
//! - Forward search with a ridge, validated on held-out runs: it repeatedly adds the term that reduces the held-out
//!   residual most, up to ten terms. The result has few sensors, and is safe outside the envelope (the range of inputs
//!   in the logs). However, small differences decide which of two similar sensors it selects. Therefore the search is
//!   repeated with each fold (group of held-out runs) left out, and the results are averaged.
//! - Elastic net: its L1 penalty removes most terms, and its L2 penalty divides a gain among similar sensors.
//!   Validation on held-out runs determines the L1 penalty. The result has more terms, and is more stable inside the
//!   envelope.
//!
//! Both searches give linear models, so their mean is linear, too. With a limit on the number of terms, only the
//! forward search is used.

use nalgebra::DVector;

use super::forward::forward;
use crate::folds::{Inner, Scaled};
use crate::gram::{Gains, Gram};
use crate::solve::{Net, ridge};
use crate::statistics::{count, least_sum};

/// Ridge penalties of the forward search, for columns of root mean square 1. With few runs, a choice between them is
/// unreliable. Therefore the smaller penalty is used only if its residual on held-out runs is less than [`CLEARLY`]
/// times that of the larger penalty.
const HELD: [f64; 2] = [0.3, 0.01];
const CLEARLY: f64 = 0.4;
const MOST_TERMS: usize = 10;
/// L2 penalties of the elastic net, chosen in the same way as [`HELD`]. An L2 penalty is useful because sensors of one
/// machine are similar.
const SHARED: [f64; 2] = [0.1, 0.003];
/// Number of L1 penalties that are tried for the elastic net. Each is a quarter decade below the previous penalty.
const STEPS: usize = 13;
/// Values for a single run, with which no validation is possible: index of the L1 penalty, and maximum number of terms
/// of the forward search.
const UNVALIDATED: usize = 5;

/// Fits a model to the training runs `runs`, with the candidate terms `columns`. `terms` is the maximum number of
/// terms; `None` for no limit.
pub(super) fn fit(grams: &[Gram], runs: &[usize], columns: &[usize], terms: Option<usize>) -> Gains {
    let inner = Inner::of(grams, runs).of_columns(columns).or_itself();
    let folds = inner.scaled();
    let forward = by_forward(&inner.all, &folds, most_terms(runs, terms), &HELD, terms.is_none());
    let gains = match terms {
        Some(_) => forward,
        // A single run, which was validated on itself, cannot choose the position on the path.
        None => (forward + by_net(&inner.all, if runs.len() < 2 { &[] } else { &folds })) * 0.5,
    };
    in_columns(&gains, columns)
}

/// Returns the maximum number of terms of a forward search. `asked` is the limit that the operator requested.
pub(super) fn most_terms(runs: &[usize], asked: Option<usize>) -> usize {
    let most = asked.unwrap_or(MOST_TERMS);
    if runs.len() < 2 { most.min(UNVALIDATED) } else { most }
}

/// Returns the gains that are not zero, each with the index of its candidate term.
pub(super) fn in_columns(gains: &DVector<f64>, columns: &[usize]) -> Gains {
    let gains = columns.iter().copied().zip(gains.iter().copied());
    gains.filter(|(_, gain)| gain.abs() > 0.0).collect()
}

/// Returns the gains of a forward search with the first ridge penalty, or with a later penalty if the residual of that
/// penalty is clearly smaller. If `is_mean`, the result is the mean of several searches, each without one of the folds.
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

/// Returns the first item, or a later item if its cost is less than [`CLEARLY`] times the cost of the best item before
/// it. Each pair is a cost and an item. `None` if there are no items.
fn first_unless_clearly<T>(tried: impl Iterator<Item = (f64, T)>) -> Option<T> {
    let better = |best: (f64, T), next: (f64, T)| if next.0 < CLEARLY * best.0 { next } else { best };
    tried.reduce(better).map(|(_, best)| best)
}

/// Returns the gains of the elastic net for each of the `steps` largest L1 penalties, the largest penalty first. The
/// gains apply to the scaled columns.
fn path(scaled: &Gram, shared: f64, steps: usize) -> Vec<DVector<f64>> {
    let mut net = Net::new(scaled, shared);
    let first = net.first_penalty();
    (0..steps).map(|step| net.at(first * 10f64.powf(-0.25 * count(step))).clone()).collect()
}
