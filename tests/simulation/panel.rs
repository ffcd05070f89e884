//! Laws for settings that are changed at the panel of the thermocouple module, while contact with the module lasts.
//!
//! - Values with other settings move a register only until the next check, and no faster than `rate`.
//! - After the reply by which the check finds the change, a register moves only towards its value at the last passed
//!   check. It stops within [`BAND`] of that value.
//! - It returns there as fast as `rate` allows, with a delay of at most [`BACK_LATER`]. After a loss of contact it may
//!   keep its value: the gateway cannot know whether the module is the one that passed the check.
//! - After the check has passed again, only correct values move it.
//!
//! The results of checks are taken from the replies on the line, and register values from the machine. Only time counts
//! in which a gateway sends requests and nothing fails on the line ([`FairTime`]).

use std::time::Duration;

use crate::machine::{LINES, SENSORS};

/// Maximum rate of the registers of a machine with changes at a panel, µm/s.
pub(crate) const RATE: f64 = 0.2;
/// Maximum rate in counts per second.
const COUNTS_PER_SECOND: f64 = 10.0 * RATE;

/// Period of the check.
const PERIOD: Duration = Duration::from_secs(60);
/// Maximum delay of a due check. It is read after the next poll, at most one second and one turn of the line later. If
/// a fault prevented its reply, it is read again up to three seconds later.
const LATER: Duration = Duration::from_secs(5);
/// Maximum delay of a return. It begins with the next step of the axis, and may wait for a read, a handshake and the
/// last write.
const BACK_LATER: Duration = Duration::from_secs(10);
/// Maximum delay of a change that was decided before the check passed again. It is sent within a period of its axis.
const DECIDED: Duration = Duration::from_secs(2);
/// Maximum difference in counts between a register value and the decision of its axis when the check was read: a step,
/// the deadband, and rounding.
const BAND: i64 = 12;
/// Counts that a register may move in addition to `rate`: one step that was decided before.
const DECIDED_BEFORE: f64 = 11.0;
/// Number of successive requests to the module without a value that break contact. It corresponds to two poll periods
/// of silence.
const SILENCE: u32 = 2;
/// Maximum time between two requests of a running gateway.
const PAUSE: Duration = Duration::from_secs(2);

/// Number of registers that are subject to these laws.
pub(crate) const REGISTERS: usize = 4;

/// Time of one line in which a gateway sends requests and nothing fails.
#[derive(Clone, Copy, Debug, Default)]
struct FairTime {
    passed: Duration,
    asked_at: Duration,
    was_fair: bool,
}

/// Current change at the panel, and movements of the registers since the last passed check.
#[derive(Clone, Debug, Default)]
pub(crate) struct Panel {
    fair: [FairTime; LINES.len()],
    change: Option<Change>,
    /// Time at which the check passed again after a change that it had found.
    passed_at: Option<Duration>,
    /// Whether contact with the module has lasted since the last passed check.
    has_contact: bool,
    /// Number of successive requests to the module without a value.
    unanswered: u32,
    ways: [Way; REGISTERS],
    /// Number of registers that had moved away and returned.
    pub(crate) went_back: u64,
}

/// Change of settings after the last passed check.
#[derive(Clone, Copy, Debug)]
struct Change {
    at: Duration,
    /// Fair time of the module's line at the change.
    fair: Duration,
    /// Whether the gateway has read an unexpected value of the check.
    is_found: bool,
}

/// Movement of one register. Counts are those of the gateway, without the operator offset.
#[derive(Clone, Debug, Default)]
struct Way {
    /// Counts at the change of settings; `None` if another client has changed the register since.
    from: Option<i64>,
    /// Counts to which the register may return: those at the last passed check, and at each arming since. If it was
    /// still returning to earlier counts, these are allowed too, because a control may have refused them. They are also
    /// allowed if the gateway has not read yet that the control lost them.
    held: Vec<i64>,
    /// Whether another client has changed the register since the last passed check.
    is_touched: bool,
    /// Fair time of its line at which it must have returned.
    back_by: Option<Duration>,
    /// Whether it had moved away when the check found the change.
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
    /// Records a request on a line. `is_fair` is whether nothing fails on this line.
    pub(crate) fn asks(&mut self, line: usize, now: Duration, is_fair: bool) {
        self.fair[line].asks(now, is_fair);
        if line == SENSORS {
            if self.unanswered >= SILENCE {
                self.breaks();
            }
            self.unanswered += 1;
        }
    }

    /// Records a reply of the module with a value.
    pub(crate) fn answers(&mut self) {
        self.unanswered = 0;
    }

