//! Continuity of devices: whether the answers still come from the device that was verified before.
//!
//! An address and a name do not identify a device. After contact was lost, another module or control may answer there,
//! or the same one with other settings. [`DeviceContinuity`] collects what is known about one device.
//! [`DeviceContinuity::breaks`] breaks its continuity, and [`DeviceContinuity::verified`] restores it.
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
//! one before it.

use std::fmt;
use std::time::Duration;

use crate::quantity::Moment;

mod rate;

pub use rate::{RateFault, RateFilter};

/// Number of consecutive requests without an answer that can be a break. A single lost answer is no break.
const SILENT_REQUESTS: u32 = 2;
/// Time without an answer that is a break, in poll periods.
const SILENT_PERIODS: u32 = 2;

/// State of a device: whether it is known to be the one that was verified.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Continuity {
    /// The device has passed its checks, and contact has not been broken since.
    Confirmed,
    /// Contact was lost. The next exchange reads the checks.
    Unconfirmed {
        /// Time of the first break.
        since: Moment,
        /// Cause of the first break.
        cause: Break,
    },
    /// A check found a difference. The list is never empty.
    Changed(Vec<Difference>),
}

/// Cause of a break of continuity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Break {
    /// The gateway has just started.
    Start,
    /// A connection was refused.
    Refused,
    /// A connection was reset, or closed without an answer.
    ConnectionLost,
    /// A new connection does not resume the last one: a server has discarded the session, or a serial port has changed.
    NewConnection,
    /// The interface of the bus went down.
    InterfaceDown,
    /// The device was restarted.
    Restarted,
    /// The machine was switched on, and perhaps the device with it.
    MachineOn,
    /// The computer was paused for longer than the readings may age.
    Pause,
    /// The device did not answer for two poll periods.
    Silence,
}

/// Check with an unexpected result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Register, object or node that was checked, for example `holding:90 (40091)`.
    pub what: String,
    /// Value that the profile expects.
    pub was: String,
    /// Value found, or the reason why it cannot be read.
    pub is: CheckFailure,
    /// Meaning of the value, for messages.
    pub meaning: String,
    /// Remedy from the profile; may be empty.
    pub remedy: String,
}

/// Result of a check that did not pass.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CheckFailure {
    /// The check read another value than expected, given as text.
    Value(String),
    /// No value: the device answered that it has no such register, for this reason.
    Absent(String),
    /// No value, for a reason that does not concern the register.
    Unreadable(String),
    /// Any other finding, as a sentence.
    Described(String),
}

/// Means by which a device is identified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Identity {
    /// The device has no checks.
    None,
    /// The device has checks.
    Checks,
}

/// Continuity of one device.
#[derive(Clone, Debug)]
pub struct DeviceContinuity {
    identity: Identity,
    /// Time without an answer that is a break.
    silence: Duration,
    state: Continuity,
    /// Number of breaks so far.
    breaks: u64,
    /// Number of breaks before the checks last passed. `None` if they have not passed yet.
    passed_after: Option<u64>,
    /// Number of breaks after which the device may have lost its settings.
    resets: u64,
    /// Time of the last answer.
    answered: Moment,
    /// Time of the last answer that was no refusal.
    delivered: Moment,
    /// Number of requests without an answer since the last answer.
    missed: u32,
    /// Whether the present silence has already broken continuity.
    is_silent: bool,
}

impl DeviceContinuity {
    /// Creates the state at the start for a device with this identity and poll period.
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

    /// State of the device.
    pub fn state(&self) -> &Continuity {
        &self.state
    }

    /// Returns whether readings of the device are used and writes to it are sent.
    pub fn is_confirmed(&self) -> bool {
        self.state == Continuity::Confirmed
    }

    /// Number of breaks so far. A check that was read before the last break says nothing about the present device.
    pub fn breaks_so_far(&self) -> u64 {
        self.breaks
    }

    /// Returns whether continuity has lasted since the checks last passed. If it has, a different value of a check
    /// means that settings were changed on the same device.
    pub fn has_lasted(&self) -> bool {
        self.passed_after == Some(self.breaks)
    }

    /// Number of breaks after which the device may have lost its settings.
    pub fn resets_so_far(&self) -> u64 {
        self.resets
    }

    /// Number of breaks for [`RateFilter`]. Zero for a device with checks, because these identify it.
    pub fn breaks_without_checks(&self) -> u64 {
        match self.identity {
            Identity::None => self.breaks,
            Identity::Checks => 0,
        }
    }

    /// Time of the last answer that was no refusal.
    pub fn delivered_at(&self) -> Moment {
        self.delivered
    }

    /// Records a break of continuity. An unconfirmed device keeps its first cause. A changed device stays changed until
    /// its checks pass.
    pub fn breaks(&mut self, cause: Break, now: Moment) {
        self.breaks += 1;
        self.resets += u64::from(!matches!(cause, Break::Pause | Break::MachineOn));
        if self.identity == Identity::Checks && self.is_confirmed() {
            self.state = Continuity::Unconfirmed { since: now, cause };
        }
    }

    /// Processes the result of the checks, which were read after this many breaks. An empty list confirms the device.
    /// Returns the state before. Returns `None` if continuity was broken meanwhile; the checks must then be read again.
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

    /// Records a break if the device has been silent for too long. Call it before each request and at each answer. One
    /// silence is one break. A device that is not confirmed is checked in any case.
    pub fn notice_silence(&mut self, now: Moment) {
        let is_silent = self.missed >= SILENT_REQUESTS && now.since(self.answered) >= self.silence;
        if is_silent && self.is_confirmed() && !std::mem::replace(&mut self.is_silent, true) {
            self.breaks(Break::Silence, now);
        }
    }

    /// Records an answer, including a refusal.
    pub fn answers(&mut self, now: Moment) {
        self.notice_silence(now);
        (self.answered, self.missed, self.is_silent) = (now, 0, false);
    }

    /// Records an answer with the requested data.
    pub fn delivers(&mut self, now: Moment) {
        self.answers(now);
        self.delivered = now;
    }

    /// Records a request without an answer. Two or more consecutive ones, at least two poll periods after the last
    /// answer, are one break.
    pub fn misses(&mut self, now: Moment) {
        self.missed = self.missed.saturating_add(1);
        let is_silent = self.missed >= SILENT_REQUESTS && now.since(self.answered) >= self.silence;
        if is_silent && !std::mem::replace(&mut self.is_silent, true) {
            self.breaks(Break::Silence, now);
        }
    }
}

impl Difference {
    /// Returns whether the check read a different value.
    pub fn is_value(&self) -> bool {
        matches!(self.is, CheckFailure::Value(_))
    }

    /// Returns whether the difference proves that the device is another one or has other settings. It does if a
    /// different value was read, or if the device answered that it has no such register.
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
            Break::NewConnection => "a new connection was made",
            Break::InterfaceDown => "the interface was down",
            Break::Restarted => "the device was restarted",
            Break::MachineOn => "the machine was switched on",
            Break::Pause => "the computer stood still",
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

/// Joins differences into one sentence.
pub fn sentence(differences: &[Difference]) -> String {
    differences.iter().map(Difference::to_string).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests;
