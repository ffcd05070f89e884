//! Laws of settings that are changed at the panel of the module with the thermocouples, while contact with it lasts.
//!
//! - Values in other settings move a register for no longer than it takes to read the check once more, and no faster than `rate`.
//! - From the answer on by which the check finds the change, a register moves only towards what it held when the check passed last.
//!   It stops within [`BAND`] of that.
//! - It is back there as soon as `rate` allows, and [`BACK_LATER`]. After silence it may stay where it is: the gateway cannot know whether
//!   the module is the one whose check passed.
//! - When the check has passed again, only right values move it.
//!
//! What the check says is known from its answers on the line. What a register held is known from the machine. Time counts only
//! while a gateway asks and nothing fails on the line ([`FairTime`]).

use std::time::Duration;

use crate::machine::{LINES, SENSORS};

/// Speed of the registers, µm/s, of a machine with changes at a panel.
pub(crate) const RATE: f64 = 0.2;
/// The same in counts per second.
const COUNTS_PER_SECOND: f64 = 10.0 * RATE;

/// Period of the check.
const PERIOD: Duration = Duration::from_secs(60);
/// A check that is due is read after the next poll: a second later at most, and a turn of the line. If bad weather has kept it from being
/// answered, it is read once more up to three seconds later.
const LATER: Duration = Duration::from_secs(5);
/// A way back begins with the next step of the axis, and may wait for a read, a handshake and the last write.
const BACK_LATER: Duration = Duration::from_secs(10);
/// A change that was decided before the check passed again leaves within a period of its axis.
const DECIDED: Duration = Duration::from_secs(2);
/// Counts between what a register held and what its axis had decided when the check was read: a step, the deadband, and what is
/// rounded.
const BAND: i64 = 12;
/// Counts that a register may move more than `rate` allows: one step that had been decided before.
const DECIDED_BEFORE: f64 = 11.0;
/// So many questions to the module without a value are two poll periods of silence, which break contact with it.
const SILENCE: u32 = 2;
/// The gateway asks more often than this.
const PAUSE: Duration = Duration::from_secs(2);

/// Registers that are held to these laws.
pub(crate) const REGISTERS: usize = 4;

/// Time of one line in which a gateway asks and nothing fails.
#[derive(Clone, Copy, Debug, Default)]
struct FairTime {
    passed: Duration,
    asked_at: Duration,
    was_fair: bool,
}

/// Present change at the panel, and ways of the registers since the check passed last.
#[derive(Clone, Debug, Default)]
pub(crate) struct Panel {
    fair: [FairTime; LINES.len()],
    change: Option<Change>,
    /// When the check passed again after a change that it had found.
    passed_at: Option<Duration>,
    /// Contact with the module has lasted since its check passed last.
    has_contact: bool,
    /// Questions to the module in a row without a value.
    unanswered: u32,
    ways: [Way; REGISTERS],
    /// Registers that had left what they held, and went back.
    pub(crate) went_back: u64,
}

/// Settings that were changed after the check passed last.
#[derive(Clone, Copy, Debug)]
struct Change {
    at: Duration,
    /// Fair time of the module's line then.
    fair: Duration,
    /// The gateway was given another value of the check than expected.
    is_found: bool,
}

/// Way of one register. Counts are those of the gateway, without the operator's.
#[derive(Clone, Debug, Default)]
struct Way {
    /// Counts when the settings were changed; `None` if somebody else has changed the register since.
    from: Option<i64>,
    /// Counts when the check passed last, and when its axis was armed since. The same of the time before, if it was still on its way
    /// back there: a control in trouble may have refused it. Or if the gateway has not seen yet that the control lost them.
    held: Vec<i64>,
    /// Somebody else has changed the register since the check passed last.
    is_touched: bool,
    /// Fair time of its line at which it must be back.
    back_by: Option<Duration>,
    /// It had left what it held when the check found the change.
    was_away: bool,
}

impl FairTime {
    fn asks(&mut self, now: Duration, is_fair: bool) {
        let since = now.saturating_sub(self.asked_at);
        if is_fair && self.was_fair && since <= PAUSE {
            self.passed += since;
        }
        (self.asked_at, self.was_fair) = (now, is_fair);
    }
}

impl Panel {
    /// A question leaves on a line, on which nothing fails if it is fair.
    pub(crate) fn asks(&mut self, line: usize, now: Duration, is_fair: bool) {
        self.fair[line].asks(now, is_fair);
        if line == SENSORS {
            if self.unanswered >= SILENCE {
                self.breaks();
            }
            self.unanswered += 1;
        }
    }

    /// The module has answered with a value.
    pub(crate) fn answers(&mut self) {
        self.unanswered = 0;
    }

    /// The settings are changed now, while the registers hold these counts.
    pub(crate) fn changes(&mut self, ours: [i64; REGISTERS], now: Duration) {
        // A change that was found and has not passed since: no value of the module is used.
        if self.change.is_some_and(|change| change.is_found) {
            return;
        }
        self.change = Some(Change { at: now, fair: self.fair[SENSORS].passed, is_found: false });
        self.ways.iter_mut().zip(ours).for_each(|(way, ours)| way.from = Some(ours));
    }

