//! What happened to an output, for people.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::follow::Cause;
use crate::quantity::{Counts, Moment};

/// Something that happened. Values are counts of the register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Event {
    /// A write whose answer never came has arrived.
    OwnWriteArrivedLate {
        /// What it put there.
        value: Counts,
        /// When it was sent.
        sent: Moment,
    },
    /// What appeared may be our own from before the start: it is taken over.
    PerhapsFromBefore {
        /// What stands there.
        value: Counts,
    },
    /// The operator changed his part of a shared register.
    OperatorChanged {
        /// His part before.
        from: Counts,
        /// His part now.
        to: Counts,
    },
    /// The register fell to zero: the CNC was restarted, or somebody cleared it.
    CncRestarted {
        /// What stood there before.
        stood: Counts,
    },
    /// Somebody else wrote to a register that is ours alone: the axis is off.
    ForeignValue {
        /// What should have stood there.
        expected: Counts,
        /// What does.
        found: Counts,
    },
    /// Operator offset and gateway share of a register cannot be known. The axis is off until the operator confirms.
    Doubted {
        /// Why.
        doubt: Doubt,
        /// What stands there.
        found: Counts,
        /// What of it is taken to be ours.
        share: Counts,
    },
    /// A shared register that was never ours before is not zero: a person confirms that all of it is the operator's.
    FirstAccount {
        /// What stands there.
        found: Counts,
    },
    /// A write was acknowledged, and what stood there before still does.
    NotTaken {
        /// What was written.
        wrote: Counts,
        /// What stands there.
        found: Counts,
    },
    /// A late write may still arrive, and the next change would be too far from it.
    WaitingForLateWrite {
        /// For so long at most.
        seconds: u64,
    },
    /// The device acknowledges what is written, and nobody reads it back.
    AcknowledgedNotReadBack,
    /// The device refused a write.
    WriteRefused {
        /// What it was.
        value: Counts,
    },
    /// What must be on disk before anything is sent cannot be kept there.
    DiskDoesNotKeep,
    /// The decision of the axis is beyond the range of the register.
    Saturated {
        /// Register value that was decided.
        value: Counts,
    },
    /// The interlock does not allow writing.
    Interlocked,
    /// The interlock allows writing again.
    Released,
    /// The turn came too late for the last decision.
    Late {
        /// Last moment of the decision.
        not_after: Moment,
    },
    /// The axis is to resume from the verified value.
    TakeOver {
        /// Why.
        cause: Cause,
    },
    /// A write is verified.
    Written,
    /// A write or a set was not taken, or still is not.
    StillUntaken,
    /// The register holds what it should, and can be written again.
    Recovered {
        /// The register had not held what was written at the end of an earlier turn.
        was_untaken: bool,
    },
    /// The control does not apply the register value in its time.
    NotApplied,
    /// The division of a shared register is known and on disk.
    Opened {
        /// Operator offset.
        base: Counts,
        /// Gateway share.
        share: Counts,
    },
    /// Only the operator can say how the register value divides. The axis is off.
    Question,
}

impl Event {
    /// It switches the axis off until a person arms it.
    pub fn switches_off(self) -> bool {
        matches!(self, Event::ForeignValue { .. } | Event::Doubted { .. } | Event::FirstAccount { .. })
    }
}

/// Why the account of a shared register is not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Doubt {
    /// The register was changed while a write was under way.
    ChangedMeanwhile,
    /// What stands there is the operator's change, or a write of ours that came very late.
    YoursOrOurs,
    /// It fell to zero, which is also what a write of ours would have made of it.
    ZeroOrOurs,
    /// The CNC was restarted, and something else stands there since.
    Rebooted,
    /// Twice in a row an unanswered write was followed by a change of just its size.
    LikeOurOwn,
    /// Twice in a row something else stood there than was written and acknowledged.
    Unsteady,
    /// Somebody else has made as many small changes as we, each soon after ours.
    SecondGateway,
    /// It changed while a person armed the axis.
    ChangedWhileArming,
    /// The ledger cannot be read.
    Unreadable,
    /// An offset was written before, and there is no ledger of it.
    Lost,
    /// The ledger speaks of another register, or of counts of another worth.
    Elsewhere,
    /// The ledger was put back from a backup.
    Restored,
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Doubt::ChangedMeanwhile => "somebody changed the register while a write was under way",
            Doubt::YoursOrOurs => "it is your change, or a write of ours that came very late",
            Doubt::ZeroOrOurs => "the CNC was restarted, or a write of ours made it zero",
            Doubt::Rebooted => "the CNC was restarted, and something else stands in its register since",
            Doubt::LikeOurOwn => "twice an unanswered write was followed by a change of just its size",
            Doubt::Unsteady => {
                "what is written does not stay, twice in a row something else stood there: the control cuts it, or a second \
                 gateway writes to it"
            }
            Doubt::SecondGateway => "it is changed as often as we change it, by as little, at the same time: a second gateway writes to it",
            Doubt::ChangedWhileArming => "the register changed while the axis was being armed",
            Doubt::Unreadable => "the ledger cannot be read",
            Doubt::Lost => "an offset was written before, and there is no ledger of it",
            Doubt::Restored => {
                "the ledger is that of a backup, and something else may have been written since"
            }
            Doubt::Elsewhere => "the ledger speaks of another register, or of counts of another worth",
        })
    }
}
