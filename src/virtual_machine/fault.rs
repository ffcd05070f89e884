//! Faults by a script, for example: "From two hours on, the thermocouples do not answer twenty times; then they work
//! again."
//!
//! ```toml
//! [[fault]]
//! device = "thermocouples"
//! kind = "silent"
//! at = "2h"          # machine time since the start of the virtual machine     optional; the fault begins after both,
//! after = 100        # requests to that device                                 and without both at once
//! for = 20           # faulty replies, or …                                    without either: forever
//! # for_time = "10min"
//! ```
//!
//! `docs/virtual.md` describes the effect of each kind on Modbus and on CAN, and its further keys.

use std::time::Duration;

use isotherm_core::codec::{CanId, Register};
use isotherm_core::reading::SignalId;
use isotherm_profile::DeviceId;

mod running;
mod script;
#[cfg(test)]
mod tests;

pub(crate) use running::{FaultFrame, Faults};
pub use script::FaultError;

/// Faults of one run, checked against a profile.
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
    lasts: FaultDuration,
    kind: Kind,
}

/// Duration of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FaultDuration {
    Replies(u64),
    Time(Duration),
    Ever,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Kind {
    /// Wrong answers.
    Reply(ReplyFault),
    /// Wrong values of a signal.
    Signal { signal: SignalId, reads: Reads },
    /// The listener is closed.
    Refuse,
    /// Another client writes.
    Register { address: Register, words: Vec<u16> },
    /// The device restarts, and loses everything that was written.
    Restart,
    /// Wrong handshakes.
    Acknowledge(AcknowledgeFault),
    /// A fault that exists only on CAN.
    Can(CanFault),
}

/// Faults of an acknowledge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AcknowledgeFault {
    Never,
    Stuck,
    Late(Duration),
    /// The acknowledge comes only if the set has the number after the last one that the control took. No other set is
    /// taken.
    NextNumber,
}

/// Value of a broken signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Reads {
    Raw(i64),
    Nan,
    Value(f64),
}

/// Faults of an answer.
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
    /// A Modbus gateway before the unit times out, with this code or silently. It sends the late answer with the
    /// transaction of the open request.
    Shift {
        delay: Duration,
        code: Option<u8>,
    },
    /// A Modbus gateway before the unit times out once, with this code or silently, and keeps the late answer. Each
    /// later request gets the kept answer, and its own answer is kept in turn.
    Keep {
        delay: Duration,
        code: Option<u8>,
    },
}

/// Faults that only devices on a CAN line can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CanFault {
    /// Frames end before the last byte that is needed.
    ShortFrame,
    /// SDO requests are aborted with this code.
    Refusal(u32),
    /// SDO answers name another index.
    WrongIndex,
    /// The device sends frames that were not requested.
    Babbling { id: CanId, every: Duration },
    /// The device sends an emergency, and reports its end.
    Emergency(u16),
    /// The controller reports bus errors, once or repeatedly.
    Errors { error: BusError, every: Option<Duration> },
}

/// Bus error of a controller: class and data of an error frame (linux/can/error.h).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BusError {
    pub(crate) class: u32,
    pub(crate) data: [u8; 8],
}

impl BusError {
    /// All bus errors with their names in a script.
    const ALL: [(&'static str, BusError); 6] = [
        ("no-acknowledge", BusError { class: 0x020, data: [0; 8] }),
        ("stuff", BusError { class: 0x088, data: [0, 0, 0x04, 0, 0, 0, 0, 0] }),
        ("warning", BusError { class: 0x204, data: [0, 0x08, 0, 0, 0, 0, 97, 0] }),
        ("passive", BusError { class: 0x204, data: [0, 0x20, 0, 0, 0, 0, 128, 0] }),
        ("bus-off", BusError { class: 0x040, data: [0; 8] }),
        ("restarted", BusError { class: 0x100, data: [0; 8] }),
    ];

    /// Finds the bus error with this name.
    pub(crate) fn named(name: &str) -> Option<BusError> {
        BusError::ALL.iter().find(|(known, _)| *known == name).map(|(_, error)| *error)
    }
}
