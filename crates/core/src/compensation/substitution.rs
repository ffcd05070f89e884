//! Substitutes for the readings of rejected sensors, which are suspected, frozen or lost.

use crate::quantity::Moment;
use crate::reading::SignalId;

/// Substitute for the reading of a sensor whose own reading is not used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Substitution {
    pub(super) signal: SignalId,
    /// Whether the reading is constant, so that the sensor is suspected or frozen. Otherwise the sensor is lost: it has
    /// no good reading.
    pub(super) frozen: bool,
    /// Time at which the reading last changed (suspected or frozen), or was last good (lost).
    pub(super) since: Moment,
    pub(super) source: SubstituteSource,
}

/// Source from which a substitute gets its value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SubstituteSource {
    /// The substitute is a stand-in, predicted from other sensors.
    Predictors {
        /// Predicted value in the unit of the sensor; `None` if the reading from which the change is counted is
        /// unknown.
        value: Option<f64>,
        /// Predicted rise since machine start.
        rise: f64,
    },
    /// The stand-in has no value. Everything that requires the sensor waits.
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
