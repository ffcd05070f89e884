//! Relation between an output and the decisions of its axis.

use serde::{Deserialize, Serialize};

use crate::quantity::Counts;

/// Relation between an output and the decisions of its axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Follow {
    /// The output follows the decisions of the axis.
    #[default]
    Target,
    /// The axis has received this register value, from which it resumes.
    HoldAt(Counts),
    /// The axis must resume from the verified value, which differs from its decision.
    TakeOver(Cause),
    /// The turn of the output (the work of the line task on it) came too late for the last decision. At the next
    /// decision, the output has priority on its line.
    Late,
    /// A change waits for copies that may still arrive.
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
    /// Requests that the axis resumes from the verified value. A restart remains the cause.
    pub(super) fn take_over(&mut self) {
        if !matches!(self, Follow::TakeOver(_)) {
            *self = Follow::TakeOver(Cause::Other);
        }
    }

    /// Records that the turn came too late. A request to resume from the register value stays.
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
    /// The device did not answer.
    Link,
    /// The device did not answer a write, and none has been sent since.
    Unanswered,
    /// The device answered, but the register does not hold the written value.
    Untaken,
    /// The register still did not hold the written value at the end of the last turn.
    StillUntaken,
    /// The state cannot be written to disk.
    Disk,
}

impl Trouble {
    /// Returns whether the device answered, but the register does not hold the written value.
    pub(super) fn is_untaken(self) -> bool {
        matches!(self, Trouble::Untaken | Trouble::StillUntaken)
    }
}

/// Health of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OutputHealth {
    /// The register value is known, and was written by the gateway.
    Verified,
    /// The last exchange failed, or the register does not hold the written value.
    Unverified,
    /// The interlock does not allow writing.
    Interlocked,
    /// The operator must assess the register value.
    Foreign,
}
