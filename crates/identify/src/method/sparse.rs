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

use super::Rule;
use super::forward::forward;
use crate::folds::inner;
use crate::gram::Gram;
use crate::solve::{elastic_net, first_penalty, ridge};
use crate::statistics::{count, smallest};

pub(super) struct Sparse {
    /// Most terms.
    pub(super) terms: Option<usize>,
}

/// Ridges of the forward search, on columns of root mean square 1. Few runs choose badly among them: a weaker one is
/// taken only where it leaves less than [`CLEARLY`] times as much on runs that were left out.
const HELD: [f64; 2] = [0.3, 0.01];
const CLEARLY: f64 = 0.4;
pub(super) const MOST_TERMS: usize = 10;
/// L2 of the elastic net, likewise: sensors of one machine are nearly alike.
const SHARED: [f64; 2] = [0.1, 0.003];
/// How far below the first penalty the path goes, in steps of a quarter decade.
const STEPS: u32 = 13;
/// Where one run gives no validation: this many steps down, this many terms.
const UNVALIDATED: usize = 5;

impl Rule for Sparse {
    fn fit(&self, grams: &[Gram], runs: &[usize], columns: &[usize]) -> Result<Vec<(usize, f64)>, String> {
        let few: Vec<Gram> = grams.iter().map(|gram| gram.of_columns(columns)).collect();
        let forward = by_forward(&few, runs, self.terms.unwrap_or(MOST_TERMS), &HELD, self.terms.is_none());
        let gains = match self.terms {
            Some(_) => forward,
            None => (forward + by_net(&few, runs)) * 0.5,
        };
        Ok(in_columns(&gains, columns))
    }
}

/// The gains that are not zero, each with its column.
pub(super) fn in_columns(gains: &DVector<f64>, columns: &[usize]) -> Vec<(usize, f64)> {
    let gains = gains.iter().copied().zip(columns.iter().copied());
    gains.filter(|(gain, _)| gain.abs() > 0.0).map(|(gain, column)| (column, gain)).collect()
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
    let sum = Gram::sum(grams, runs);
    let folds = match inner(grams, runs) {
        folds if folds.is_empty() => vec![(sum.clone(), runs.to_vec())],
        folds => folds,
    };
    let folds: Vec<(Gram, Gram)> =
        folds.into_iter().map(|(training, fold)| (training, Gram::sum(grams, &fold))).collect();
    let most = if runs.len() < 2 { most.min(UNVALIDATED) } else { most };
    let tried = ridges.iter().map(|penalty| (forward(&folds, *penalty, most), *penalty));
    let tried = tried.map(|((chosen, cost), penalty)| (cost, (chosen, penalty)));
    let (chosen, penalty) = first_unless_clearly(tried).unwrap_or_default();
    let mut searches = vec![chosen];
    if is_mean && folds.len() > 2 {
        let without = |left_out: usize| {
            let mut few = folds.clone();
            few.remove(left_out);
            forward(&few, penalty, most).0
        };
        searches = (0..folds.len()).map(without).collect();
    }
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
        let mut costs = vec![0.0; usize::try_from(STEPS).unwrap_or(0)];
        for (training, fold) in &inner {
            let held = Gram::sum(grams, fold);
            for (cost, gains) in costs.iter_mut().zip(path(training, *shared, STEPS)) {
                *cost += held.left(&gains);
            }
        }
        let step = if inner.is_empty() { UNVALIDATED } else { smallest(&costs) };
        (costs[step], (step, *shared))
    });
    let (step, shared) = first_unless_clearly(tried).unwrap_or_default();
    let steps = u32::try_from(step + 1).unwrap_or(STEPS);
    path(&Gram::sum(grams, runs), shared, steps).pop().unwrap_or_else(|| DVector::zeros(0))
}

/// The first of these, unless a later one costs clearly less.
fn first_unless_clearly<T>(tried: impl Iterator<Item = (f64, T)>) -> Option<T> {
    let better = |best: (f64, T), next: (f64, T)| if next.0 < CLEARLY * best.0 { next } else { best };
    tried.reduce(better).map(|(_, best)| best)
}

/// The gains at each step of the path, in the columns' own units.
fn path(gram: &Gram, shared: f64, steps: u32) -> Vec<DVector<f64>> {
    let (scaled, scales) = gram.scaled();
    let first = first_penalty(&scaled);
    let mut gains = DVector::zeros(scaled.cross.len());
    let step = |step: u32| {
        let l1 = first * 10f64.powf(-0.25 * f64::from(step));
        elastic_net(&scaled, l1, shared, &mut gains);
        DVector::from_fn(gains.len(), |place, _| gains[place] / scales[place])
    };
    (0..steps).map(step).collect()
}
