//! Substitutes for rejected readings.

use crate::quantity::Moment;
use crate::reading::SignalId;

/// Substitute for a sensor whose own reading is not used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Substitution {
    pub(super) signal: SignalId,
    /// The reading is constant; else the sensor was lost.
    pub(super) frozen: bool,
    /// Time at which the reading last changed, or was last good.
    pub(super) since: Moment,
    pub(super) source: SubstituteSource,
}

/// Source of a substitute.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SubstituteSource {
    /// A stand-in, predicted from other sensors.
    Predictors {
        /// Value in the unit of the sensor; `None` if the sensor's start is unknown.
        value: Option<f64>,
        /// Rise since machine start.
        rise: f64,
    },
    /// No source. Everything that requires the sensor waits.
    None,
}

impl Substitution {
    pub(super) fn value(&self) -> Option<f64> {
        match self.source {
            SubstituteSource::Predictors { value, .. } => value,
            SubstituteSource::None => None,
        }
    }

    pub(super) fn has_source(&self) -> bool {
        self.source != SubstituteSource::None
    }
}
