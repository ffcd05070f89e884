//! A sensor that others stand in for, and its end.

use std::time::Duration;

use serde::Serialize;

use super::data::in_seconds;
use super::{Described, info, warning};

/// What becomes of a sensor of an axis's model.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum StandIn {
    /// Others say what it would read.
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
        /// How many they are.
        others: usize,
    },
    /// Its own reading is used again, or no model with it.
    Over {
        /// Whose model reads it.
        axis: String,
        /// Which.
        signal: String,
    },
}

impl StandIn {
    pub(super) fn described(&self) -> Described {
        match self {
            StandIn::Taken { axis, signal, frozen, span, others } => {
                let (kind, is) = if *frozen { ("frozen", "frozen") } else { ("stood-in", "lost") };
                let span = humantime::format_duration(Duration::from_secs(span.as_secs()));
                warning(kind, format!("axis {axis}: {signal} {is} for {span}, taken from {others} others"))
            }
            StandIn::Over { axis, signal } => {
                info("stand-in-over", format!("axis {axis}: {signal} is not taken from others any more"))
            }
        }
    }
}
