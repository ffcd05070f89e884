//! Strobe signal of an output set (it requests the control to take the values), and the acknowledge signal with which
//! the control answers.
//!
//! ```text
//!   values written and read back ─► strobe up ─► Acknowledge ─► strobe down ─► Release ─► taken
//!                                                    │ not in time                │ not in time
//!                                                    ▼                            ▼
//!                                     strobe down at once, reported, tried again: the same values, from the beginning
//! ```
//!
//! Before anything is written, the acknowledge signal must be down (`Clear`). Otherwise an earlier signal would be
//! mistaken for the answer to the next strobe signal. If the write that raises the strobe signal was not answered, the
//! strobe may rise late. The acknowledge signal must then be checked once more directly before the strobe rises. No
//! wait blocks the bus line: the acknowledge signal is read once in each cycle, and other exchanges use the rest of the
//! cycle.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::handshake::HandshakeFault;
use crate::quantity::{Moment, shifted};

/// Minimum time between two reads of the acknowledge signal.
const ASK_EVERY: Duration = Duration::from_millis(20);

/// Strobe of an output set: its level, and the level of the acknowledge signal that the set waits for.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Strobe {
    level: StrobeLevel,
    wait: Option<Wait>,
    /// Time until which an unanswered write may raise the strobe signal.
    may_rise_until: Option<Moment>,
    /// Failure that was reported last. `None` after a successful handshake.
    reported: Option<HandshakeFault>,
}

/// Level of a strobe signal, as far as the gateway knows it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StrobeLevel {
    /// The level is unknown, because an earlier run may have left the strobe signal up. The strobe signal is dropped
    /// before the first write.
    #[default]
    Unknown,
    /// The strobe signal is down.
    Down,
    /// The strobe signal is up, or may be up. It is reset as soon as the device can be reached.
    Up,
}

/// Level of the control's acknowledge signal for which the handshake waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Awaited {
    /// The acknowledge signal must be down before anything is written, so that it cannot belong to an earlier strobe
    /// signal.
    Clear,
    /// The acknowledge signal must be up: the control has taken the output set.
    Acknowledge,
    /// The acknowledge signal must be down again after the strobe signal was dropped.
    Release,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
struct Wait {
    what: Awaited,
    /// Time at which the wait fails with a timeout.
    until: Moment,
    /// Time of the next read of the acknowledge signal.
    ask: Moment,
}

shifted!(Wait: until, ask);
shifted!(Strobe: wait, may_rise_until);

/// Meaning of an acknowledge signal that was read.
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
    /// Creates the strobe at a start of the gateway. `was_up` means that an interrupted task had raised the strobe
    /// signal.
    pub fn new(was_up: bool) -> Strobe {
        let level = if was_up { StrobeLevel::Up } else { StrobeLevel::Unknown };
        Strobe { level, ..Strobe::default() }
    }

    /// Returns the level of the strobe signal, as far as the gateway knows it.
    pub fn level(&self) -> StrobeLevel {
        self.level
    }

    /// Returns the level of the acknowledge signal that the output set waits for. `None` if the set does not wait.
    pub fn awaits(&self) -> Option<Awaited> {
        self.wait.map(|wait| wait.what)
    }

    /// Returns the time of the next read of the acknowledge signal. `None` if the output set does not wait for the
    /// acknowledge signal.
    pub fn next_read(&self) -> Option<Moment> {
        self.wait.map(|wait| wait.ask)
    }

    /// Returns whether the strobe signal is up, or may still rise.
    pub fn may_be_up(&self) -> bool {
        self.level == StrobeLevel::Up || self.may_rise_until.is_some()
    }

    /// Returns the failure of the last handshake. `None` after a successful handshake.
    pub fn failed(&self) -> Option<HandshakeFault> {
        self.reported
    }

    /// Prepares the end of the gateway: the output set stops waiting for the control, and a strobe signal that may have
    /// risen is dropped.
    pub(super) fn prepare_end(&mut self) {
        self.wait = None;
        if self.may_rise_until.take().is_some() {
            self.level = StrobeLevel::Up;
        }
    }

    /// Returns whether an unanswered write may still raise the strobe signal.
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

    /// Records that a write to raise the strobe signal got no answer. It may raise the strobe until `until`.
    pub(super) fn may_rise_until(&mut self, until: Moment) {
        self.may_rise_until = Some(until);
    }

    pub(super) fn wait_for(&mut self, what: Awaited, timeout: Duration, now: Moment) {
        self.wait = Some(Wait { what, until: now.after(timeout), ask: now });
    }

    pub(super) fn stop_waiting(&mut self) {
        self.wait = None;
    }

    /// Processes the level of the acknowledge signal that was read. Returns `None` if the output set does not wait for
    /// the acknowledge signal.
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

    /// Records a failure. Returns true if it must be reported, because it differs from the failure that was reported
    /// last.
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
    /// Returns the failure to report if the acknowledge signal does not reach this level in time.
    pub(super) fn fault(self) -> HandshakeFault {
        match self {
            Awaited::Clear => HandshakeFault::AcknowledgeEarly,
            Awaited::Acknowledge => HandshakeFault::AcknowledgeMissing,
            Awaited::Release => HandshakeFault::AcknowledgeStuck,
        }
    }
}
