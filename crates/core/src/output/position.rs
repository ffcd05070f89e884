//! Controller of a corrected position: a position that was read, plus Cz (the compensation value). The
//! controller chooses the value of each write, and interprets the result of the write. A *turn* is one call
//! of the controller by the task of the bus line, with its action and result.
//!
//! The latest position is sent at once in every armed state, even while the axis is frozen. Only its Cz follows the
//! rules in [`PositionCz`].
//!
//! | state at the turn | action |
//! |---|---|
//! | a display, while the axis is off or the position is not usable | dashes instead of a position, now and every ten seconds |
//! | no new position | nothing |
//! | an axis that is off, or a dry run | nothing: the next write uses the decided Cz |
//! | a device to which nothing is sent for a while (back-off) | nothing: the position is used later |
//! | an interlock that is open (no writing allowed), or whose signal is unknown | nothing |
//! | a new position | position and Cz |

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::demand::Condition;
use super::follow::Trouble;
use super::position_cz::PositionCz;
use crate::quantity::{Micron, Moment, shifted};

/// Period at which the dashes on a display are written again. A display that was switched off and on no longer shows
/// the dashes.
const DASHES_AGAIN: Duration = Duration::from_secs(10);

/// Controller of a corrected position: a position that was read, plus Cz, is written to the control or a display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionController {
    /// Time at which the gateway read the last position that this controller has handled, even if it was not
    /// written.
    corrected: Moment,
    inside: PositionCz,
    /// Time at which dashes were last written to the display. `None` while the display shows a position.
    dashes_at: Option<Moment>,
    trouble: Option<Trouble>,
    interlock: Interlock,
}

/// State of the interlock that was reported last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Interlock {
    #[default]
    Closed,
    Open,
}

/// Demand on an output that writes a position plus Cz (a corrected position): the position that was read, the decision
/// of the axis, and the interlock.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionDemand {
    /// Time at which the latest position was read.
    pub read_at: Moment,
    /// Whether the position is valid: its reading is good.
    pub is_usable: bool,
    /// Decision of the axis. `None` if the axis is off, and in a dry run (a run that writes nothing).
    pub decision: Option<PositionDecision>,
    /// Condition of the interlock.
    pub interlock: Condition,
    /// Whether the bus line sends nothing to the device for a while (back-off).
    pub backs_off: bool,
    /// Whether the display can show dashes instead of a position, and the gateway may write them.
    pub may_show_dashes: bool,
}

/// Decision of an axis about the Cz in a corrected position (a position that was read, plus Cz).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionDecision {
    /// Cz that the axis has decided.
    pub cz: Micron,
    /// Target that Cz approaches.
    pub target: Micron,
    /// Time of the decision.
    pub at: Moment,
}

/// Action of the controller for the latest position that was read.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PositionAction {
    /// Write nothing in this call.
    Nothing,
    /// Write nothing: the interlock does not allow writing, or its signal is unknown.
    Interlocked(Condition),
    /// Write the position with this Cz.
    Correct(Micron),
    /// Write dashes to the display, because the position is not corrected.
    ShowDashes,
}

impl PositionAction {
    /// Returns the name of the action in a log.
    pub const fn name(&self) -> &'static str {
        match self {
            PositionAction::Nothing => "nothing",
            PositionAction::Interlocked(_) => "interlocked",
            PositionAction::Correct(_) => "correct",
            PositionAction::ShowDashes => "show-dashes",
        }
    }
}

/// Result of a write of a corrected position (a position that was read, plus Cz), or of the dashes that a display shows
/// instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PositionResult {
    /// The write was acknowledged. If the position is read back, the read showed the written value.
    Written,
    /// The value read back differs from the written value.
    NotShown,
    /// The write was not sent: the last moment for it had passed.
    Lapsed,
    /// The write was refused, not answered or not sent.
    Failed {
        /// Kind of the failure: the device did not answer, or did not take the value.
        trouble: Trouble,
        /// Whether the request was sent, so that the device may carry it out.
        may_have_arrived: bool,
    },
}

/// Turn of a corrected position (one call of its controller by the task of the bus line), for the log. With the same
/// demand and result, the controller makes the same decision in a replay.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionTurn {
    /// Demand of this call of the controller: position, decision and interlock.
    pub demand: PositionDemand,
    /// Action that the controller chose.
    pub action: PositionAction,
    /// Result of the write; `None` if nothing was written.
    pub result: Option<PositionResult>,
}

/// Event of an output that writes a corrected position (a position that was read, plus Cz).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PositionEvent {
    /// The interlock is open: the output must not be written.
    Interlocked,
    /// The interlock is closed again: the output may be written.
    Released,
    /// The value read back differs from the written value. The difference is reported again only after a write that was
    /// read back correctly.
    NotShown,
}

