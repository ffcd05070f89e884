//! What is used in the place of a reading that is not believed.

use crate::quantity::Moment;
use crate::reading::SignalId;

/// A sensor whose reading is used for nothing, whatever it reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Instead {
    pub(super) signal: SignalId,
    /// It has read the same all the time; else it was lost.
    pub(super) frozen: bool,
    /// Its reading last changed, or was last good, then.
    pub(super) since: Moment,
    pub(super) says: Says,
}

/// Who says what it would read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Says {
    /// Other sensors.
    Others {
        /// In its unit; `None` where nobody knows what it begins from.
        value: Option<f64>,
        /// Since the machine's start.
        rise: f64,
    },
    /// Nobody: whatever needs it waits.
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