    /// Records a change of settings, with the current counts of the registers.
    pub(crate) fn changes(&mut self, ours: [i64; REGISTERS], now: Duration) {
        // A change was found, and the check has not passed since. The gateway uses no value of the module.
        if self.change.is_some_and(|change| change.is_found) {
            return;
        }
        self.change = Some(Change { at: now, fair: self.fair[SENSORS].passed, is_found: false });
        self.ways.iter_mut().zip(ours).for_each(|(way, ours)| way.from = Some(ours));
    }

    /// Records the expected value of the check, which the module had at `seen_at`. `ours` contains the counts of the
    /// registers, and whether the gateway has read them.
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

    /// Records an unexpected value of the check, with the line and the counts of each register.
    pub(crate) fn fails(&mut self, lines: [usize; REGISTERS], ours: [i64; REGISTERS]) {
        let Some(change) = self.change.as_mut().filter(|change| !change.is_found) else { return };
        change.is_found = true;
        for ((way, line), ours) in self.ways.iter_mut().zip(lines).zip(ours) {
            let must_go_back = self.has_contact && !way.is_touched;
            way.was_away = way.away(ours).is_some_and(|away| away > BAND);
            // The register may return to any of these values.
            let farthest = way.held.iter().map(|held| (ours - held).abs()).max();
            way.back_by = farthest.filter(|_| must_go_back).map(|away| {
                let takes = Duration::from_secs_f64(away as f64 / COUNTS_PER_SECOND);
                self.fair[line].passed + takes + BACK_LATER
            });
        }
    }

    /// Records a loss of contact with the module. A gateway that finds a change after it does not know the earlier
    /// values.
    pub(crate) fn breaks(&mut self) {
        self.has_contact = false;
    }

    /// Records the start of another gateway, which does not know the earlier values.
    pub(crate) fn begins(&mut self) {
        self.has_contact = false;
        self.ways.iter_mut().for_each(|way| (way.held, way.back_by) = (Vec::new(), None));
    }

    /// Records the arming of an axis, with the counts of its register.
    pub(crate) fn arms(&mut self, place: usize, ours: i64) {
        self.ways[place].held.push(ours);
    }

    /// Records a change of a register by another client.
    pub(crate) fn touched(&mut self, place: usize) {
        let way = &mut self.ways[place];
        (way.from, way.is_touched, way.back_by) = (None, true, None);
    }

    /// Returns whether the gateway cannot know yet that the settings have changed.
    pub(crate) fn is_hidden(&self) -> bool {
        let fair = self.fair[SENSORS].passed;
        self.change.is_some_and(|change| !change.is_found && fair - change.fair <= PERIOD + LATER)
    }

    /// Returns the time since the change of settings, if the check has not passed since.
    pub(crate) fn changed_for(&self, now: Duration) -> Option<Duration> {
        self.change.map(|change| now.saturating_sub(change.at))
    }

    /// Returns the distance that a register moves to these counts, if it is more than `rate` allows since the change.
    pub(crate) fn too_far(&self, place: usize, ours: i64, now: Duration) -> Option<i64> {
        let moved = (ours - self.ways[place].from?).abs();
        let allowed = COUNTS_PER_SECOND * self.changed_for(now)?.as_secs_f64() + DECIDED_BEFORE;
        (moved as f64 > allowed).then_some(moved)
    }

    /// Returns whether a register may return now.
    pub(crate) fn may_go_back(&self, place: usize, now: Duration) -> bool {
        let has_just_passed = self.passed_at.is_some_and(|at| now.saturating_sub(at) <= DECIDED);
        let is_found = self.change.is_some_and(|change| change.is_found);
        (is_found || has_just_passed) && !self.ways[place].held.is_empty()
    }

    /// Returns whether a change from one value to another is part of the return.
    pub(crate) fn leads_back(&self, place: usize, from: i64, to: i64) -> bool {
        let leads = |held: &i64| (to - held).abs() <= BAND || (to - held).abs() < (from - held).abs();
        self.ways[place].held.iter().any(leads)
    }

    /// Returns the remaining distance of a register that must have returned by now.
    pub(crate) fn is_late(&mut self, place: usize, line: usize, ours: i64) -> Option<i64> {
        let way = &mut self.ways[place];
        way.back_by.take_if(|by| self.fair[line].passed >= *by)?;
        let away = way.away(ours)?;
        self.went_back += u64::from(way.was_away && away <= BAND);
        (away > BAND).then_some(away)
    }
}

impl Way {
    /// Distance in counts to the nearest allowed value; `None` without one.
    fn away(&self, ours: i64) -> Option<i64> {
        self.held.iter().map(|held| (ours - held).abs()).min()
    }
}
