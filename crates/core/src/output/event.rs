//! Events of an output, for messages. The value of a shared register has two parts: the operator offset and the gateway
//! share.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::follow::Cause;
use crate::quantity::{Counts, Moment};

/// Event of an output. Values are counts of the register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Event {
    /// A write without an answer has arrived late.
    OwnWriteArrivedLate {
        /// Register value that the late write has set.
        value: Counts,
        /// Time at which the gateway sent the write.
        sent: Moment,
    },
    /// The register value may be from a write before the start. The axis resumes from this value.
    PerhapsFromBefore {
        /// Register value that was read, perhaps from a write before the start.
        value: Counts,
    },
    /// The operator changed the operator offset in a shared register.
    OperatorChanged {
        /// Operator offset (part of the value that the operator entered) before the change.
        from: Counts,
        /// Operator offset after the change.
        to: Counts,
    },
    /// The register fell to zero: the CNC was restarted, or another client cleared the register.
    CncRestarted {
        /// Register value before the change.
        stood: Counts,
    },
    /// Another client wrote to a register that belongs to the gateway. The axis is off.
    ForeignValue {
        /// Value that the gateway expected in the register.
        expected: Counts,
        /// Register value that was read instead of the expected one.
        found: Counts,
    },
    /// The two parts of a shared register's value (operator offset and gateway share) cannot be determined. The axis is
    /// off until the operator confirms.
    Doubted {
        /// Reason why operator offset and gateway share are not certain.
        doubt: Doubt,
        /// Register value that was read.
        found: Counts,
        /// Gateway share (part of the value that the gateway added) that is assumed until the operator confirms it.
        share: Counts,
    },
    /// A shared register is not zero when the gateway first uses it. The operator must confirm that all of it is the
    /// operator offset.
    FirstAccount {
        /// Register value that was read. If the operator confirms it, all of it is the operator offset.
        found: Counts,
    },
    /// A write was acknowledged, but the register still holds the earlier value.
    NotTaken {
        /// Value that the gateway wrote.
        wrote: Counts,
        /// Register value that was read after the write.
        found: Counts,
    },
    /// A late write may still arrive, and the next change would be too far from the value of that write.
    WaitingForLateWrite {
        /// Longest time for which the next change can wait for that write, s.
        seconds: u64,
    },
    /// The device acknowledges writes, but the register is not read back.
    AcknowledgedNotReadBack,
    /// The device refused a write.
    WriteRefused {
        /// Value that the gateway tried to write.
        value: Counts,
    },
    /// The state of the output cannot be saved to disk, and nothing may be sent before it is saved.
    DiskDoesNotKeep,
    /// The decision of the axis exceeds the range of the register.
    Saturated {
        /// Register value that was decided.
        value: Counts,
    },
    /// The interlock does not allow writing.
    Interlocked,
    /// The interlock allows writing again.
    Released,
    /// The turn of the output (the work of the bus line's task on it) came too late for the last decision.
    Late {
        /// Last moment at which the decision could have been sent.
        not_after: Moment,
    },
    /// The axis resumes from the verified register value instead of its last decision.
    TakeOver {
        /// Reason why the axis resumes from the register value.
        cause: Cause,
    },
    /// A write is verified: a read showed the written value, or the device acknowledged the write.
    Written,
    /// The device did not take a written value, or the control did not take a set of outputs. Each failed attempt is
    /// reported.
    StillUntaken,
    /// The register holds the expected value, and can be written again.
    Recovered {
        /// Whether the register did not hold the written value at the end of an earlier turn of the output.
        was_untaken: bool,
    },
    /// The control has not applied the register value in time.
    NotApplied,
    /// The two parts of a shared register's value (operator offset and gateway share) are known and saved on disk.
    Opened {
        /// Operator offset (part of the value that the operator entered), as it was recorded.
        base: Counts,
        /// Gateway share (part of the value that the gateway added), as it was recorded.
        share: Counts,
    },
    /// Only the operator can say which part of the register value is the operator offset. The axis is off until the
    /// operator has confirmed it.
    Question,
}

impl Event {
    /// Returns whether the event disarms the axis until the operator arms it.
    pub fn switches_off(self) -> bool {
        matches!(self, Event::ForeignValue { .. } | Event::Doubted { .. } | Event::FirstAccount { .. })
    }
}

/// Reason why the operator offset and the gateway share of a shared register are uncertain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Doubt {
    /// The register changed while a write of the gateway was under way.
    ChangedMeanwhile,
    /// The register value was set by the operator, or by a very late write of the gateway.
    YoursOrOurs,
    /// The register fell to zero: the CNC was restarted, or a write of the gateway has arrived.
    ZeroOrOurs,
    /// The CNC was restarted, and the register then held neither zero nor the expected value.
    Rebooted,
    /// Twice in a row, a write was not acknowledged, and the register then changed by exactly the difference
    /// that the write should have caused.
    LikeOurOwn,
    /// Twice in a row, the register held another value than the gateway had written and the device had acknowledged.
    Unsteady,
    /// Another client has made as many small changes as the gateway, each soon after a change of the gateway.
    SecondGateway,
    /// The register changed while the operator armed the axis.
    ChangedWhileArming,
    /// The register ledger on disk cannot be read. The ledger contains the two parts of each shared register's value.
    Unreadable,
    /// An offset was written before, but the register ledger on disk is missing. The ledger contains the two parts of
    /// each shared register's value.
    Lost,
    /// The saved entry in the register ledger is for another register, or for counts of another size.
    Elsewhere,
    /// The register ledger on disk was restored from a backup. The ledger contains the two parts of each shared
    /// register's value.
    Restored,
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Doubt::ChangedMeanwhile => "the register changed while a write of the gateway was under way",
            Doubt::YoursOrOurs => {
                "the register changed: either the operator wrote to it, or a very late write of the gateway \
                 arrived"
            }
            Doubt::ZeroOrOurs => {
                "the register is zero: either the CNC was restarted, or the gateway wrote this value"
            }
            Doubt::Rebooted => "the CNC was restarted, and the register has an unexpected value",
            Doubt::LikeOurOwn => {
                "twice in a row, a write was not acknowledged, and then the register changed by exactly the \
                 amount of the write"
            }
            Doubt::Unsteady => {
                "twice in a row, the register did not hold the written value: the control limits the value, \
                 or a second gateway writes to the register"
            }
            Doubt::SecondGateway => {
                "after each write of the gateway, the register changes again by a similar amount: a second \
                 gateway writes to it"
            }
            Doubt::ChangedWhileArming => "the register changed while the axis was being armed",
            Doubt::Unreadable => "the register ledger on disk cannot be read",
            Doubt::Lost => "an offset was written before, but the register ledger on disk is missing",
            Doubt::Restored => {
                "the register ledger is from a backup, and later writes may be missing from it"
            }
            Doubt::Elsewhere => "the entry in the register ledger is for another register, type or scale",
        })
    }
}
