//! `expected` of a model: its probable error, measured on test runs of the machine that the identification did not use.

use schemars::JsonSchema;
use serde::Deserialize;

use super::effect::figure;
use crate::tables::{KeyContext, optional};
use isotherm_core::compensation::model::{Expected, Growth};

/// Variance of a model's error h hours after an event: `a·h + b` µm².
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Expected")]
pub(super) struct RawExpected {
    /// Variance since the datum as [a, b]: a in µm²/h, b in µm². The datum is the time at which the references were
    /// captured, or machine start if all references are numbers.
    #[schemars(required)]
    since_datum: Option<[f64; 2]>,
    /// Variance since the last probing that corrected the model, as [a, b].
    since_touch: Option<[f64; 2]>,
}

impl RawExpected {
    pub(super) fn resolve(&self, at: &KeyContext<'_>) -> Option<Expected> {
        let since_datum = self.since_datum.and_then(|pair| growth(&at.key("since_datum"), pair));
        let since_touch = optional(self.since_touch, |pair| growth(&at.key("since_touch"), pair));
        Some(Expected { since_datum: since_datum?, since_touch: since_touch? })
    }
}

/// Creates the variance `per_hour`·h + `at_once` µm² after h hours. Reports an error and returns `None` if a number is
/// negative.
fn growth(at: &KeyContext<'_>, [per_hour, at_once]: [f64; 2]) -> Option<Growth> {
    let growth = Growth::new(per_hour, at_once);
    if growth.is_none() {
        let help = "write [a, b] as `isotherm identify` prints them, for example [0.9, 1.1]: the variance \
                    after h hours is a·h + b µm²";
        at.invalid(
            format!("[{per_hour}, {at_once}] does not describe a variance: both numbers must be 0 or more"),
            help,
        );
    }
    growth
}

/// Describes the expected error: `expected within ±√(0.9·h + 1.1) µm after h hours since the datum, ±√(0.8·h + 0.2) µm
/// since a probing (1 σ)`.
pub(super) fn preview(expected: &Expected) -> String {
    let root = |growth: &Growth| {
        let [per_hour, at_once] = [growth.per_hour(), growth.at_once()].map(figure);
        format!("±√({per_hour}·h + {at_once}) µm")
    };
    let touch = expected.since_touch.as_ref();
    let touch = touch.map_or(String::new(), |growth| format!(", {} since a probing", root(growth)));
    format!("expected within {} after h hours since the datum{touch} (1 σ)", root(&expected.since_datum))
}
