//! Selection of sensors by forward search. Each step adds the sensor whose rises give the smallest residual on held-out
//! runs. A rise is a reading minus its reference value.

use std::time::Duration;

use nalgebra::DVector;

use crate::bank::{Bank, Rows};
use crate::campaign::Campaign;
use crate::products::{Fold, Products};
use crate::solve::{Ridge, decades};
use crate::statistics::{least_sum, smallest};

/// Lags through which each sensor is used: none, 12 and 50 minutes.
const LAGS: [Option<Duration>; 3] = [None, Some(Duration::from_mins(12)), Some(Duration::from_mins(50))];

/// Forward search that adds one sensor at a time, with all its lags.
#[derive(Debug)]
pub(crate) struct Forward {
    bank: Bank,
    products: Products,
}

impl Forward {
    pub(crate) fn new(campaign: &Campaign<'_>) -> Forward {
        let bank = Bank::of_inputs(campaign, &campaign.sensors(), &LAGS, Rows::WithError);
        Forward { products: Products::of(&bank), bank }
    }

    /// Returns at most `most` sensors, in the order in which the search added them. The search uses only the runs
    /// `runs`, and does not use the inputs in `without`.
    pub(crate) fn path(&self, runs: &[usize], without: &[usize], most: usize) -> Vec<usize> {
        let width = self.bank.candidates.len();
        let every: Vec<usize> = (0..width).collect();
        let mut folds = self.products.folds(runs, &every, &DVector::from_element(width, 1.0));
        if runs.len() < 2 {
            // A single run is validated on itself.
            folds.iter_mut().for_each(|fold| fold.training = fold.white.clone());
        }
        let mut chosen: Vec<usize> = Vec::new();
        while chosen.len() < most {
            let is_free = |input: &usize| {
                !self.bank.is_speed[*input] && !chosen.contains(input) && !without.contains(input)
            };
            let free: Vec<usize> = (0..self.bank.is_speed.len()).filter(is_free).collect();
            let costs: Vec<f64> = free
                .iter()
                .map(|input| self.left(&folds, &[chosen.as_slice(), &[*input]].concat()))
                .collect();
            if free.is_empty() {
                break;
            }
            chosen.push(free[smallest(&costs)]);
        }
        chosen
    }

    fn left(&self, folds: &[Fold], inputs: &[usize]) -> f64 {
        let candidates = self.bank.candidates.iter().enumerate();
        let own = candidates.filter(|(_, candidate)| inputs.contains(&candidate.input));
        let columns: Vec<usize> = own.map(|(column, _)| column).collect();
        let penalties = decades(-3, 1, 1);
        let costs = folds.iter().map(|fold| {
            let ridge = Ridge::of(&fold.training.of_columns(&columns));
            let plain = fold.plain.of_columns(&columns);
            penalties.iter().map(|penalty| plain.left(&ridge.at(*penalty))).collect()
        });
        least_sum(costs).map_or(f64::MAX, |(_, left)| left)
    }
}
