//! Events of a rejected sensor: its stand-in, and its end.

use std::time::Duration;

use serde::Serialize;

use super::data::in_seconds;
use super::description::{EventDescription, caused, plain};
use isotherm_core::events::EventKind;
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

/// Hint for a sensor that is suspected, and whose reading is used.
const USED_MEANWHILE: &str =
    "look at the sensor, its cable and its channel; the axis uses its reading meanwhile";

impl StandIn {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            StandIn::Taken { axis, signal, frozen, span, others: count } => {
                let (kind, is) =
                    if *frozen { (EventKind::Frozen, "frozen") } else { (EventKind::StoodIn, "lost") };
                let is = format!("{signal} {is} for {}", duration_text(Duration::from_secs(span.as_secs())));
                let why = match count {
                    Some(count) => format!("{is}, replaced by a stand-in from {}", others(*count)).into(),
                    None => Explained::new(format!("{is}, and not replaced by a stand-in"), USED_MEANWHILE),
                };
                caused(format!("axis {axis}"), why).of(kind)
            }
            StandIn::Over { axis, signal, accepted } => {
                let is = if *accepted { "accepted again" } else { "not replaced by a stand-in any more" };
                plain(format!("axis {axis}: {signal} is {is}")).of(EventKind::StandInOver)
            }
        }
    }
}
