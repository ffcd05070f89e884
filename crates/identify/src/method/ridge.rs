//! `ridge-lag`: every sensor through every lag, all gains held small by a penalty that run-wise validation chooses.
//!
//! Best inside the envelope; a sparse model is safer outside it.

use super::Rule;
use crate::folds::inner;
use crate::gram::Gram;
use crate::solve;
use crate::statistics::smallest;

pub(super) struct Ridge;

/// Half decades from 1e-4 to 1e2.
fn penalties() -> Vec<f64> {
    (0..=12).map(|half| 10f64.powf(f64::from(half) / 2.0 - 4.0)).collect()
}

/// Where one run gives no validation: mild.
const UNVALIDATED: f64 = 0.1;

impl Rule for Ridge {
    fn fit(&self, grams: &[Gram], runs: &[usize], columns: &[usize]) -> Result<Vec<(usize, f64)>, String> {
        let penalties = penalties();
        let mut costs = vec![0.0; penalties.len()];
        let inner = inner(grams, runs);
        for (training, fold) in &inner {
            let held = Gram::sum(grams, fold).of_columns(columns);
            for (cost, penalty) in costs.iter_mut().zip(&penalties) {
                *cost += held.left(&solve::ridge(training, columns, *penalty));
            }
        }
        let penalty = if inner.is_empty() { UNVALIDATED } else { penalties[smallest(&costs)] };
        let gains = solve::ridge(&Gram::sum(grams, runs), columns, penalty);
        Ok(columns.iter().copied().zip(gains.iter().copied()).collect())
    }
}