impl PositionTurn {
    /// Returns whether this turn (call of the controller) repeats the turn `last` with a newer position. `before`:
    /// state of the controller after `last`. `after`: its state after this turn.
    pub fn repeats(
        &self,
        last: &PositionTurn,
        (before, after): (&PositionController, &PositionController),
    ) -> bool {
        let with = |decision: PositionDecision| {
            let at = self.demand.decision.map_or(decision.at, |newer| newer.at);
            PositionDecision { at, ..decision }
        };
        let (read_at, decision) = (self.demand.read_at, last.demand.decision.map(with));
        let demand = PositionDemand { read_at, decision, ..last.demand };
        *self == PositionTurn { demand, ..*last } && before.is_alike_inside(after)
    }

    /// Returns this turn (call of the controller) with a position that was read one nanosecond later.
    #[must_use]
    pub fn again(mut self) -> PositionTurn {
        self.demand.read_at = self.demand.read_at.after(Duration::from_nanos(1));
        self
    }
}

impl PositionController {
    /// Creates a controller that resumes from `left`, the Cz that the previous run wrote last. `None` if it is unknown.
    pub fn resuming(left: Option<Micron>) -> PositionController {
        PositionController {
            inside: left.map_or(PositionCz::Nothing, PositionCz::Left),
            ..PositionController::default()
        }
    }

    /// Returns whether both controllers will make the same decision about the next position.
    pub fn is_like(&self, other: &PositionController) -> bool {
        *self == PositionController { corrected: self.corrected, ..*other }
    }

    /// Returns whether both controllers will make the same decision about the next position, if Cz and target
    /// do not change. The times of the decisions that were written last may differ.
    fn is_alike_inside(&self, other: &PositionController) -> bool {
        let inside = match (self.inside, other.inside) {
            (PositionCz::Written(one, at), PositionCz::Written(another, _)) if one == another => {
                PositionCz::Written(one, at)
            }
            (_, inside) => inside,
        };
        self.is_like(&PositionController { inside, ..*other })
    }

    fn shows_dashes(&self, demand: &PositionDemand, now: Moment) -> bool {
        let is_fresh = self.dashes_at.is_some_and(|at| now < at.after(DASHES_AGAIN));
        let is_corrected = demand.decision.is_some() && demand.is_usable;
        demand.may_show_dashes && !is_corrected && !demand.backs_off && !is_fresh
    }

    /// Returns whether the position that was read at `read_at` has already been handled.
    pub fn has_corrected(&self, read_at: Moment) -> bool {
        self.corrected == read_at
    }

    /// Chooses the action for the latest position. `step` is the largest change of Cz, µm. Also returns an event if it
    /// must be reported.
    pub fn next(
        &mut self,
        demand: &PositionDemand,
        step: Micron,
        now: Moment,
    ) -> (PositionAction, Option<PositionEvent>) {
        let dashes = self.shows_dashes(demand, now).then_some(PositionAction::ShowDashes);
        if dashes.is_none() && self.has_corrected(demand.read_at) {
            return (PositionAction::Nothing, None);
        }
        let Some(PositionDecision { cz, target, at }) = demand.decision else {
            self.corrected = demand.read_at;
            // An axis is off at first. The register still holds the Cz of the previous run.
            if !matches!(self.inside, PositionCz::Left(_)) {
                self.inside = PositionCz::Nothing;
            }
            return (dashes.unwrap_or(PositionAction::Nothing), None);
        };
        if demand.backs_off {
            return (PositionAction::Nothing, None);
        }
        self.corrected = demand.read_at;
        if !demand.is_usable {
            return (dashes.unwrap_or(PositionAction::Nothing), None);
        }
        let event = self.interlock_is(demand.interlock);
        if demand.interlock == Condition::Met {
            return (PositionAction::Correct(self.inside.next((cz, target, at), step)), event);
        }
        if self.inside == PositionCz::Nothing {
            // The axis continues while the interlock is open. The first position after it starts from this Cz.
            self.inside = PositionCz::Written(cz, at);
        }
        (PositionAction::Interlocked(demand.interlock), event)
    }

    /// Records the condition of the interlock. An unknown condition is not an event, because the lost signal is
    /// reported.
    fn interlock_is(&mut self, condition: Condition) -> Option<PositionEvent> {
        match (self.interlock, condition) {
            (Interlock::Closed, Condition::NotMet) => {
                self.interlock = Interlock::Open;
                Some(PositionEvent::Interlocked)
            }
            (Interlock::Open, Condition::Met) => {
                self.interlock = Interlock::Closed;
                Some(PositionEvent::Released)
            }
            _ => None,
        }
    }

