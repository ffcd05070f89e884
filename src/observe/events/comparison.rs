//! Events about the comparison of two errors of an axis: with the Cz (compensation value) of its model, and without
//! compensation.

use serde::Serialize;

use super::description::{EventDescription, caused, plain};
use isotherm_core::events::EventKind;
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Micron;

/// Result of the comparison: whether the error is larger with the model than without compensation.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Comparison {
    /// The error is larger with the model.
    Worse {
        /// Name of the axis whose model is worse than no compensation.
        axis: String,
        /// Number of probings (measurements with a probe) that show that the model is worse; 0 if all were made before
        /// the last datum (zero point of Cz).
        touches: usize,
        /// Root mean square of the error without compensation.
        #[serde(rename = "without_um")]
        without: Micron,
        /// Root mean square of the error with the Cz of the model.
        #[serde(rename = "with_um")]
        with: Micron,
        /// Whether the gateway moves Cz to zero, and keeps it there while the model is worse than no
        /// compensation.
        ramps: bool,
    },
    /// The model is no longer worse than no compensation.
    Over {
        /// Name of the axis whose model is no longer worse.
        axis: String,
    },
}

/// Formats a sentence about a model that is worse than no compensation. `touches` is the number of probings that show
/// this.
pub(crate) fn found_worse(touches: usize, with: Micron, without: Micron) -> String {
    let shown = match touches {
        0 => "touches before the last datum (zero point of Cz) show this".to_owned(),
        count => format!(
            "the residual error is {with} with the model, {without} without (root mean square of the last \
             {count} touches)"
        ),
    };
    format!("the model is worse than no compensation: {shown}")
}

/// Hint for an axis whose Cz goes to zero because its model is worse.
const RAMPS: &str = "Cz goes to zero until touches show that the model is better; identify the model again";

impl Comparison {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            Comparison::Worse { axis, touches, without, with, ramps } => {
                let cause = found_worse(*touches, *with, *without);
                let why = if *ramps { Explained::new(cause, RAMPS) } else { cause.into() };
                caused(format!("axis {axis}"), why).of(EventKind::Worse)
            }
            Comparison::Over { axis } => {
                plain(format!("axis {axis}: the model is no longer worse than no compensation"))
                    .of(EventKind::WorseOver)
            }
        }
    }
}
