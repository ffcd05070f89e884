//! Faults, by a script: "from two hours on, for twenty replies, the thermocouples are silent; then normal."
//!
//! ```toml
//! [[fault]]
//! device = "thermocouples"
//! kind = "silent"
//! at = "2h"          # machine time since the virtual machine began      both optional, both must have come;
//! after = 100        # requests to that device                           without either: at once
//! for = 20           # replies that are faulty, or …                     without either: for ever
//! # for_time = "10min"
//! ```
//!
//! What each kind does, on Modbus and on CAN, and its further keys: `docs/virtual.md`.

use std::time::Duration;

use isotherm_core::codec::{CanId, Register};
use isotherm_core::reading::SignalId;
use isotherm_profile::DeviceId;

mod running;
mod script;
#[cfg(test)]
mod tests;

pub(crate) use running::{Faults, Utterance};
pub use script::FaultError;

/// The faults of one run, checked against a profile.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FaultScript {
    faults: Vec<Fault>,
}

/// One fault of one device.
#[derive(Clone, Debug, PartialEq)]
struct Fault {
    device: DeviceId,
    at: Duration,
    after: u64,
    lasts: Lasts,
    kind: Kind,
}

/// How long a fault lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lasts {
    Replies(u64),
    Time(Duration),
    Ever,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Kind {
    /// Something is wrong with the answers.
    Reply(ReplyFault),
    /// Something is wrong with what is measured.
    Signal { signal: SignalId, reads: Reads },
    /// The listener is closed.
    Refuse,
    /// Somebody else writes.
    Register { address: Register, words: Vec<u16> },
    /// All that was written is forgotten.
    Restart,
    /// Something is wrong with its handshakes.
    Acknowledge(AcknowledgeFault),
    /// Something of CAN's own is wrong.
    Can(CanFault),
}

/// What can be wrong with an acknowledge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AcknowledgeFault {
    Never,
    Stuck,
    Late(Duration),
    /// It comes only for a set with the number after the last one that the control took, and no other set is taken.
    NextNumber,
}

/// What a broken signal reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Reads {
    Raw(i64),
    Nan,
    Value(f64),
}

/// What can be wrong with an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ReplyFault {
    Silent,
    Late(Duration),
    Exception(u8),
    Close,
    HalfOpen,
    Garbage,
    WrongUnit,
    WrongTransaction,
    WrongChecksum,
    OneByteAtATime,
    WrongFunction,
    ShortRead,
    LongRead,
    WrongEcho,
    IgnoredWrite,
    OneBehind {
        stale_transaction: bool,
    },
    /// A gateway in front of the unit gives up, with this code or silently, and stamps the late answer with the open transaction.
    Shift {
        delay: Duration,
        code: Option<u8>,
    },
    /// A gateway in front of the unit gives up once, with this code or silently, and keeps the late answer. Each question after that
    /// gets what is kept, and its own answer is kept in turn.
    Keep {
        delay: Duration,
        code: Option<u8>,
    },
}

/// What can be wrong with a device on a CAN line beside what can be wrong with any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CanFault {
    /// Its frames end before the last byte that is needed.
    ShortFrame,
    /// SDO requests are refused with this code.
    Refusal(u32),
    /// SDO answers name another index.
    WrongIndex,
    /// It sends frames that nobody has asked for.
    Babbling { id: CanId, every: Duration },
    /// It complains, and says so when that is over.
    Emergency(u16),
    /// Its controller has trouble with the bus; once, or again and again.
    Errors { error: BusError, every: Option<Duration> },
}

/// What a controller says of the bus: class and data of an error frame (linux/can/error.h).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BusError {
    pub(crate) class: u32,
    pub(crate) data: [u8; 8],
}

impl BusError {
    /// Each with its word in a script.
    const ALL: [(&'static str, BusError); 6] = [
        ("no-acknowledge", BusError { class: 0x020, data: [0; 8] }),
        ("stuff", BusError { class: 0x088, data: [0, 0, 0x04, 0, 0, 0, 0, 0] }),
        ("warning", BusError { class: 0x204, data: [0, 0x08, 0, 0, 0, 0, 97, 0] }),
        ("passive", BusError { class: 0x204, data: [0, 0x20, 0, 0, 0, 0, 128, 0] }),
        ("bus-off", BusError { class: 0x040, data: [0; 8] }),
        ("restarted", BusError { class: 0x100, data: [0; 8] }),
    ];

    /// The one of this word.
    pub(crate) fn named(name: &str) -> Option<BusError> {
        BusError::ALL.iter().find(|(known, _)| *known == name).map(|(_, error)| *error)
    }
}
