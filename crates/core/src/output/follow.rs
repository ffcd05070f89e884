//! Whether an output follows the decisions of its axis, and if not, the reason.

use serde::{Deserialize, Serialize};

use crate::quantity::Counts;

/// Whether an output follows the decisions of its axis, and if not, the reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Follow {
    /// The output follows the decisions of the axis.
    #[default]
    Target,
    /// The axis was instructed to resume from this register value. The request is not repeated for the same value.
    HoldAt(Counts),
    /// The axis must resume from the verified register value, which may differ from the decision of the axis.
    TakeOver(Cause),
    /// The turn of the output (the work of the bus line's task on it) came too late for the last decision. At the next
    /// decision, the output has priority on its bus line.
    Late,
    /// A change of the register waits for earlier writes that may still arrive.
    Waiting,
}

/// Reason why an axis resumes from the register value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cause {
    /// The control was restarted.
    Restart,
    /// Any cause other than a restart of the control.
    Other,
}

impl Follow {
    /// Requests that the axis resume from the verified register value. A cause that was recorded earlier is
    /// kept.
    pub(super) fn take_over(&mut self) {
        if !matches!(self, Follow::TakeOver(_)) {
            *self = Follow::TakeOver(Cause::Other);
        }
    }

    /// Records that the task of the bus line came too late to send the decision. A pending request to resume from the
    /// register value takes precedence.
    pub(super) fn late(&mut self) {
        if !matches!(self, Follow::TakeOver(_)) {
            *self = Follow::Late;
        }
    }
}

/// Reason why a register does not hold the decided value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Trouble {
    /// The device did not answer a read, or the bus line sends nothing to the device for a while (back-off).
    Link,
    /// The device did not answer the last write, or could not be reached for it.
    Unanswered,
    /// The device refused a write, or the register does not hold the written value.
    Untaken,
    /// The trouble [`Trouble::Untaken`] has lasted for more than one turn (visit of the bus line's task to the output).
    StillUntaken,
    /// The state of the output cannot be saved to disk.
    Disk,
}

impl Trouble {
    /// Returns whether the device refused a write, or the register does not hold the written value.
    pub(super) fn is_untaken(self) -> bool {
        matches!(self, Trouble::Untaken | Trouble::StillUntaken)
    }
}

/// Health of an output: whether its register value is known and accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OutputHealth {
    /// The register value was read or acknowledged, and the gateway accepts it.
    Verified,
    /// The last exchange failed, the register does not hold the written value, or the interlock signal is unknown.
    Unverified,
    /// The interlock does not allow writing.
    Interlocked,
    /// The operator must assess the register value, for example because another client wrote it.
    Foreign,
}
