//! What is used in the place of a reading that is not believed.

use crate::compensation::model::Unusable;
use crate::quantity::Moment;
use crate::reading::SignalId;

/// A sensor whose reading is used for nothing, whatever it reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::compensation) struct Instead {
    pub(in crate::compensation) signal: SignalId,
    /// It has read the same all the time; else it was lost.
    pub(in crate::compensation) frozen: bool,
    /// Its reading last changed, or was last good, then.
    pub(in crate::compensation) since: Moment,
    pub(in crate::compensation) says: Says,
}

/// Who says what it would read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::compensation) enum Says {
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
    pub(in crate::compensation) fn value(&self) -> Option<f64> {
        match self.says {
            Says::Others { value, .. } => value,
            Says::Nobody => None,
        }
    }

    /// Why it cannot be used where nobody says what is needed of it.
    pub(in crate::compensation) fn unusable(&self) -> Unusable {
        if self.frozen { Unusable::Frozen(self.signal) } else { Unusable::Unproven(self.signal) }
    }

    pub(in crate::compensation) fn is_stood_in(&self) -> bool {
        self.says != Says::Nobody
    }
}
