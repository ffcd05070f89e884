//! Events about a frozen or lost sensor: begin and end of its stand-in, which is a value estimated from other sensors.

use std::time::Duration;

use serde::Serialize;

use super::data::in_seconds;
use super::description::{EventDescription, caused, plain};
use isotherm_core::events::EventKind;
use isotherm_core::explained::Explained;
use isotherm_profile::{counted, duration_text};

/// Change in the state of a sensor that a model uses.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum StandIn {
    /// The sensor is frozen or lost, and a stand-in replaces its reading. Or the sensor is only suspected of being
    /// frozen, and its reading is still used.
    Taken {
        /// Name of the axis whose model uses the sensor.
        axis: String,
        /// Name of the sensor's signal in the profile.
        signal: String,
        /// Whether the sensor is frozen, which means that its reading does not change. If `false`, the sensor
        /// is lost.
        frozen: bool,
        /// Time that has passed since the fault began.
        #[serde(rename = "for_s", serialize_with = "in_seconds")]
        span: Duration,
        /// Number of sensors from which the stand-in is calculated; `None` if there is no stand-in.
        others: Option<usize>,
    },
    /// The sensor no longer has a stand-in (value estimated from other sensors).
    Over {
        /// Name of the axis whose model uses the sensor.
        axis: String,
        /// Name of the sensor's signal in the profile.
        signal: String,
        /// Whether the sensor's own reading is accepted again. If `false`, the reading is still missing or
        /// rejected.
        #[serde(rename = "believed")]
        accepted: bool,
    },
}

/// Formats the number of other sensors, for example `1 other sensor` or `5 other sensors`.
pub(crate) fn others(count: usize) -> String {
    counted(count, "other sensor")
}

/// Hint about a sensor that is suspected of being frozen, and whose reading is still used.
const USED_MEANWHILE: &str =
    "check the sensor, its cable and its channel; until then, the axis uses the reading";

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
                let is = if *accepted { "accepted again" } else { "no longer replaced by a stand-in" };
                plain(format!("axis {axis}: {signal} is {is}")).of(EventKind::StandInOver)
            }
        }
    }
}
