//! Strobe of a set, and its acknowledge.
//!
//! ```text
//!   values written and read back ─► strobe up ─► Acknowledge ─► strobe down ─► Release ─► taken
//!                                                    │ not in time                │ not in time
//!                                                    ▼                            ▼
//!                                     strobe down at once, reported, tried again: the same values, from the beginning
//! ```
//!
//! Before anything is written the acknowledge must be down (`Clear`): one that is still up from before would answer a
//! strobe that the control has not seen. If a raise was not answered, the strobe may rise late: then the acknowledge must be down once
//! more directly before the strobe rises. No wait blocks the line: the acknowledge is read once in every cycle, the
//! rest of which belongs to the others.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::handshake::HandshakeFault;
use crate::quantity::{Moment, shifted};

/// The acknowledge is read at most this often.
const ASK_EVERY: Duration = Duration::from_millis(20);

/// Strobe of a set: its level, and the level of the acknowledge that the set waits for.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Strobe {
    level: StrobeLevel,
    wait: Option<Wait>,
    /// A write that was not answered may raise the strobe until then.
    may_rise_until: Option<Moment>,
    /// Failure that was reported. The next success ends it.
    reported: Option<HandshakeFault>,
}

/// Level of a strobe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StrobeLevel {
    /// An earlier run may have left it up: it is dropped before the first write.
    #[default]
    Unknown,
    /// Dropped.
    Down,
    /// Raised, or perhaps raised: it is dropped as soon as the device can be reached.
    Up,
}

/// Level of the acknowledge that a set waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Awaited {
    /// Down, before anything is written: an earlier acknowledge drops.
    Clear,
    /// Up: the control has taken the set.
    Acknowledge,
    /// Down again, after the strobe has dropped.
    Release,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
struct Wait {
    what: Awaited,
    /// End of the time that the control has.
    until: Moment,
    /// When the acknowledge is read next.
    ask: Moment,
}

shifted!(Wait: until, ask);
shifted!(Strobe: wait, may_rise_until);

/// Meaning of an acknowledge that was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Heard {
    /// The awaited level.
    There(Awaited),
    /// Not the awaited level yet.
    NotYet,
    /// Not the awaited level in its time.
    Missing(Awaited),
}

impl Strobe {
    /// Strobe at a start. `was_up`: a task that was interrupted had raised it.
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

    /// When the acknowledge is read next. `None` if the set waits for nothing.
    pub fn asks(&self) -> Option<Moment> {
        self.wait.map(|wait| wait.ask)
    }

    /// Returns whether the strobe is up, or may still rise.
    pub fn may_be_up(&self) -> bool {
        self.level == StrobeLevel::Up || self.may_rise_until.is_some()
    }

    /// Failure of the last handshake, until one succeeds.
    pub fn failed(&self) -> Option<HandshakeFault> {
        self.reported
    }

    /// The gateway is about to end: the set waits for nothing, and a strobe that may have risen since is dropped.
    pub(super) fn leaves(&mut self) {
        self.wait = None;
        if self.may_rise_until.take().is_some() {
            self.level = StrobeLevel::Up;
        }
    }

    /// Returns whether a write that was not answered may still raise the strobe.
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

    /// The write that raises the strobe was not answered.
    pub(super) fn may_rise_until(&mut self, until: Moment) {
        self.may_rise_until = Some(until);
    }

    pub(super) fn wait_for(&mut self, what: Awaited, timeout: Duration, now: Moment) {
        self.wait = Some(Wait { what, until: now.after(timeout), ask: now });
    }

    pub(super) fn waits_no_more(&mut self) {
        self.wait = None;
    }

    /// The acknowledge was read. `None` if the set waits for nothing.
    pub(super) fn hears(&mut self, is_up: bool, now: Moment) -> Option<Heard> {
        let Wait { what, until, ask: _ } = self.wait?;
        if is_up == (what == Awaited::Acknowledge) {
            self.wait = None;
            return Some(Heard::There(what));
        }
        if now < until {
            self.wait = Some(Wait { what, until, ask: now.after(ASK_EVERY).min(until) });
            return Some(Heard::NotYet);
        }
        self.wait = None;
        if what == Awaited::Clear {
            // The acknowledge may answer a strobe that was given up, and rose late.
            self.level = StrobeLevel::Up;
        }
        Some(Heard::Missing(what))
    }

    /// Returns whether this failure is to be reported: the last one was another.
    pub(super) fn fails(&mut self, fault: HandshakeFault) -> bool {
        self.reported.replace(fault) != Some(fault)
    }

    pub(super) fn succeeded(&mut self) {
        self.reported = None;
    }

    /// Moves every moment by `to`.
    #[doc(hidden)]
    pub fn moved(&self, to: impl Fn(Moment) -> Moment) -> Strobe {
        let wait = self.wait.map(|wait| Wait { until: to(wait.until), ask: to(wait.ask), ..wait });
        Strobe { wait, may_rise_until: self.may_rise_until.map(&to), ..self.clone() }
    }
}

impl Awaited {
    /// Failure if the control does not answer with this level in its time.
    pub(super) fn fault(self) -> HandshakeFault {
        match self {
            Awaited::Clear => HandshakeFault::AcknowledgeEarly,
            Awaited::Acknowledge => HandshakeFault::AcknowledgeMissing,
            Awaited::Release => HandshakeFault::AcknowledgeStuck,
        }
    }
}
