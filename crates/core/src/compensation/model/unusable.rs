//! Reasons why a model has no value, for example that a sensor has no good reading.

use serde::{Deserialize, Serialize};

use crate::compensation::substitution::Substitution;
use crate::reading::SignalId;

/// Reason why a model has no value now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unusable {
    /// The reading of this signal cannot be used.
    Signal(SignalId),
    /// The reference of this signal has not been captured yet.
    Reference(SignalId),
    /// The gateway has not seen the machine running, so there is no time since its start.
    MachineOff,
    /// The reading of this signal is frozen, and no stand-in replaces it.
    Frozen(SignalId),
    /// This signal has a reading again after a loss, but the reading is not accepted yet.
    Unproven(SignalId),
    /// The result is not a finite number (a division by zero, a root of a negative number).
    NotANumber,
}

impl From<&Substitution> for Unusable {
    /// Returns why a model cannot be used if this substitute for one of its sensors has no value.
    fn from(substitution: &Substitution) -> Unusable {
        if substitution.frozen {
            Unusable::Frozen(substitution.signal)
        } else {
            Unusable::Unproven(substitution.signal)
        }
    }
}
