//! Input of a controller: the demand of the axis, and the results of exchanges.

use serde::{Deserialize, Serialize};

use super::{Fact, Who};
use crate::quantity::{Counts, Moment, shifted};

/// Demand on one output: what its axis, its interlock and the operator require now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Demand {
    /// Who armed the axis. `None` if the axis is off, and in a dry run.
    pub armed: Option<Who>,
    /// Condition of the interlock.
    pub interlock: Condition,
    /// Newest decision of the axis. `None` if the axis is off, or has not yet resumed from the register value.
    pub decision: Option<Demanded>,
    /// Restarts of the control so far.
    pub restarts: u64,
    /// Pauses of the computer so far.
    pub pauses: u64,
}

/// Decision of an axis about one output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Demanded {
    /// Counts from the bias, or the gateway share of a shared register.
    pub offset: Counts,
    /// Target of the offset. `None` if it is not known, and for a constant.
    pub target: Option<Counts>,
    /// When the axis decided.
    pub at: Moment,
    /// When a change must have left at the latest.
    pub not_after: Moment,
    /// Mode of the axis.
    pub mode: Mode,
}

/// Mode of an axis that decides.
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
    /// The interlock allows writing. So does an output without an interlock.
    Met,
    /// The interlock does not allow writing.
    NotMet,
    /// Its signal is not known.
    Unknown,
}

/// Input of a controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Input {
    /// The turn of the output begins.
    Demand(Demand),
    /// A fact of the register.
    Fact(Fact),
    /// The write has not left, for this reason.
    NotSent(NotSent),
    /// The promise is on disk. [`Fact::Kept`] says that it need not be.
    OnDisk,
    /// The control said what it applies.
    Applied {
        /// Thousandths of a count of the register. `None` if the value is no number.
        found: Option<i64>,
        /// When the read was asked.
        asked: Moment,
    },
    /// The read of what the control applies was not answered.
    AppliedNoAnswer {
        /// When the read was asked.
        asked: Moment,
    },
    /// The control has taken the set of the output, or has not.
    Set(SetCommit),
    /// The turn of the output ends. What was begun in it is given up.
    TurnEnds,
}

impl From<Fact> for Input {
    fn from(fact: Fact) -> Input {
        Input::Fact(fact)
    }
}

impl Input {
    /// Returns whether this is the result of an exchange.
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

/// Why a write has not left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NotSent {
    /// Its last moment had passed.
    TooLate,
    /// The device could not be reached.
    Unreachable,
    /// The request cannot be made.
    Rejected,
    /// The line backs off from the device.
    BacksOff,
}

/// Result of the set that an output belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SetCommit {
    /// The control has taken what its registers hold. So has a control without a set.
    #[default]
    Taken,
    /// The control may not have taken what its registers hold: nothing else is sent.
    Open,
    /// The control has not taken what was sent.
    Failed,
}

shifted!(Demand: decision);
shifted!(Demanded: at, not_after);