    /// Records the result of the write that a turn (call of the controller) has requested. Returns an event if it must
    /// be reported.
    pub fn result(&mut self, turn: &PositionTurn, now: Moment) -> Option<PositionEvent> {
        let (cz, at) = match (turn.action, turn.demand.decision) {
            (PositionAction::Correct(cz), Some(decision)) => (cz, decision.at),
            (PositionAction::ShowDashes, _) if turn.result == Some(PositionResult::Written) => {
                (self.dashes_at, self.inside) = (Some(now), PositionCz::Nothing);
                return None;
            }
            _ => return None,
        };
        match turn.result? {
            PositionResult::Written => {
                (self.inside, self.dashes_at, self.trouble) = (PositionCz::Written(cz, at), None, None);
                None
            }
            PositionResult::NotShown => {
                self.inside = PositionCz::Sent(cz);
                let before = self.trouble.replace(Trouble::Untaken);
                (before != Some(Trouble::Untaken)).then_some(PositionEvent::NotShown)
            }
            PositionResult::Lapsed => None,
            PositionResult::Failed { trouble, may_have_arrived } => {
                if may_have_arrived {
                    self.inside = PositionCz::Sent(cz);
                }
                let is_worse = |known: &Trouble| *known == Trouble::Untaken;
                self.trouble = self.trouble.filter(is_worse).or(Some(trouble));
                None
            }
        }
    }
}

