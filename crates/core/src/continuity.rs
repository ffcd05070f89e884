//! Continuity of devices: whether the device that answers is the one that was verified before.
//!
//! An address and a name do not identify a device. After a break of contact another module or control may answer there, or the same
//! one with other settings. [`DeviceContinuity`] collects what is known of one device. One method breaks its continuity
//! ([`DeviceContinuity::breaks`]) and one mends it ([`DeviceContinuity::verified`]).
//!
//! | state | event | next state |
//! |---|---|---|
//! | any | all checks pass, read after the last break | Confirmed |
//! | any | a check finds something else | Changed |
//! | Confirmed | contact is broken | Unconfirmed |
//! | Unconfirmed, Changed | contact is broken | the same |
//!
//! While a device is not [`Continuity::Confirmed`], its new readings are not used and nothing is written to it. Its last good
//! readings age to their `max_age`. A device without checks has nothing that identifies it and stays confirmed. Its breaks are counted,
//! so that [`RateFilter`] compares the first value after a break with the last good one before it.

use std::fmt;
use std::time::Duration;

use crate::quantity::Moment;

mod rate;

pub use rate::{RateFault, RateFilter};

/// Requests in a row without an answer that can be a break: a single lost answer is none.
const SILENT_REQUESTS: u32 = 2;
/// Poll periods without an answer that are a break.
const SILENT_PERIODS: u32 = 2;

/// Whether the device that answers is known to be the one that was verified.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Continuity {
    /// The device has passed its checks, and contact has not been broken since.
    Confirmed,
    /// Contact was broken. The next exchange reads the checks.
    Unconfirmed {
        /// Time of the first break.
        since: Moment,
        /// Cause of the first break.
        cause: Break,
    },
    /// A check found something else than expected. Never empty.
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
    /// A connection was made that does not resume the one before: a server has forgotten it, or a serial port is another one.
    NewConnection,
    /// The interface of the bus went down.
    InterfaceDown,
    /// The device was restarted.
    Restarted,
    /// The machine was switched on, and the device perhaps with it.
    MachineOn,
    /// The computer stood still for longer than the readings may age.
    Pause,
    /// The device did not answer for two poll periods.
    Silence,
}

/// One check with another result than expected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Register, object or node that was checked, for example `holding:90 (40091)`.
    pub what: String,
    /// Expected value.
    pub was: String,
    /// Value found, or why it cannot be read.
    pub is: Found,
    /// Meaning of the value, for people.
    pub meaning: String,
    /// Remedy from the profile; may be empty.
    pub remedy: String,
}

/// Result of a check that did not pass.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Found {
    /// Another value.
    Value(String),
    /// No value: the device says that it has no such register, for this reason.
    Absent(String),
    /// No value, for a reason that says nothing of the register.
    Unreadable(String),
    /// Another finding, as a sentence.
    Described(String),
}

/// Means by which a device is identified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Identity {
    /// Nothing: it has no checks.
    None,
    /// Its checks.
    Checks,
}

/// Continuity of one device.
#[derive(Clone, Debug)]
pub struct DeviceContinuity {
    identity: Identity,
    /// Time without an answer that is a break.
    silence: Duration,
    state: Continuity,
    /// Breaks so far.
    breaks: u64,
    /// Breaks before the checks passed last. `None` if they have not passed yet.
    passed_after: Option<u64>,
    /// Breaks after which the device may have forgotten what was written to it.
    resets: u64,
    /// Last answer.
    answered: Moment,
    /// Last answer that was no refusal.
    delivered: Moment,
    /// Requests without an answer since.
    missed: u32,
    /// Silence since the last answer, which has broken continuity once.
    is_silent: bool,
}

impl DeviceContinuity {
    /// Begins for a device with this identity and poll period.
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

    /// Number of breaks so far. A check that was read before the last break says nothing of the present device.
    pub fn breaks_so_far(&self) -> u64 {
        self.breaks
    }

