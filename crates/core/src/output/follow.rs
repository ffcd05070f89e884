//! How an output follows the decisions of its axis.

use serde::{Deserialize, Serialize};

use crate::quantity::Counts;

/// How an output follows the decisions of its axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Follow {
    /// The output is sent what the axis decides.
    #[default]
    Target,
    /// The axis was given this register value to resume from.
    HoldAt(Counts),
    /// The axis is to resume from the verified value, which is not what it decided.
    TakeOver(Cause),
    /// Its turn came too late for the last decision: with the next one it goes first on its line.
    Late,
    /// A change waits for what may still arrive.
    Waiting,
}

/// Why an axis resumes from the register value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cause {
    /// The control was restarted.
    Restart,
    /// Anything else.
    Other,
}

impl Follow {
    /// The axis is to resume from the verified value. A restart stays the cause.
    pub(super) fn take_over(&mut self) {
        if !matches!(self, Follow::TakeOver(_)) {
            *self = Follow::TakeOver(Cause::Other);
        }
    }

    /// The turn came too late. An axis that is to resume from the register value does so all the same.
    pub(super) fn late(&mut self) {
        if !matches!(self, Follow::TakeOver(_)) {
            *self = Follow::Late;
        }
    }
}

/// Why a register does not hold what was decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Trouble {
    /// The device did not answer.
    Link,
    /// The device did not answer a write, and none was sent since.
    Unanswered,
    /// The device answered, but the register does not hold what was written.
    Untaken,
    /// The register still did not hold what was written at the end of the last turn.
    StillUntaken,
    /// The disk does not keep what it must.
    Disk,
}

impl Trouble {
    /// The device answered, but the register does not hold what was written.
    pub(super) fn is_untaken(self) -> bool {
        matches!(self, Trouble::Untaken | Trouble::StillUntaken)
    }
}

/// Health of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OutputHealth {
    /// The register value is known, and is the gateway's.
    Verified,
    /// The last exchange failed, or the register does not hold what was written.
    Unverified,
    /// The interlock does not allow writing.
    Interlocked,
    /// The operator must judge what the register holds.
    Foreign,
}