shifted!(PositionController: corrected, inside, dashes_at);
shifted!(PositionDemand: read_at, decision);
shifted!(PositionDecision: at);
shifted!(PositionTurn: demand);

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 1.0;

    fn micron(value: f64) -> Micron {
        Micron::new(value).unwrap()
    }

    fn second(second: u64) -> Moment {
        Moment::from_nanos(second * 1_000_000_000)
    }

    fn demand(at: u64) -> PositionDemand {
        let decision = PositionDecision { cz: micron(5.0), target: micron(9.0), at: second(at) };
        PositionDemand {
            read_at: second(at),
            is_usable: true,
            decision: Some(decision),
            interlock: Condition::Met,
            backs_off: false,
            may_show_dashes: false,
        }
    }

    fn next(one: &mut PositionController, demand: &PositionDemand) -> PositionAction {
        one.next(demand, micron(STEP), demand.read_at).0
    }

    /// Passes to the controller the result of a write with the Cz `cz`, µm, decided at second 1.
    fn result(one: &mut PositionController, cz: f64, result: PositionResult) -> Option<PositionEvent> {
        let (demand, action) = (demand(1), PositionAction::Correct(micron(cz)));
        one.result(&PositionTurn { demand, action, result: Some(result) }, demand.read_at)
    }

    #[test]
    fn each_position_is_corrected_once_and_by_a_step_more_at_most() {
        let mut one = PositionController::default();
        let first = demand(1);
        assert_eq!(next(&mut one, &first), PositionAction::Correct(micron(5.0)));
        assert_eq!(result(&mut one, 5.0, PositionResult::Written), None);
        assert_eq!(next(&mut one, &first), PositionAction::Nothing);
        let mut second = demand(2);
        second.decision = second.decision.map(|decision| PositionDecision { cz: micron(8.0), ..decision });
        assert_eq!(next(&mut one, &second), PositionAction::Correct(micron(6.0)));
    }

    #[test]
    fn after_a_restart_it_begins_with_what_was_written_last_and_goes_on_by_a_step_at_each_decision() {
        let at = |at: u64, decided: f64| {
            let decision = PositionDecision { cz: micron(decided), target: micron(10.0), at: second(at) };
            PositionDemand { decision: Some(decision), ..demand(at) }
        };
        let mut one = PositionController::resuming(Some(micron(20.0)));
        // The axis is off for a while.
        for seconds in 1..=3 {
            assert_eq!(
                next(&mut one, &PositionDemand { decision: None, ..demand(seconds) }),
                PositionAction::Nothing
            );
        }
        let mut last = 20.0;
        for seconds in 4..=20 {
            let demand = at(seconds, 10.0);
            let PositionAction::Correct(cz) = next(&mut one, &demand) else { panic!("{seconds}") };
            assert!((cz.get() - last).abs() <= STEP + 1e-9, "{cz} after {last}");
            assert!(seconds > 4 || (cz.get() - 20.0).abs() < 1e-9, "the first is the same: {cz}");
            last = cz.get();
            let action = PositionAction::Correct(cz);
            one.result(
                &PositionTurn { demand, action, result: Some(PositionResult::Written) },
                demand.read_at,
            );
        }
        assert!((last - 10.0).abs() < 1e-9, "{last}");
        let mut unknown = PositionController::resuming(None);
        assert_eq!(next(&mut unknown, &at(1, 3.0)), PositionAction::Correct(micron(3.0)));
    }

    #[test]
    fn dashes_end_what_the_run_before_left() {
        let mut one = PositionController::resuming(Some(micron(20.0)));
        let off = PositionDemand { decision: None, may_show_dashes: true, ..demand(1) };
        let action = next(&mut one, &off);
        assert_eq!(action, PositionAction::ShowDashes);
        one.result(&PositionTurn { demand: off, action, result: Some(PositionResult::Written) }, second(1));
        assert_eq!(next(&mut one, &demand(2)), PositionAction::Correct(micron(5.0)));
    }

    #[test]
    fn a_write_that_may_have_arrived_keeps_its_cz_until_one_is_answered() {
        let mut one = PositionController::default();
        next(&mut one, &demand(1));
        result(&mut one, 5.0, PositionResult::Written);
        let lost = PositionResult::Failed { trouble: Trouble::Link, may_have_arrived: true };
        assert_eq!(result(&mut one, 6.0, lost), None);
        assert_eq!(next(&mut one, &demand(3)), PositionAction::Correct(micron(6.0)));
    }

    #[test]
    fn what_is_not_shown_is_reported_once_until_a_success() {
        let mut one = PositionController::default();
        assert_eq!(result(&mut one, 5.0, PositionResult::NotShown), Some(PositionEvent::NotShown));
        assert_eq!(result(&mut one, 5.0, PositionResult::NotShown), None);
        assert_eq!(result(&mut one, 5.0, PositionResult::Written), None);
        assert_eq!(result(&mut one, 5.0, PositionResult::NotShown), Some(PositionEvent::NotShown));
    }

    #[test]
    fn an_open_interlock_is_reported_once_and_a_position_that_waits_for_its_device_is_taken_again() {
        let mut one = PositionController::default();
        let mut step = |demand: &PositionDemand| one.next(demand, micron(STEP), demand.read_at);
        let open = |at| PositionDemand { interlock: Condition::NotMet, ..demand(at) };
        let interlocked = PositionAction::Interlocked(Condition::NotMet);
        assert_eq!(step(&open(1)), (interlocked, Some(PositionEvent::Interlocked)));
        assert_eq!(step(&open(2)), (interlocked, None));
        let resting = PositionDemand { backs_off: true, ..demand(3) };
        assert_eq!(step(&resting), (PositionAction::Nothing, None));
        let corrected = PositionAction::Correct(micron(5.0));
        assert_eq!(step(&demand(3)), (corrected, Some(PositionEvent::Released)));
    }

    #[test]
    fn the_first_position_after_an_interlock_is_a_step_from_the_cz_at_which_it_was_armed() {
        let mut one = PositionController::default();
        let at = |at: u64, cz: f64, interlock| {
            let decision = PositionDecision { cz: micron(cz), target: micron(30.0), at: second(at) };
            PositionDemand { decision: Some(decision), interlock, ..demand(at) }
        };
        for seconds in 1..=30 {
            let demand = at(seconds, f64::from(u32::try_from(seconds).unwrap()) - 1.0, Condition::NotMet);
            assert_eq!(next(&mut one, &demand), PositionAction::Interlocked(Condition::NotMet));
        }
        assert_eq!(next(&mut one, &at(31, 30.0, Condition::Met)), PositionAction::Correct(micron(1.0)));
    }

    #[test]
    fn dashes_come_when_nobody_corrects_and_again_after_ten_seconds() {
        let mut one = PositionController::default();
        let off = PositionDemand { decision: None, may_show_dashes: true, ..demand(1) };
        let mut action = |demand: &PositionDemand, at| one.next(demand, micron(STEP), second(at)).0;
        assert_eq!(action(&PositionDemand { may_show_dashes: false, ..off }, 1), PositionAction::Nothing);
        assert_eq!(action(&off, 1), PositionAction::ShowDashes);
        // The dashes were not written.
        assert_eq!(action(&off, 2), PositionAction::ShowDashes);
        let turn = PositionTurn {
            demand: off,
            action: PositionAction::ShowDashes,
            result: Some(PositionResult::Written),
        };
        assert_eq!(one.result(&turn, second(2)), None);
        let mut action = |demand: &PositionDemand, at| one.next(demand, micron(STEP), second(at)).0;
        assert_eq!(action(&off, 11), PositionAction::Nothing);
        assert_eq!(action(&off, 12), PositionAction::ShowDashes);
        let on = PositionDemand { may_show_dashes: true, ..demand(13) };
        assert_eq!(action(&on, 13), PositionAction::Correct(micron(5.0)));
    }
}
