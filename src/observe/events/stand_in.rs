//! A sensor that is not believed, whether others stand in for it, and its end.

use std::time::Duration;

use serde::Serialize;

use super::data::in_seconds;
use super::{Described, info, warning};
use isotherm_core::explained::Explained;
use isotherm_profile::{counted, duration_text};

/// What becomes of a sensor of an axis's model.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum StandIn {
    /// It is frozen or lost, and others say what it would read; or it is suspected of being frozen, and its reading is used.
    Taken {
        /// Whose model reads it.
        axis: String,
        /// Which.
        signal: String,
        /// It reads the same all the time; else it is lost.
        frozen: bool,
        /// How long it has been that.
        #[serde(rename = "for_s", serialize_with = "in_seconds")]
        span: Duration,
        /// How many they are; `None` where nothing is taken from others.
        others: Option<usize>,
    },
    /// It is not taken from others any more.
    Over {
        /// Whose model reads it.
        axis: String,
        /// Which.
        signal: String,
        /// Its own reading is used again; else it still is not there, or not believed.
        believed: bool,
    },
}

/// `1 other`, `5 others`.
pub(crate) fn others(count: usize) -> String {
    counted(count, "other")
}

impl StandIn {
    pub(super) fn described(&self) -> Described {
        match self {
            StandIn::Taken { axis, signal, frozen, span, others: count } => {
                let (kind, is) = if *frozen { ("frozen", "frozen") } else { ("stood-in", "lost") };
                let span = duration_text(Duration::from_secs(span.as_secs()));
                let (taken, hint) = match count {
                    Some(count) => (
                        format!("taken from {}", others(*count)),
                        "look at the sensor, its cable and its channel; the axis uses its own reading again by itself",
                    ),
                    None => (
                        "and not taken from others".to_owned(),
                        "look at the sensor, its cable and its channel; its own reading is used meanwhile",
                    ),
                };
                let cause = format!("{signal} {is} for {span}, {taken}");
                warning(kind, format!("axis {axis}"), Explained::new(cause, hint))
            }
            StandIn::Over { axis, signal, believed: true } => {
                info("stand-in-over", format!("axis {axis}: {signal} is believed again"))
            }
            StandIn::Over { axis, signal, believed: false } => {
                info("stand-in-over", format!("axis {axis}: {signal} is not taken from others any more"))
            }
        }
    }
}
