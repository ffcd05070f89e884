//! Facts: the inputs of [`step`](super::step). A fact is something that has happened to a register, its axis or its
//! device.

use serde::{Deserialize, Serialize};

use crate::quantity::{Counts, Moment};

/// Input of [`step`](super::step): something that has happened to the register, its axis or its device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fact {
    /// No new event: [`step`](super::step) is called at the time that it requested.
    Look,
    /// The axis has decided which offset the register must contain.
    Decided {
        /// Offset in counts, without the bias (register value for an offset of zero). For a shared register: the
        /// gateway share (part of the value that the gateway adds).
        offset: Counts,
        /// Target of the offset: the value that the model, the fault action, the stop or the sign check requests. If it
        /// is `None`, the register may reach the offset from either side.
        target: Option<Counts>,
        /// Last moment at which a write of this offset may be sent.
        not_after: Moment,
    },
    /// A request with the values of other outputs is about to be sent. The register value of this output may be sent
    /// with it, unchanged.
    PiggybackAsked,
    /// The register value was sent unchanged, in one request with the values of other outputs.
    Piggybacked {
        /// Value that was sent.
        value: Counts,
        /// Time after the last byte of the write was sent.
        left: Moment,
        /// Whether the device answered that it has carried out the write. If not, the result is unknown.
        is_done: bool,
    },
    /// The register was read, on request or together with other registers.
    Read {
        /// Register value that was read.
        found: Counts,
        /// Time before the first byte of the request was sent.
        asked: Moment,
    },
    /// The device did not answer the read.
    NoAnswer,
    /// The device answered that it has carried out the write.
    Done {
        /// Time after the last byte of the request was sent.
        left: Moment,
    },
    /// The write was sent, but its result is unknown.
    Unknown {
        /// Time after the last byte of the request was sent.
        left: Moment,
    },
    /// The device answered that it did not carry out the write.
    Refused,
    /// No byte of the write was sent: the last moment for the write had passed, or there was no connection.
    NotSent,
    /// The state of the output ([`State::kept`](super::State::kept)) was saved to disk.
    Kept,
    /// The state of the output was not saved to disk, or the result is unknown.
    NotKept,
    /// A restart of the CNC was reported: by a boot counter, by the device, or because the machine was switched on.
    Restarted,
    /// The interlock opened: nothing may be written.
    Interlocked,
    /// The interlock closed again: the register may be written.
    Released,
    /// The output was armed. The caller gives this fact after the first read of the register.
    Armed {
        /// Whether the operator or the profile has armed the output.
        by: Who,
    },
    /// The output was disarmed. The register keeps its value.
    Off,
    /// The last decision must no longer be sent, for example because its last moment has passed.
    Lapsed,
    /// The computer was paused, so earlier decisions must not be sent. The caller gives this fact before the result of
    /// an exchange that was pending.
    Paused,
}

/// Operator or profile that has armed an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Who {
    /// The operator, who has seen the register value.
    Person,
    /// The profile, automatically. The profile cannot arm an output that waits for the operator.
    Policy,
}
