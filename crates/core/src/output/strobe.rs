//! Strobe of a set (signal to the control to take the values), and the acknowledge of the control.
//!
//! ```text
//!   values written and read back ─► strobe up ─► Acknowledge ─► strobe down ─► Release ─► taken
//!                                                    │ not in time                │ not in time
//!                                                    ▼                            ▼
//!                                     strobe down at once, reported, tried again: the same values, from the beginning
//! ```
//!
//! Before anything is written, the acknowledge must be down (`Clear`). Otherwise an earlier acknowledge would be
//! mistaken for the answer to the next strobe. If the write that raises the strobe was not answered, the strobe may
//! rise late. The acknowledge must then be checked once more directly before the strobe rises. No wait blocks the line:
//! the acknowledge is read once in each cycle, and other exchanges use the rest of the cycle.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::handshake::HandshakeFault;
use crate::quantity::{Moment, shifted};

/// Least time between two reads of the acknowledge.
const ASK_EVERY: Duration = Duration::from_millis(20);

/// Strobe of a set: its level, and the level of the acknowledge that the set waits for.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Strobe {
    level: StrobeLevel,
    wait: Option<Wait>,
    /// Time until which an unanswered write may raise the strobe.
    may_rise_until: Option<Moment>,
    /// Failure that was reported last. `None` after a successful handshake.
    reported: Option<HandshakeFault>,
}

/// Level of a strobe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StrobeLevel {
    /// The level is unknown, because an earlier run may have left the strobe up. It is dropped before the first write.
    #[default]
    Unknown,
    /// The strobe is down.
    Down,
    /// The strobe is up, or may be. It is dropped as soon as the device can be reached.
    Up,
}

/// Level of the acknowledge that a set waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Awaited {
    /// The acknowledge must be down before anything is written, so that it cannot belong to an earlier strobe.
    Clear,
    /// The acknowledge must be up: the control has taken the set.
    Acknowledge,
    /// The acknowledge must be down again after the strobe was dropped.
    Release,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
struct Wait {
    what: Awaited,
    /// Time at which the wait fails with a timeout.
    until: Moment,
    /// Time of the next read of the acknowledge.
    ask: Moment,
}

shifted!(Wait: until, ask);
shifted!(Strobe: wait, may_rise_until);

/// Meaning of an acknowledge that was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AcknowledgeResult {
    /// The awaited level was read.
    There(Awaited),
    /// The awaited level was not read yet.
    NotYet,
    /// The awaited level was not read before the timeout.
    Missing(Awaited),
}

impl Strobe {
    /// Creates the strobe at a start. `was_up` means that an interrupted task had raised it.
    pub fn new(was_up: bool) -> Strobe {
        let level = if was_up { StrobeLevel::Up } else { StrobeLevel::Unknown };
        Strobe { level, ..Strobe::default() }
    }

    /// Level of the strobe.
    pub fn level(&self) -> StrobeLevel {
        self.level
    }

    /// Level of the acknowledge that the set waits for.
    pub fn awaits(&self) -> Option<Awaited> {
        self.wait.map(|wait| wait.what)
    }

    /// Returns the time of the next read of the acknowledge. `None` if the set does not wait for the acknowledge.
    pub fn next_read(&self) -> Option<Moment> {
        self.wait.map(|wait| wait.ask)
    }

    /// Returns whether the strobe is up, or may still rise.
    pub fn may_be_up(&self) -> bool {
        self.level == StrobeLevel::Up || self.may_rise_until.is_some()
    }

    /// Returns the failure of the last handshake. `None` after a successful handshake.
    pub fn failed(&self) -> Option<HandshakeFault> {
        self.reported
    }

    /// Prepares the end of the gateway: the set stops waiting for the control, and a strobe that may have risen is
    /// dropped.
    pub(super) fn prepare_end(&mut self) {
        self.wait = None;
        if self.may_rise_until.take().is_some() {
            self.level = StrobeLevel::Up;
        }
    }

    /// Returns whether an unanswered write may still raise the strobe.
    pub(super) fn may_rise(&mut self, now: Moment) -> bool {
        self.may_rise_until = self.may_rise_until.filter(|until| now <= *until);
        self.may_rise_until.is_some()
    }

    pub(super) fn rises(&mut self) {
        self.level = StrobeLevel::Up;
    }

    pub(super) fn drops(&mut self) {
        self.level = StrobeLevel::Down;
    }

    /// Records that a write to raise the strobe got no answer. It may raise the strobe until `until`.
    pub(super) fn may_rise_until(&mut self, until: Moment) {
        self.may_rise_until = Some(until);
    }

    pub(super) fn wait_for(&mut self, what: Awaited, timeout: Duration, now: Moment) {
        self.wait = Some(Wait { what, until: now.after(timeout), ask: now });
    }

    pub(super) fn stop_waiting(&mut self) {
        self.wait = None;
    }

    /// Processes the level of the acknowledge that was read. Returns `None` if the set does not wait for the
    /// acknowledge.
    pub(super) fn receive_acknowledge(&mut self, is_up: bool, now: Moment) -> Option<AcknowledgeResult> {
        let Wait { what, until, ask: _ } = self.wait?;
        if is_up == (what == Awaited::Acknowledge) {
            self.wait = None;
            return Some(AcknowledgeResult::There(what));
        }
        if now < until {
            self.wait = Some(Wait { what, until, ask: now.after(ASK_EVERY).min(until) });
            return Some(AcknowledgeResult::NotYet);
        }
        self.wait = None;
        if what == Awaited::Clear {
            // The acknowledge may answer a strobe that was abandoned and rose late.
            self.level = StrobeLevel::Up;
        }
        Some(AcknowledgeResult::Missing(what))
    }

    /// Records a failure. Returns true if it must be reported, because the last reported failure was a different one.
    pub(super) fn fails(&mut self, fault: HandshakeFault) -> bool {
        self.reported.replace(fault) != Some(fault)
    }

    pub(super) fn succeeded(&mut self) {
        self.reported = None;
    }

    /// Returns a copy in which `to` is applied to every moment, for the comparison of two states that differ only in
    /// time.
    #[doc(hidden)]
    pub fn moved(&self, to: impl Fn(Moment) -> Moment) -> Strobe {
        let wait = self.wait.map(|wait| Wait { until: to(wait.until), ask: to(wait.ask), ..wait });
        Strobe { wait, may_rise_until: self.may_rise_until.map(&to), ..self.clone() }
    }
}

impl Awaited {
    /// Returns the failure to report if the acknowledge does not reach this level in time.
    pub(super) fn fault(self) -> HandshakeFault {
        match self {
            Awaited::Clear => HandshakeFault::AcknowledgeEarly,
            Awaited::Acknowledge => HandshakeFault::AcknowledgeMissing,
            Awaited::Release => HandshakeFault::AcknowledgeStuck,
        }
    }
}
