//! Input of the controller of an output: the demand of the axis, and the results of exchanges. A turn is the work of
//! the bus line's task on one output.

use serde::{Deserialize, Serialize};

use super::{Fact, Who};
use crate::quantity::{Counts, Moment, shifted};

/// Demand on one output: present requirements of its axis, its interlock and the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Demand {
    /// Operator or profile that armed the axis. `None` if the axis is off, and in a dry run (a run that writes
    /// nothing).
    pub armed: Option<Who>,
    /// Condition of the interlock.
    pub interlock: Condition,
    /// Latest decision of the axis. `None` if the axis is off, or has not yet resumed from the register value.
    pub decision: Option<OutputDecision>,
    /// Number of restarts of the control so far.
    pub restarts: u64,
    /// Number of pauses of the computer so far, for example because it was suspended.
    pub pauses: u64,
}

/// Decision of an axis about one output: the offset to write, and the last moment for sending it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputDecision {
    /// Offset in counts, without the bias (register value for an offset of zero). For a shared register: the gateway
    /// share (part of the value that the gateway adds).
    pub offset: Counts,
    /// Target that the offset approaches. `None` for a constant, and if the target is unknown.
    pub target: Option<Counts>,
    /// Time of the decision.
    pub at: Moment,
    /// Last moment at which a change may be sent.
    pub not_after: Moment,
    /// Mode in which the axis made the decision.
    pub mode: Mode,
}

/// Mode in which an axis makes a decision.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// The axis follows its model.
    #[default]
    Follow,
    /// The axis keeps its offset, so no change is requested.
    Hold,
    /// The axis carries out a fault action or a stop, returns to an earlier Cz (compensation value), or
    /// writes a constant.
    Finish,
}

/// State of an interlock, which is a condition in the profile under which an output may be written.
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

/// Input of the controller of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Input {
    /// The turn of the output begins: the task of the bus line works on this output until [`Input::TurnEnds`].
    Demand(Demand),
    /// Event of the register, its axis or its device.
    Fact(Fact),
    /// The write was not sent, for the given reason.
    NotSent(NotSent),
    /// The state of the output is now saved on disk. [`Fact::Kept`] means instead that nothing needs to be saved.
    OnDisk,
    /// The value that the control applies was read from the control.
    Applied {
        /// Applied value in thousandths of a count of the register. `None` if the value is not a number.
        found: Option<i64>,
        /// Time at which the read request was sent.
        asked: Moment,
    },
    /// The read of the applied value was not answered.
    AppliedNoAnswer {
        /// Time at which the read request was sent.
        asked: Moment,
    },
    /// Whether the control has taken the last values of the set to which the output belongs.
    Set(SetCommit),
    /// The turn of the output (the work of the bus line's task on it) ends. Exchanges that are still pending are
    /// dropped.
    TurnEnds,
}

impl From<Fact> for Input {
    fn from(fact: Fact) -> Input {
        Input::Fact(fact)
    }
}

impl Input {
    /// Returns whether the input is the result of an exchange with the device or the disk.
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

/// Reason why no byte of a requested write was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NotSent {
    /// The last moment for sending the write had passed.
    TooLate,
    /// The device could not be reached.
    Unreachable,
    /// The gateway could not build a request for the write.
    Rejected,
    /// The bus line sends nothing to the device for a while (back-off), because the device did not answer.
    BacksOff,
}

/// Whether the control has taken the last values of a set of outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SetCommit {
    /// The control has taken the register values. Also the state of an output that is written alone.
    #[default]
    Taken,
    /// The control has perhaps not yet taken the register values. No other values are sent until it has taken them.
    Open,
    /// An attempt has failed: the control has not taken the values that were sent, or has perhaps not taken them.
    Failed,
}

shifted!(Demand: decision);
shifted!(OutputDecision: at, not_after);
