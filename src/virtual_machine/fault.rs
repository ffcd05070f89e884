//! Faults by a script, for example: "After two hours, the device `thermocouples` does not answer twenty requests; then
//! it works again."
//!
//! ```toml
//! [[fault]]
//! device = "thermocouples"
//! kind = "silent"
//! at = "2h"          # optional: time since the start of the virtual machine
//! after = 100        # optional: number of requests to the device
//! for = 20           # optional: number of faulty replies
//! # for_time = "10min"   # instead of `for`: duration of the fault
//! ```
//!
//! If both `at` and `after` are given, the fault begins when both conditions are met. If neither is given,
//! the fault begins at the start. Without `for` and `for_time`, the fault never ends.
//!
//! `docs/virtual.md` describes each kind of fault, its effect on each kind of line, and its further keys.

use std::time::Duration;

use isotherm_core::codec::{CanId, Register};
use isotherm_core::reading::{SignalId, Status};
use isotherm_profile::DeviceId;

mod running;
mod script;
#[cfg(test)]
mod tests;

pub(crate) use running::{FaultFrame, Faults};
pub use script::FaultError;

/// Faults of one run, which were checked against a profile.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FaultScript {
    faults: Vec<Fault>,
}

/// One fault of one device: its kind, its start and its end.
#[derive(Clone, Debug, PartialEq)]
struct Fault {
    device: DeviceId,
    at: Duration,
    after: u64,
    lasts: FaultDuration,
    kind: Kind,
}

/// End of a fault: after a number of faulty replies, after a time, or never.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FaultDuration {
    Replies(u64),
    Time(Duration),
    Ever,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Kind {
    /// The device sends wrong answers.
    Reply(ReplyFault),
    /// A signal has wrong values.
    Signal { signal: SignalId, reads: Reads },
    /// The listener of the device is closed, so that clients cannot connect.
    Refuse,
    /// Another client writes these values to the device, from this register on.
    Register { address: Register, words: Vec<u16> },
    /// The device restarts, and loses everything that was written to it.
    Restart,
    /// The control acknowledges a handshake in a wrong way.
    Acknowledge(AcknowledgeFault),
    /// Fault that exists only on a CAN line.
    Can(CanFault),
    /// The OPC UA node of a signal contains a status or a text instead of its number.
    Node { signal: SignalId, fault: NodeFault },
}

/// Wrong content of a node of an OPC UA server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NodeFault {
    /// The node has this status, and no value.
    Status(Status),
    /// The node holds its number as text.
    Text,
}

/// Wrong behaviour of a control in a handshake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AcknowledgeFault {
    Never,
    Stuck,
    Late(Duration),
    /// The control acknowledges only if the sequence number follows the last accepted one. It accepts no other values.
    NextNumber,
}

/// Value that a broken signal shows: a raw register value, not-a-number, or a value in the unit of the signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Reads {
    Raw(i64),
    Nan,
    Value(f64),
}

/// Fault of an answer: how it differs from the correct answer, or what is sent instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ReplyFault {
    Silent,
    Late(Duration),
    Exception(u8),
    /// An OPC UA server does not execute the call, and answers with this status for each node.
    Status(Status),
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
    /// A Modbus gateway in front of the unit times out, and answers with this exception code or not at all. It sends
    /// the late answer with the transaction number of the request that is open then.
    Shift {
        delay: Duration,
        code: Option<u8>,
    },
    /// A Modbus gateway in front of the unit times out once, answers with this exception code or not at all, and keeps
    /// the late answer. Each later request gets the kept answer, and its own answer is kept instead.
    Keep {
        delay: Duration,
        code: Option<u8>,
    },
}

/// Fault that only devices on a CAN line can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CanFault {
    /// The device sends frames that are one byte too short for their values.
    ShortFrame,
    /// The device aborts SDO requests with this code.
    Refusal(u32),
    /// The device's SDO answers name another index than the request.
    WrongIndex,
    /// The device sends additional frames with random data and this identifier periodically.
    Babbling { id: CanId, every: Duration },
    /// The device sends an emergency message with this code, and later reports the end of the error.
    Emergency(u16),
    /// The CAN controller reports a bus error, once or repeatedly.
    Errors { error: BusError, every: Option<Duration> },
}

/// Bus error that a CAN controller reports: class and data of an error frame (linux/can/error.h).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BusError {
    pub(crate) class: u32,
    pub(crate) data: [u8; 8],
}

impl BusError {
    /// All bus errors with the names that a script uses.
    const ALL: [(&'static str, BusError); 6] = [
        ("no-acknowledge", BusError { class: 0x020, data: [0; 8] }),
        ("stuff", BusError { class: 0x088, data: [0, 0, 0x04, 0, 0, 0, 0, 0] }),
        ("warning", BusError { class: 0x204, data: [0, 0x08, 0, 0, 0, 0, 97, 0] }),
        ("passive", BusError { class: 0x204, data: [0, 0x20, 0, 0, 0, 0, 128, 0] }),
        ("bus-off", BusError { class: 0x040, data: [0; 8] }),
        ("restarted", BusError { class: 0x100, data: [0; 8] }),
    ];

    /// Returns the bus error with this name in a script; `None` for an unknown name.
    pub(crate) fn named(name: &str) -> Option<BusError> {
        BusError::ALL.iter().find(|(known, _)| *known == name).map(|(_, error)| *error)
    }
}
