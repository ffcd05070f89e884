//! Substitutes for rejected readings.

use crate::quantity::Moment;
use crate::reading::SignalId;

/// Substitute for a sensor whose own reading is not used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Instead {
    pub(super) signal: SignalId,
    /// The reading is constant; else the sensor was lost.
    pub(super) frozen: bool,
    /// Time at which the reading last changed, or was last good.
    pub(super) since: Moment,
    pub(super) says: Says,
}

/// Source of a substitute.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Says {
    /// A stand-in, predicted from other sensors.
    Others {
        /// Value in the unit of the sensor; `None` if the sensor's start is unknown.
        value: Option<f64>,
        /// Rise since machine start.
        rise: f64,
    },
    /// No source. Everything that requires the sensor waits.
    Nobody,
}

impl Instead {
    pub(super) fn value(&self) -> Option<f64> {
        match self.says {
            Says::Others { value, .. } => value,
            Says::Nobody => None,
        }
    }

    pub(super) fn is_stood_in(&self) -> bool {
        self.says != Says::Nobody
    }
}
