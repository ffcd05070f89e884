//! Events of a rejected sensor: its stand-in, and its end.

use std::time::Duration;

use serde::Serialize;

use super::data::in_seconds;
use super::{EventDescription, info, warning};
use isotherm_core::explained::Explained;
use isotherm_profile::{counted, duration_text};

/// Change of the state of a sensor of an axis's model.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum StandIn {
    /// The sensor is frozen or lost and has a stand-in; or it is suspected of being frozen, and its reading is used.
    Taken {
        /// Axis of the model.
        axis: String,
        /// Name of the signal.
        signal: String,
        /// The reading does not change; else the sensor is lost.
        frozen: bool,
        /// Time since the fault began.
        #[serde(rename = "for_s", serialize_with = "in_seconds")]
        span: Duration,
        /// Number of predictors of the stand-in; `None` without a stand-in.
        others: Option<usize>,
    },
    /// The sensor has no stand-in any more.
    Over {
        /// Axis of the model.
        axis: String,
        /// Name of the signal.
        signal: String,
        /// The sensor's own reading is accepted again; else it is still missing or rejected.
        #[serde(rename = "believed")]
        accepted: bool,
    },
}

/// Returns the number of other sensors as text: `1 other sensor`, `5 other sensors`.
pub(crate) fn others(count: usize) -> String {
    counted(count, "other sensor")
}

impl StandIn {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            StandIn::Taken { axis, signal, frozen, span, others: count } => {
                let (kind, is) = if *frozen { ("frozen", "frozen") } else { ("stood-in", "lost") };
                let span = duration_text(Duration::from_secs(span.as_secs()));
                let (taken, hint) = match count {
                    Some(count) => (
                        format!("replaced by a stand-in from {}", others(*count)),
                        "look at the sensor, its cable and its channel; the axis uses the sensor's own \
                         reading again by itself",
                    ),
                    None => (
                        "and not replaced by a stand-in".to_owned(),
                        "look at the sensor, its cable and its channel; the axis uses its reading meanwhile",
                    ),
                };
                let cause = format!("{signal} {is} for {span}, {taken}");
                warning(kind, format!("axis {axis}"), Explained::new(cause, hint))
            }
            StandIn::Over { axis, signal, accepted: true } => {
                info("stand-in-over", format!("axis {axis}: {signal} is accepted again"))
            }
            StandIn::Over { axis, signal, accepted: false } => {
                info("stand-in-over", format!("axis {axis}: {signal} is not replaced by a stand-in any more"))
            }
        }
    }
}
