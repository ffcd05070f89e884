//! Stepwise: the points in the order in which partial F tests take them in, on rises without lags.

use serde::Serialize;

use crate::bank::Bank;
use crate::gram::Gram;
use crate::method::stepwise::{self, Move};

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
pub(super) fn steps(bank: &Bank, rows_per_sample: f64, name: &dyn Fn(usize) -> String) -> Steps {
    let gram = Gram::total(&bank.grams());
    let is_plain = |column: &usize| bank.candidates[*column].lag.is_none();
    let columns: Vec<usize> = (0..bank.candidates.len()).filter(is_plain).collect();
    let samples = gram.rows / rows_per_sample;
    let step = |taken: Move| Step {
        point: name(bank.candidates[taken.column].input),
        comes_in: taken.comes_in,
        f: taken.f.clamp(0.0, f64::MAX),
        chance: taken.chance,
    };
    let (moves, next) = stepwise::search(&gram, samples, &columns, usize::MAX);
    Steps { steps: moves.into_iter().map(step).collect(), next: next.map(step), samples }
}
