//! Input of a controller: the demand of the axis, and the results of exchanges.

use serde::{Deserialize, Serialize};

use super::{Fact, Who};
use crate::quantity::{Counts, Moment, shifted};

/// Demand on one output: present requirements of its axis, its interlock and the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Demand {
    /// Who armed the axis. `None` if the axis is off, and in a dry run.
    pub armed: Option<Who>,
    /// Condition of the interlock.
    pub interlock: Condition,
    /// Latest decision of the axis. `None` if the axis is off, or has not yet resumed from the register value.
    pub decision: Option<OutputDecision>,
    /// Number of restarts of the control so far.
    pub restarts: u64,
    /// Number of pauses of the computer so far.
    pub pauses: u64,
}

/// Decision of an axis about one output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputDecision {
    /// Counts from the bias, or the gateway share of a shared register.
    pub offset: Counts,
    /// Target of the offset. `None` if unknown, and for a constant.
    pub target: Option<Counts>,
    /// Time of the decision.
    pub at: Moment,
    /// Last moment for sending a change.
    pub not_after: Moment,
    /// Mode of the axis.
    pub mode: Mode,
}

/// Mode of a deciding axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// The axis follows its model.
    #[default]
    Follow,
    /// The axis keeps its offset.
    Hold,
    /// The axis carries out a fault action or a stop, or writes a constant.
    Finish,
}

/// Condition of an interlock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Condition {
    /// The interlock allows writing, or the output has no interlock.
    Met,
    /// The interlock does not allow writing.
    NotMet,
    /// The signal of the interlock is unknown.
    Unknown,
}

/// Input of a controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Input {
    /// The turn of the output begins: the line task works on this output until [`Input::TurnEnds`].
    Demand(Demand),
    /// A fact of the register.
    Fact(Fact),
    /// The write was not sent, for the given reason.
    NotSent(NotSent),
    /// The promise is on disk. [`Fact::Kept`] means that the promise need not be on disk.
    OnDisk,
    /// The applied value was read from the control.
    Applied {
        /// Thousandths of a count of the register. `None` if the value is not a number.
        found: Option<i64>,
        /// Time of the request.
        asked: Moment,
    },
    /// The read of the applied value was not answered.
    AppliedNoAnswer {
        /// Time of the request.
        asked: Moment,
    },
    /// Result of the set of the output.
    Set(SetCommit),
    /// The turn of the output ends. Pending exchanges of the turn are dropped.
    TurnEnds,
}

impl From<Fact> for Input {
    fn from(fact: Fact) -> Input {
        Input::Fact(fact)
    }
}

impl Input {
    /// Returns true if this is the result of an exchange with the device.
    pub(super) fn is_result(self) -> bool {
        match self {
            Input::Fact(fact) => matches!(
                fact,
                Fact::Read { .. }
                    | Fact::NoAnswer
                    | Fact::Done { .. }
                    | Fact::Unknown { .. }
                    | Fact::Refused
                    | Fact::NotSent
                    | Fact::Kept
                    | Fact::NotKept
            ),
            Input::NotSent(_) | Input::OnDisk => true,
            Input::Demand(_)
            | Input::Applied { .. }
            | Input::AppliedNoAnswer { .. }
            | Input::Set(_)
            | Input::TurnEnds => false,
        }
    }
}

/// Reason why a write was not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NotSent {
    /// The last moment of the write had passed.
    TooLate,
    /// The device could not be reached.
    Unreachable,
    /// The request cannot be built.
    Rejected,
    /// The line backs off from the device.
    BacksOff,
}

/// Result of the set that an output belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SetCommit {
    /// The control has taken the register values. Also the state of an output without a set.
    #[default]
    Taken,
    /// The control may not have taken the register values. Nothing else is sent.
    Open,
    /// The control has not taken the values that were sent.
    Failed,
}

shifted!(Demand: decision);
shifted!(OutputDecision: at, not_after);