    /// Returns whether continuity has lasted since the checks passed last. Another value of a check shows then that settings were
    /// changed at the same device.
    pub fn has_lasted(&self) -> bool {
        self.passed_after == Some(self.breaks)
    }

    /// Number of breaks so far after which the device may have forgotten how it was set up.
    pub fn resets_so_far(&self) -> u64 {
        self.resets
    }

    /// Number of breaks that [`RateFilter`] counts: none of a device whose checks say whether it is the same.
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

    /// Breaks continuity. A device that is already unconfirmed keeps its first cause. A changed device stays changed until a check
    /// passes.
    pub fn breaks(&mut self, cause: Break, now: Moment) {
        self.breaks += 1;
        self.resets += u64::from(!matches!(cause, Break::Pause | Break::MachineOn));
        if self.identity == Identity::Checks && self.is_confirmed() {
            self.state = Continuity::Unconfirmed { since: now, cause };
        }
    }

    /// Takes the result of the checks, read after this many breaks. An empty list confirms the device. Returns the state before, or
    /// `None` if continuity was broken in between and the checks must be read again.
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

    /// Notes that the device is about to be asked, or has answered. A silence that has become long since the last miss breaks
    /// continuity once. A device that is not confirmed is checked in any case.
    pub fn notice_silence(&mut self, now: Moment) {
        let is_silent = self.missed >= SILENT_REQUESTS && now.since(self.answered) >= self.silence;
        if is_silent && self.is_confirmed() && !std::mem::replace(&mut self.is_silent, true) {
            self.breaks(Break::Silence, now);
        }
    }

    /// Notes an answer, also one that refuses.
    pub fn answers(&mut self, now: Moment) {
        self.notice_silence(now);
        (self.answered, self.missed, self.is_silent) = (now, 0, false);
    }

    /// Notes an answer that brought what was asked for.
    pub fn delivers(&mut self, now: Moment) {
        self.answers(now);
        self.delivered = now;
    }

    /// Notes a request without an answer. Several of them, over two poll periods, break continuity once.
    pub fn misses(&mut self, now: Moment) {
        self.missed = self.missed.saturating_add(1);
        let is_silent = self.missed >= SILENT_REQUESTS && now.since(self.answered) >= self.silence;
        if is_silent && !std::mem::replace(&mut self.is_silent, true) {
            self.breaks(Break::Silence, now);
        }
    }
}

impl Difference {
    /// Returns whether another value was read.
    pub fn is_value(&self) -> bool {
        matches!(self.is, Found::Value(_))
    }

    /// Returns whether it shows that the device is another one or set otherwise: it brought another value, or the device says that
    /// it has no such register.
    pub fn is_evidence(&self) -> bool {
        matches!(self.is, Found::Value(_) | Found::Absent(_))
    }
}

impl fmt::Display for Break {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Break::Start => "the gateway has just started",
            Break::Refused => "a connection was refused",
            Break::ConnectionLost => "its connection was lost",
            Break::NewConnection => "a new connection was made",
            Break::InterfaceDown => "the interface was down",
            Break::Restarted => "it was restarted",
            Break::MachineOn => "the machine was switched on",
            Break::Pause => "the computer stood still",
            Break::Silence => "it did not answer for two poll periods",
        })
    }
}

impl fmt::Display for Difference {
    /// `holding:90 (40091) reads 6 instead of 5 (decimal point): set it to 5 at the panel`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Difference { what, was, is, meaning, remedy } = self;
        match is {
            Found::Value(is) => write!(f, "{what} reads {is} instead of {was} ({meaning})")?,
            Found::Absent(why) | Found::Unreadable(why) => {
                write!(f, "{what} cannot be read: {why} ({meaning})")?
            }
            Found::Described(sentence) => f.write_str(sentence)?,
        }
        if remedy.is_empty() { Ok(()) } else { write!(f, ": {remedy}") }
    }
}

/// Joins differences to one sentence.
pub fn sentence(differences: &[Difference]) -> String {
    differences.iter().map(Difference::to_string).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests;
