//! `expected` of a model: how wrong it was on runs that it had not seen.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::tables::At;
use isotherm_core::compensation::model::{Expected, Growth};

/// The variance of a model's error, as `a·h + b` µm² after h hours.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Expected")]
pub(super) struct RawExpected {
    /// [a, b]: a µm²/h, b µm²; h since the datum: the references, or the machine's start where they are numbers.
    #[schemars(required)]
    since_datum: Option<[f64; 2]>,
    /// The same since the last probing that the model learned from.
    since_touch: Option<[f64; 2]>,
}

impl RawExpected {
    pub(super) fn resolve(&self, at: &At<'_>) -> Option<Expected> {
        let since_datum = growth(&at.key("since_datum"), self.since_datum);
        let since_touch = growth(&at.key("since_touch"), self.since_touch);
        Some(Expected { since_datum: since_datum??, since_touch: since_touch? })
    }
}

/// `Some(None)` where there is none.
fn growth(at: &At<'_>, written: Option<[f64; 2]>) -> Option<Option<Growth>> {
    let Some([per_hour, at_once]) = written else { return Some(None) };
    let growth = Growth::new(per_hour, at_once);
    if growth.is_none() {
        let help = "write [a, b] as `isotherm identify` gives them, as [0.9, 1.1]: the variance is a·h + b µm² after h hours";
        at.wrong(format!("{per_hour} and {at_once} make no variance: both are 0 or more"), help);
    }
    growth.map(Some)
}

/// `expected within ±√(0.9·h + 1.1) µm after h hours since its datum, ±√(0.8·h + 0.2) µm since a probing (1 σ)`.
pub(super) fn preview(expected: &Expected) -> String {
    let root = |growth: &Growth| format!("±√({}·h + {}) µm", growth.per_hour(), growth.at_once());
    let touch = expected.since_touch.as_ref();
    let touch = touch.map_or(String::new(), |growth| format!(", {} since a probing", root(growth)));
    format!("expected within {} after h hours since its datum{touch} (1 σ)", root(&expected.since_datum))
}
