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
//! | kind | what happens | further keys |
//! |---|---|---|
//! | `silent` | the device does nothing and answers nothing; other units on its line live | |
//! | `late` | the answer comes late, in wall time | `delay` |
//! | `exception` | nothing is done and this code is answered | `code` |
//! | `close` | the request is carried out, then the connection is dropped unanswered; on a port: just unanswered | |
//! | `half-open` | the connection stays up and is never answered again; a new one is, or a port opened again | |
//! | `refuse` | the listener is closed, or the port unplugged, for every device on it, and comes back | only `at`, `after`, `for_time` |
//! | `garbage` | random bytes instead of an answer | |
//! | `wrong-unit` `wrong-transaction` `wrong-function` | the answer names another one | |
//! | `wrong-checksum` | a byte of the checksum is wrong; RTU lines only, as `wrong-transaction` is for TCP only | |
//! | `one-byte-at-a-time` | the answer comes in as many pieces as it has bytes | |
//! | `short-read` `long-read` | a read brings one register too few, too many | |
//! | `wrong-echo` | a write is carried out, but its echo names another value or count | |
//! | `ignored-write` | a write is echoed, but not carried out | |
//! | `one-behind` | each request gets the answer to the one before it, under its own transaction | |
//! | `one-behind-stale` | the same, under the transaction of the one before it | |
//! | `sentinel` | a signal reads this raw value; without `raw`, its first `bad` one | `signal`, `raw` |
//! | `nan` | a floating-point signal reads NaN | `signal` |
//! | `value` | a signal reads this engineering value | `signal`, `value` |
//! | `register` | somebody else writes these words, once | `register`, `words`; only `at`, `after` |
//! | `restart` | the device forgets all that was written to it, and counts that boot, once | only `at`, `after` |
//! | `no-acknowledge` | the acknowledge of its handshakes does not come | only `at`, `after`, `for_time` |
//! | `stuck-acknowledge` | an acknowledge that is up does not drop | the same |
//! | `late-acknowledge` | it comes this late | the same, `delay` |
//!
//! On a CAN line a device can be `silent` (it sends and hears nothing), `late` (its SDO answers are), send `garbage` (in
//! its frames of measured values), confirm what it does not do (`ignored-write`: SDO and RPDO) and `restart` (a node
//! reset: it boots up again); its signals can break in the three ways; and
//!
//! | kind | what happens | further keys |
//! |---|---|---|
//! | `short-frame` | its frames of measured values lack the last byte that is needed | |
//! | `babbling` | it sends random bytes beside its own frames | `id`, `every`: 0x7FF each millisecond |
//! | `emergency` | EMCY with this code; when it is over, with 0000h | `code`; only `at`, `after`, `for_time` |
//! | `error-frame` | its controller reports trouble, once, or again and again | `error`; `every` with `for`, `for_time` |
//! | `sdo-abort` | SDO requests are refused | `code`: 0x08000000 |
//! | `wrong-index` | SDO answers name another index | |
//!
//! `for` counts frames there. `error` is one of `no-acknowledge`, `stuff`, `warning`, `passive`, `bus-off`, `restarted`.

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
    OneBehind { stale_transaction: bool },
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
