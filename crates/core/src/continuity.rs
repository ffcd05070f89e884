//! Continuity of devices: whether answers still come from the device that passed its checks, with the same settings.
//!
//! An address and a name do not identify a device. After contact was lost, another module or control may answer at the
//! address, or the same device with other settings. Each event after which this is possible is a break of the device's
//! continuity. [`DeviceContinuity::breaks`] records a break, and [`DeviceContinuity::verified`] the result of new
//! checks.
//!
//! | state | event | next state |
//! |---|---|---|
//! | any | all checks pass, read after the last break | Confirmed |
//! | any | a check finds a difference | Changed |
//! | Confirmed | contact is lost | Unconfirmed |
//! | Unconfirmed, Changed | contact is lost | unchanged |
//!
//! While a device is not [`Continuity::Confirmed`], its new readings are not used, and the gateway writes nothing to
//! it. Its last good readings remain valid until their `max_age`. A device without checks has nothing that identifies
//! it, and stays confirmed. Its breaks are counted: [`RateFilter`] compares the first value after a break with the last
//! value before the break.

use std::fmt;
use std::time::Duration;

use crate::quantity::Moment;

mod rate;

pub use rate::{RateFault, RateFilter};

/// Smallest number of consecutive requests without an answer that counts as a break of continuity. A single lost answer
/// is not a break.
const SILENT_REQUESTS: u32 = 2;
/// Shortest time without an answer that counts as a break of continuity, in poll periods.
const SILENT_PERIODS: u32 = 2;

/// State of a device: whether the device that answers is still the device that passed its checks, with
/// unchanged settings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Continuity {
    /// The device has no checks, or it has passed them and contact with it has not been lost since.
    Confirmed,
    /// Contact was lost, or the gateway has just started. The next exchange with the device reads the values of its
    /// checks.
    Unconfirmed {
        /// Time of the first break of continuity since the device was confirmed.
        since: Moment,
        /// Cause of the first break of continuity since the device was confirmed.
        cause: Break,
    },
    /// At least one check of the device found a difference. The list of differences is never empty.
    Changed(Vec<Difference>),
}

/// Cause of a break of continuity, after which another device may answer, or the same device with other settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Break {
    /// The gateway has just started.
    Start,
    /// The device refused a connection.
    Refused,
    /// A connection was reset, or closed without an answer.
    ConnectionLost,
    /// A new connection does not resume the last connection: a server has discarded the session, or a serial port has
    /// changed.
    NewConnection,
    /// The computer's interface to the bus went down.
    InterfaceDown,
    /// The device was restarted.
    Restarted,
    /// The machine was switched on, so the device may have been switched on or restarted too.
    MachineOn,
    /// The computer was paused or overloaded for too long.
    Pause,
    /// The device did not answer for two poll periods.
    Silence,
}

/// Check of a device with an unexpected result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Register, object or node that was checked, for example `holding:90 (40091)`.
    pub what: String,
    /// Value that the profile expects.
    pub was: String,
    /// Value that was found, or the reason why no value can be read.
    pub is: CheckFailure,
    /// Meaning of the checked value, for messages.
    pub meaning: String,
    /// Remedy that the profile gives for the difference; may be empty.
    pub remedy: String,
}

/// Result of a check that did not pass.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CheckFailure {
    /// The check read another value than expected, given as text.
    Value(String),
    /// The check read no value: the device answered that it has no such register. Contains the reason that the device
    /// gave.
    Absent(String),
    /// The check read no value, for a reason that does not show whether the device has the register.
    Unreadable(String),
    /// Any other result, as a complete sentence.
    Described(String),
}

/// Means by which the gateway recognises a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Identity {
    /// The device has no checks, so nothing identifies it.
    None,
    /// The device has checks: values in the device that must equal the values in the profile.
    Checks,
}

/// Continuity of one device: its state, its breaks, and the answers from which silence is detected.
#[derive(Clone, Debug)]
pub struct DeviceContinuity {
    identity: Identity,
    /// Time without an answer that counts as a break of continuity.
    silence: Duration,
    state: Continuity,
    /// Number of breaks of the device's continuity since the gateway started.
    breaks: u64,
    /// Number of breaks of continuity when the checks last passed. `None` if the checks have not passed yet.
    passed_after: Option<u64>,
    /// Number of breaks of continuity that may have reset the settings of the device. A pause of the computer and a
    /// machine start do not count.
    resets: u64,
    /// Time of the last answer of the device, also of an answer that refuses a request.
    answered: Moment,
    /// Time of the last answer with the requested data.
    delivered: Moment,
    /// Number of requests without an answer since the last answer.
    missed: u32,
    /// Whether the device does not answer, and this silence has already been recorded as a break of continuity.
    is_silent: bool,
}

impl DeviceContinuity {
    /// Creates the state at the start of the gateway, for a device with this identity and poll period.
    pub fn new(identity: Identity, period: Duration, start: Moment) -> DeviceContinuity {
        let state = match identity {
            Identity::None => Continuity::Confirmed,
            Identity::Checks => Continuity::Unconfirmed { since: start, cause: Break::Start },
        };
        let silence = period.saturating_mul(SILENT_PERIODS);
        DeviceContinuity {
            identity,
            silence,
            state,
            breaks: 0,
            passed_after: None,
            resets: 0,
            answered: start,
            delivered: start,
            missed: 0,
            is_silent: false,
        }
    }

    /// Returns the state of the device: confirmed, unconfirmed or changed.
    pub fn state(&self) -> &Continuity {
        &self.state
    }

