//! Actions of an output. Each call of [`step`](super::step) returns one action, which the caller executes.

use serde::{Deserialize, Serialize};

use crate::quantity::{Counts, Moment, Shift, Shifted};

/// Next action of an output: at most one exchange with the device or the disk. The caller gives the result as the next
/// [`Fact`](super::Fact).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Action {
    /// Do nothing until another fact arrives, or until this moment.
    Nothing {
        /// Time at which the caller must give the next [`Fact::Look`](super::Fact::Look).
        until: Moment,
    },
    /// Read the register. [`Fact::Read`](super::Fact::Read) or [`Fact::NoAnswer`](super::Fact::NoAnswer) is the result.
    Read,
    /// Save the state of the output ([`State::kept`](super::State::kept)) to disk.
    Keep,
    /// Write a value to the register.
    Write {
        /// Value to write to the register.
        value: Counts,
        /// Last moment for the first byte. After that moment, the write is not sent.
        not_after: Moment,
        /// Whether the register already holds the value, which is then only sent again.
        is_repeat: bool,
    },
}

impl Default for Action {
    fn default() -> Action {
        Action::Nothing { until: Moment::default() }
    }
}

impl Action {
    /// Returns a copy in which `to` is applied to the moment of the action, if any. Two states that differ
    /// only in time can then be compared.
    pub(super) fn moved(self, to: impl Fn(Moment) -> Moment) -> Action {
        match self {
            Action::Nothing { until } => Action::Nothing { until: to(until) },
            Action::Write { value, not_after, is_repeat } => {
                Action::Write { value, not_after: to(not_after), is_repeat }
            }
            Action::Read | Action::Keep => self,
        }
    }
}

impl Shifted for Action {
    fn shift(&mut self, by: Shift) {
        *self = self.moved(|moment| moment.shifted(by));
    }
}
