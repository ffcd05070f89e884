//! `stepwise`: partial F tests, in and out, with an honest count of samples.
//!
//! Minute rows of a slow machine are not independent: counted as such, nearly every sensor seems significant.

use statrs::distribution::{ContinuousCDF, FisherSnedecor};

use super::Rule;
use crate::gram::Gram;
use crate::solve;
use crate::statistics::count;

pub(super) struct Stepwise {
    /// How many rows make one independent sample.
    pub(super) rows_per_sample: f64,
    /// Most terms.
    pub(super) terms: usize,
}

/// A term comes in where chance would give as much in one case of a hundred, and leaves where in one of twenty.
pub(crate) const ENTERS: f64 = 0.01;
pub(crate) const LEAVES: f64 = 0.05;

impl Rule for Stepwise {
    fn fit(&self, grams: &[Gram], runs: &[usize], columns: &[usize]) -> Result<Vec<(usize, f64)>, String> {
        let gram = Gram::sum(grams, runs);
        let samples = gram.rows / self.rows_per_sample;
        let left = |chosen: &[usize]| match chosen {
            [] => gram.power,
            _ => gram.of_columns(chosen).left(&solve::ridge(&gram, chosen, 0.0)),
        };
        let mut chosen: Vec<usize> = Vec::new();
        let mut now = gram.power;
        // Each round ends with less left over or with the end; a bound all the same.
        for _ in 0..10 * columns.len() {
            let free = samples - count(chosen.len()) - 1.0;
            let outside = columns.iter().copied().filter(|column| !chosen.contains(column));
            let tried = outside.map(|column| {
                let with: Vec<usize> = chosen.iter().copied().chain([column]).collect();
                (left(&with), column)
            });
            let best = tried.min_by(|one, other| one.0.total_cmp(&other.0));
            let Some((less, column)) = best.filter(|_| chosen.len() < self.terms && free >= 1.0) else {
                break;
            };
            if chance(now, less, free) >= ENTERS {
                break;
            }
            chosen.push(column);
            now = less;
            while chosen.len() > 1 {
                let tried = (0..chosen.len() - 1).map(|place| {
                    let mut without = chosen.clone();
                    without.remove(place);
                    (left(&without), place)
                });
                let weakest = tried.min_by(|one, other| one.0.total_cmp(&other.0));
                let free = samples - count(chosen.len());
                let Some((more, place)) = weakest.filter(|(more, _)| chance(*more, now, free) > LEAVES)
                else {
                    break;
                };
                chosen.remove(place);
                now = more;
            }
        }
        let gains = solve::ridge(&gram, &chosen, 0.0);
        Ok(chosen.iter().copied().zip(gains.iter().copied()).collect())
    }
}

/// The chance that one more column takes this much off what is left though it has nothing to do with it.
pub(crate) fn chance(before: f64, after: f64, free: f64) -> f64 {
    let f = (before - after) / (after / free);
    if f.is_nan() || f <= 0.0 {
        return 1.0;
    }
    FisherSnedecor::new(1.0, free).map_or(1.0, |law| law.sf(f))
}