    /// Returns whether the gateway uses readings of the device and sends writes to it.
    pub fn is_confirmed(&self) -> bool {
        self.state == Continuity::Confirmed
    }

    /// Returns the number of breaks of the device's continuity since the gateway started. The result of a check that
    /// was read before the last break says nothing about the present device.
    pub fn breaks_so_far(&self) -> u64 {
        self.breaks
    }

    /// Returns whether the checks have passed, and continuity has not been broken since. If so, a check that
    /// finds another value means that settings were changed on the same device.
    pub fn has_lasted(&self) -> bool {
        self.passed_after == Some(self.breaks)
    }

    /// Returns the number of breaks of continuity that may have reset the settings of the device.
    pub fn resets_so_far(&self) -> u64 {
        self.resets
    }

    /// Returns the number of breaks of continuity that the [`RateFilter`] must consider. Zero for a device with checks,
    /// because the checks identify the device.
    pub fn breaks_without_checks(&self) -> u64 {
        match self.identity {
            Identity::None => self.breaks,
            Identity::Checks => 0,
        }
    }

    /// Returns the time of the last answer with the requested data.
    pub fn delivered_at(&self) -> Moment {
        self.delivered
    }

    /// Records a break of the device's continuity. An unconfirmed device keeps its first cause. A changed device stays
    /// changed until its checks pass.
    pub fn breaks(&mut self, cause: Break, now: Moment) {
        self.breaks += 1;
        self.resets += u64::from(!matches!(cause, Break::Pause | Break::MachineOn));
        if self.identity == Identity::Checks && self.is_confirmed() {
            self.state = Continuity::Unconfirmed { since: now, cause };
        }
    }

    /// Records the result of the checks: an empty list confirms the device. `after` is the number of breaks when the
    /// checks were read. Returns the former state; `None` if there was a break after the checks were read, so that they
    /// must be read again.
    pub fn verified(&mut self, after: u64, differences: Vec<Difference>) -> Option<Continuity> {
        if after != self.breaks {
            return None;
        }
        let state = match differences.is_empty() {
            true => {
                self.passed_after = Some(self.breaks);
                Continuity::Confirmed
            }
            false => Continuity::Changed(differences),
        };
        Some(std::mem::replace(&mut self.state, state))
    }

    /// Records a break if the device has not answered for too long. Call this function before each request and at each
    /// answer. One period without answers is one break. Does nothing for an unconfirmed device, which is checked in any
    /// case.
    pub fn notice_silence(&mut self, now: Moment) {
        let is_silent = self.missed >= SILENT_REQUESTS && now.since(self.answered) >= self.silence;
        if is_silent && self.is_confirmed() && !std::mem::replace(&mut self.is_silent, true) {
            self.breaks(Break::Silence, now);
        }
    }

    /// Records an answer of the device, also an answer that refuses the request.
    pub fn answers(&mut self, now: Moment) {
        self.notice_silence(now);
        (self.answered, self.missed, self.is_silent) = (now, 0, false);
    }

    /// Records an answer of the device with the requested data.
    pub fn delivers(&mut self, now: Moment) {
        self.answers(now);
        self.delivered = now;
    }

    /// Records a request without an answer. The period without answers is one break as soon as it contains two requests
    /// and lasts two poll periods.
    pub fn misses(&mut self, now: Moment) {
        self.missed = self.missed.saturating_add(1);
        let is_silent = self.missed >= SILENT_REQUESTS && now.since(self.answered) >= self.silence;
        if is_silent && !std::mem::replace(&mut self.is_silent, true) {
            self.breaks(Break::Silence, now);
        }
    }
}

impl Difference {
    /// Returns whether the check read a value that differs from the expected value.
    pub fn is_value(&self) -> bool {
        matches!(self.is, CheckFailure::Value(_))
    }

    /// Returns whether the difference proves that the device is another device or has other settings. That is the case
    /// if another value was read, or if the device has no such register.
    pub fn is_evidence(&self) -> bool {
        matches!(self.is, CheckFailure::Value(_) | CheckFailure::Absent(_))
    }
}

impl fmt::Display for Break {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Break::Start => "the gateway has just started",
            Break::Refused => "a connection was refused",
            Break::ConnectionLost => "the connection to the device was lost",
            Break::NewConnection => "the connection to the device was opened again",
            Break::InterfaceDown => "the computer's interface to the bus was down",
            Break::Restarted => "the device was restarted",
            Break::MachineOn => "the machine was switched on",
            Break::Pause => "the computer was paused or overloaded",
            Break::Silence => "the device did not answer for two poll periods",
        })
    }
}

impl fmt::Display for Difference {
    /// Formats the difference: `holding:90 (40091) reads 6 instead of 5 (decimal point): set it to 5 at the panel`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Difference { what, was, is, meaning, remedy } = self;
        match is {
            CheckFailure::Value(is) => write!(f, "{what} reads {is} instead of {was} ({meaning})")?,
            CheckFailure::Absent(why) | CheckFailure::Unreadable(why) => {
                write!(f, "{what} cannot be read: {why} ({meaning})")?
            }
            CheckFailure::Described(sentence) => f.write_str(sentence)?,
        }
        if remedy.is_empty() { Ok(()) } else { write!(f, ": {remedy}") }
    }
}

/// Joins the differences into one text for messages.
pub fn sentence(differences: &[Difference]) -> String {
    differences.iter().map(Difference::to_string).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests;
