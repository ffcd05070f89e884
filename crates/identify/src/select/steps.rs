//! Stepwise selection of points: partial F tests decide in which order points are added. The tests use rises
//! (temperatures minus their reference values) without lags.

use serde::Serialize;

use crate::bank::Bank;
use crate::gram::Gram;
use crate::method::stepwise::{self, Move};

/// Result of the stepwise selection: its steps, and the next best point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Steps {
    /// Points that were added or removed, in the order of the search.
    pub steps: Vec<Step>,
    /// Best point that is not added because it is not significant; `None` if the search ended for another reason.
    pub next: Option<Step>,
    /// Number of log rows of all runs that count as independent samples.
    pub samples: f64,
}

/// Step of the selection, in which a point is added or removed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Step {
    /// Name of the point.
    pub point: String,
    /// Whether the point is added; otherwise it is removed.
    pub comes_in: bool,
    /// Partial F: reduction of the squared residual by the point, divided by the residual variance.
    pub f: f64,
    /// Probability of such an F value if the point has no effect (p-value).
    pub chance: f64,
}

/// Selects points by partial F tests on the rows of all runs. `rows_per_sample` is the number of log rows that count as
/// one independent sample.
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