    /// The gateway was given the expected value, which the module had at this time. The registers hold these counts, which the gateway
    /// has seen or not.
    pub(crate) fn passes(&mut self, ours: [(i64, bool); REGISTERS], seen_at: Duration, now: Duration) {
        let is_over = self.change.is_some_and(|change| change.at <= seen_at);
        let was_found = is_over && self.change.take().is_some_and(|change| change.is_found);
        if was_found {
            self.passed_at = Some(now);
        }
        self.has_contact = true;
        for (way, (ours, is_seen)) in self.ways.iter_mut().zip(ours) {
            let mut held = vec![ours];
            if !is_seen || was_found && way.away(ours).is_some_and(|away| away > BAND) {
                held.append(&mut way.held);
            }
            *way = Way { from: way.from, held, ..Way::default() };
        }
    }

    /// The gateway was given another value. The registers are on these lines and hold these counts.
    pub(crate) fn fails(&mut self, lines: [usize; REGISTERS], ours: [i64; REGISTERS]) {
        let Some(change) = self.change.as_mut().filter(|change| !change.is_found) else { return };
        change.is_found = true;
        for ((way, line), ours) in self.ways.iter_mut().zip(lines).zip(ours) {
            let must_go_back = self.has_contact && !way.is_touched;
            way.was_away = way.away(ours).is_some_and(|away| away > BAND);
            // It may go back to any of them.
            let farthest = way.held.iter().map(|held| (ours - held).abs()).max();
            way.back_by = farthest.filter(|_| must_go_back).map(|away| {
                let takes = Duration::from_secs_f64(away as f64 / COUNTS_PER_SECOND);
                self.fair[line].passed + takes + BACK_LATER
            });
        }
    }

    /// Contact with the module is broken. A gateway that finds a change after that does not know what was held before.
    pub(crate) fn breaks(&mut self) {
        self.has_contact = false;
    }

    /// Another gateway begins, which knows nothing of what was held.
    pub(crate) fn begins(&mut self) {
        self.has_contact = false;
        self.ways.iter_mut().for_each(|way| (way.held, way.back_by) = (Vec::new(), None));
    }

    /// An axis is armed, whose register holds these counts.
    pub(crate) fn arms(&mut self, place: usize, ours: i64) {
        self.ways[place].held.push(ours);
    }

    /// Somebody else than the gateway changes a register.
    pub(crate) fn touched(&mut self, place: usize) {
        let way = &mut self.ways[place];
        (way.from, way.is_touched, way.back_by) = (None, true, None);
    }

    /// Returns whether the gateway cannot know yet that the settings are others.
    pub(crate) fn is_hidden(&self) -> bool {
        let fair = self.fair[SENSORS].passed;
        self.change.is_some_and(|change| !change.is_found && fair - change.fair <= PERIOD + LATER)
    }

    /// Returns how long ago the settings were changed, if the check has not passed since.
    pub(crate) fn changed_for(&self, now: Duration) -> Option<Duration> {
        self.change.map(|change| now.saturating_sub(change.at))
    }

    /// Returns how far a register comes by these counts, if that is farther than `rate` allows since the change.
    pub(crate) fn too_far(&self, place: usize, ours: i64, now: Duration) -> Option<i64> {
        let moved = (ours - self.ways[place].from?).abs();
        let allowed = COUNTS_PER_SECOND * self.changed_for(now)?.as_secs_f64() + DECIDED_BEFORE;
        (moved as f64 > allowed).then_some(moved)
    }

    /// Returns whether a register may go back now.
    pub(crate) fn may_go_back(&self, place: usize, now: Duration) -> bool {
        let has_just_passed = self.passed_at.is_some_and(|at| now.saturating_sub(at) <= DECIDED);
        let is_found = self.change.is_some_and(|change| change.is_found);
        (is_found || has_just_passed) && !self.ways[place].held.is_empty()
    }

    /// Returns whether a change from one value to another leads back.
    pub(crate) fn leads_back(&self, place: usize, from: i64, to: i64) -> bool {
        let leads = |held: &i64| (to - held).abs() <= BAND || (to - held).abs() < (from - held).abs();
        self.ways[place].held.iter().any(leads)
    }

    /// Returns how far away a register still is, if it must be back by now.
    pub(crate) fn is_late(&mut self, place: usize, line: usize, ours: i64) -> Option<i64> {
        let way = &mut self.ways[place];
        way.back_by.take_if(|by| self.fair[line].passed >= *by)?;
        let away = way.away(ours)?;
        self.went_back += u64::from(way.was_away && away <= BAND);
        (away > BAND).then_some(away)
    }
}

impl Way {
    /// Counts from here to what was held; `None` if nothing is known of that.
    fn away(&self, ours: i64) -> Option<i64> {
        self.held.iter().map(|held| (ours - held).abs()).min()
    }
}
