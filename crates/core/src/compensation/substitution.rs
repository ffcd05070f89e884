//! Substitutes for the readings of rejected sensors.

use crate::quantity::Moment;
use crate::reading::SignalId;

/// Substitute for the reading of a sensor whose own reading is not used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Substitution {
    pub(super) signal: SignalId,
    /// Whether the reading is constant (suspected or frozen). Otherwise the sensor was lost.
    pub(super) frozen: bool,
    /// Time at which the sensor's reading last changed, or was last good.
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
