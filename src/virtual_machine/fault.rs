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

use isotherm_core::codec::Register;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_profile::DeviceId;

pub(super) mod can;
mod script;
#[cfg(test)]
mod tests;

pub use script::FaultError;

use can::CanFault;

/// The faults of one run, checked against a profile.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FaultScript {
    pub(super) faults: Vec<Fault>,
}

/// One fault of one device.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fault {
    pub(super) device: DeviceId,
    pub(super) at: Duration,
    pub(super) after: u64,
    pub(super) lasts: Lasts,
    pub(super) kind: Kind,
}

/// How long a fault lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lasts {
    Replies(u64),
    Time(Duration),
    Ever,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Kind {
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
pub(super) enum AcknowledgeFault {
    Never,
    Stuck,
    Late(Duration),
}

/// What a broken signal reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Reads {
    Raw(i64),
    Nan,
    Value(f64),
}

/// What can be wrong with an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ReplyFault {
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

impl ReplyFault {
    /// Whether it shows on such a request at all.
    fn concerns(self, is_write: bool) -> bool {
        match self {
            ReplyFault::ShortRead | ReplyFault::LongRead => !is_write,
            ReplyFault::WrongEcho | ReplyFault::IgnoredWrite => is_write,
            _ => true,
        }
    }
}

/// A script as it runs.
#[derive(Clone, Debug)]
pub(super) struct Faults {
    begin: Moment,
    running: Vec<Running>,
}

#[derive(Clone, Debug)]
struct Running {
    fault: Fault,
    begun: Option<Moment>,
    replies: u64,
    /// When it last made the device say something.
    said: Option<Moment>,
    /// The device has said that it is over.
    is_over: bool,
}

/// What a one-time fault does.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Incident {
    Register { device: DeviceId, address: Register, words: Vec<u16> },
    Restart { device: DeviceId },
}

impl Faults {
    pub(super) fn new(script: FaultScript, begin: Moment) -> Faults {
        let fresh = |fault| Running { fault, begun: None, replies: 0, said: None, is_over: false };
        Faults { begin, running: script.faults.into_iter().map(fresh).collect() }
    }

    /// Calls devices that are one piece of hardware by one name.
    pub(super) fn rename(&mut self, name: impl Fn(DeviceId) -> DeviceId) {
        for running in &mut self.running {
            running.fault.device = name(running.fault.device);
        }
    }

    /// Takes note of the time and of how many requests each device has had; gives the one-time faults that are due.
    pub(super) fn advance(&mut self, now: Moment, requests: impl Fn(DeviceId) -> u64) -> Vec<Incident> {
        let mut incidents = Vec::new();
        for running in &mut self.running {
            let fault = &running.fault;
            let due = now.since(self.begin) >= fault.at && requests(fault.device) > fault.after;
            let at_once = now.since(self.begin) >= fault.at && fault.after == 0;
            if running.begun.is_some() || !(due || at_once) {
                continue;
            }
            running.begun = Some(now);
            let device = fault.device;
            match &fault.kind {
                Kind::Register { address, words } => {
                    incidents.push(Incident::Register { device, address: *address, words: words.clone() });
                }
                Kind::Restart => incidents.push(Incident::Restart { device }),
                Kind::Reply(_) | Kind::Signal { .. } | Kind::Refuse | Kind::Acknowledge(_) | Kind::Can(_) => {
                }
            }
        }
        incidents
    }

    /// What is wrong with the answer to this request; counts it.
    pub(super) fn reply(&mut self, device: DeviceId, is_write: bool, now: Moment) -> Option<ReplyFault> {
        self.running.iter_mut().find_map(|running| match running.fault.kind {
            Kind::Reply(fault)
                if running.fault.device == device && fault.concerns(is_write) && running.is_active(now) =>
            {
                running.replies += 1;
                Some(fault)
            }
            _ => None,
        })
    }

    /// What the device's broken signals read now.
    pub(super) fn signals(&self, device: DeviceId, now: Moment) -> impl Iterator<Item = (SignalId, Reads)> {
        self.running
            .iter()
            .filter(move |running| running.fault.device == device && running.is_active(now))
            .filter_map(|running| match running.fault.kind {
                Kind::Signal { signal, reads } => Some((signal, reads)),
                _ => None,
            })
    }

    /// One more request was answered while these signals were broken.
    pub(super) fn count_signals(&mut self, device: DeviceId, now: Moment) {
        for running in &mut self.running {
            let concerns =
                matches!(running.fault.kind, Kind::Signal { .. }) && running.fault.device == device;
            if concerns && running.is_active(now) {
                running.replies += 1;
            }
        }
    }

    /// What is wrong with the device's acknowledges now.
    pub(super) fn acknowledges(&self, device: DeviceId, now: Moment) -> Option<AcknowledgeFault> {
        let mut active = self.running.iter().filter(|running| running.fault.device == device);
        active.find_map(|running| match running.fault.kind {
            Kind::Acknowledge(fault) if running.is_active(now) => Some(fault),
            _ => None,
        })
    }

    /// The devices whose listener is closed now.
    pub(super) fn refused(&self, now: Moment) -> impl Iterator<Item = DeviceId> {
        self.running
            .iter()
            .filter(move |running| running.fault.kind == Kind::Refuse && running.is_active(now))
            .map(|running| running.fault.device)
    }
}

impl Running {
    fn is_active(&self, now: Moment) -> bool {
        let Some(begun) = self.begun else { return false };
        match self.fault.lasts {
            Lasts::Replies(count) => self.replies < count,
            Lasts::Time(span) => now.since(begun) < span,
            Lasts::Ever => true,
        }
    }
}
