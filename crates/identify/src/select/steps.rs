//! Stepwise: the points in the order in which partial F tests take them in, on rises without lags.
//!
//! A point comes in where chance would give as much in one case of a hundred, and leaves where in one of twenty. Rows of
//! half an hour count as one sample: counted singly, nearly every point seems significant.

use serde::Serialize;

use crate::bank::Bank;
use crate::gram::Gram;
use crate::learn::plain;
use crate::method::stepwise::{ENTERS, LEAVES, chance};
use crate::solve;
use crate::statistics::count;

/// The order, and why it ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Steps {
    /// One after the other.
    pub steps: Vec<Step>,
    /// The point that would have been next, and is not significant.
    pub next: Option<Step>,
    /// Independent samples, as they were counted.
    pub samples: f64,
}

/// A point comes in or leaves.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Step {
    /// The point.
    pub point: String,
    /// It comes in; else it leaves again.
    pub comes_in: bool,
    /// Partial F: by how much more is explained with it, over what is left.
    pub f: f64,
    /// The chance of such an F where the point has nothing to do with the error.
    pub chance: f64,
}

/// Over all runs.
pub(super) fn steps(bank: &Bank, rows_per_sample: f64, name: &dyn Fn(&usize) -> String) -> Steps {
    let grams = bank.grams();
    let gram = Gram::sum(&grams, &(0..grams.len()).collect::<Vec<usize>>());
    let points = bank.candidates.iter().map(|candidate| candidate.input + 1).max().unwrap_or(0);
    let columns: Vec<usize> = (0..points).filter_map(|point| plain(bank, point)).collect();
    let samples = gram.rows / rows_per_sample;
    let left = |chosen: &[usize]| match chosen {
        [] => gram.power,
        _ => gram.of_columns(chosen).left(&solve::ridge(&gram, chosen, 0.0)),
    };
    let step = |column: usize, comes_in: bool, more: f64, less: f64, free: f64| Step {
        point: name(&bank.candidates[column].input),
        comes_in,
        f: ((more - less) / (less / free)).clamp(0.0, f64::MAX),
        chance: chance(more, less, free),
    };
    let mut found = Steps { steps: Vec::new(), next: None, samples };
    let (mut chosen, mut now) = (Vec::new(), gram.power);
    // Each round takes one in; a bound all the same.
    for _ in 0..4 * columns.len() {
        let free = samples - count(chosen.len()) - 1.0;
        let outside = columns.iter().filter(|column| !chosen.contains(*column));
        let tried = outside.map(|column| {
            let with: Vec<usize> = chosen.iter().copied().chain([*column]).collect();
            (left(&with), *column)
        });
        let best = tried.min_by(|one, other| one.0.total_cmp(&other.0)).filter(|_| free >= 1.0);
        let Some((less, column)) = best else { break };
        let taken = step(column, true, now, less, free);
        if taken.chance >= ENTERS {
            found.next = Some(taken);
            break;
        }
        found.steps.push(taken);
        chosen.push(column);
        now = less;
        // The point that just came in stays for now: else the two would take turns.
        while chosen.len() > 1 {
            let tried = (0..chosen.len() - 1).map(|place| {
                let mut without = chosen.clone();
                let column = without.remove(place);
                (left(&without), place, column)
            });
            let weakest = tried.min_by(|one, other| one.0.total_cmp(&other.0));
            let Some((more, place, column)) = weakest else { break };
            let gone = step(column, false, more, now, samples - count(chosen.len()));
            if gone.chance <= LEAVES {
                break;
            }
            found.steps.push(gone);
            chosen.remove(place);
            now = more;
        }
    }
    found
}
