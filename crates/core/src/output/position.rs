//! Controller of a corrected position: value of each write, and meaning of its result.
//!
//! The newest position goes out at once in every armed state, also while the axis holds. Only the Cz inside follows rules: [`Inside`].
//!
//! | the turn has | what happens |
//! |---|---|
//! | a display, and no axis that is on or no usable position | dashes, now and every ten seconds |
//! | no new position | nothing |
//! | an axis that is off, or a dry run | nothing: the next Cz is the decided one |
//! | a device that backs off | nothing: the position is taken again |
//! | an open interlock, or one whose signal is not known | nothing |
//! | a new position | position and Cz |

use std::time::Duration;

use super::demand::Condition;
use super::follow::Trouble;
use super::inside::Inside;
use crate::quantity::{Micron, Moment};

/// A display that was switched off and on shows something else: dashes are written again after this time.
const DASHES_AGAIN: Duration = Duration::from_secs(10);

/// Controller of a corrected position.
#[derive(Clone, Debug, Default)]
pub struct PositionController {
    /// When the position was read that was corrected last.
    corrected: Moment,
    inside: Inside,
    /// When a display was last given dashes. `None` while it shows a value.
    dashes_at: Option<Moment>,
    trouble: Option<Trouble>,
    interlock: Interlock,
}

/// Interlock as it was reported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Interlock {
    #[default]
    Closed,
    Open,
}

/// Demand on a corrected position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionDemand {
    /// When the newest position was read.
    pub read_at: Moment,
    /// The position can be used.
    pub is_usable: bool,
    /// Decision of the axis. `None` if the axis is off, and in a dry run.
    pub decision: Option<PositionDecision>,
    /// Condition of the interlock.
    pub interlock: Condition,
    /// The line backs off from the device.
    pub backs_off: bool,
}

/// Decision of an axis about a corrected position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionDecision {
    /// Cz.
    pub cz: Micron,
    /// Target of Cz.
    pub target: Micron,
    /// When the axis decided.
    pub at: Moment,
}

/// Action on a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PositionAction {
    /// Nothing.
    Nothing,
    /// Nothing: the interlock does not allow it, or its signal is not known.
    Interlocked(Condition),
    /// Write the position with this Cz.
    Correct(Micron),
}

/// Result of a write of a corrected position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PositionResult {
    /// Answered as done and, if that is read, read back.
    Written,
    /// Another value was read back.
    NotShown,
    /// Not sent, because its time was over.
    Lapsed,
    /// Not answered as done.
    Failed {
        /// The device did not answer, or does not take it.
        trouble: Trouble,
        /// The request was sent, and the device may carry it out.
        may_have_arrived: bool,
    },
}

/// Event of a corrected position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PositionEvent {
    /// The interlock is open.
    Interlocked,
    /// The interlock is closed again.
    Released,
    /// Another value was read back than was written. The next is reported after a success.
    NotShown,
    /// The device shows what is written again.
    Verified,
}

impl PositionController {
    /// Returns whether a display is to be given dashes: nobody corrects its position.
    pub fn shows_nothing(&self, demand: &PositionDemand, now: Moment) -> bool {
        let is_fresh = self.dashes_at.is_some_and(|at| now < at.after(DASHES_AGAIN));
        (demand.decision.is_none() || !demand.is_usable) && !demand.backs_off && !is_fresh
    }

    /// The display shows dashes.
    pub fn nothing_is_shown(&mut self, now: Moment) {
        (self.dashes_at, self.inside) = (Some(now), Inside::Nothing);
    }

    /// Returns whether this position was corrected already.
    pub fn has_corrected(&self, read_at: Moment) -> bool {
        self.corrected == read_at
    }

    /// Decides about the newest position. `step`: largest change of Cz.
    pub fn next(&mut self, demand: &PositionDemand, step: Micron) -> (PositionAction, Option<PositionEvent>) {
        if self.has_corrected(demand.read_at) {
            return (PositionAction::Nothing, None);
        }
        let Some(PositionDecision { cz, target, at }) = demand.decision else {
            (self.corrected, self.inside) = (demand.read_at, Inside::Nothing);
            return (PositionAction::Nothing, None);
        };
        if demand.backs_off {
            return (PositionAction::Nothing, None);
        }
        self.corrected = demand.read_at;
        if !demand.is_usable {
            return (PositionAction::Nothing, None);
        }
        let event = self.interlock_is(demand.interlock);
        match demand.interlock {
            Condition::Met => (PositionAction::Correct(self.inside.next((cz, target, at), step)), event),
            condition => (PositionAction::Interlocked(condition), event),
        }
    }

    /// If the condition is not known, the lost signal is reported.
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

    /// Takes note of the result of a write with this Cz, after the decision of this moment.
    pub fn result(&mut self, (cz, at): (Micron, Moment), result: PositionResult) -> Option<PositionEvent> {
        match result {
            PositionResult::Written => {
                (self.inside, self.dashes_at) = (Inside::Written(cz, at), None);
                let was_untaken = self.trouble.take() == Some(Trouble::Untaken);
                was_untaken.then_some(PositionEvent::Verified)
            }
            PositionResult::NotShown => {
                self.inside = Inside::Sent(cz);
                let before = self.trouble.replace(Trouble::Untaken);
                (before != Some(Trouble::Untaken)).then_some(PositionEvent::NotShown)
            }
            PositionResult::Lapsed => None,
            PositionResult::Failed { trouble, may_have_arrived } => {
                if may_have_arrived {
                    self.inside = Inside::Sent(cz);
                }
                let is_worse = |known: &Trouble| *known == Trouble::Untaken;
                self.trouble = self.trouble.filter(is_worse).or(Some(trouble));
                None
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 1.0;

    fn micron(value: f64) -> Micron {
        Micron::new(value).unwrap()
    }

    fn demand(second: u64) -> PositionDemand {
        let at = Moment::from_nanos(second * 1_000_000_000);
        let decision = PositionDecision { cz: micron(5.0), target: micron(9.0), at };
        PositionDemand {
            read_at: at,
            is_usable: true,
            decision: Some(decision),
            interlock: Condition::Met,
            backs_off: false,
        }
    }

    fn next(one: &mut PositionController, demand: &PositionDemand) -> PositionAction {
        one.next(demand, micron(STEP)).0
    }

    #[test]
    fn each_position_is_corrected_once_and_by_a_step_more_at_most() {
        let mut one = PositionController::default();
        let first = demand(1);
        assert_eq!(next(&mut one, &first), PositionAction::Correct(micron(5.0)));
        let written = (micron(5.0), first.read_at);
        assert_eq!(one.result(written, PositionResult::Written), None);
        assert_eq!(next(&mut one, &first), PositionAction::Nothing);
        let mut second = demand(2);
        second.decision = second.decision.map(|decision| PositionDecision { cz: micron(8.0), ..decision });
        assert_eq!(next(&mut one, &second), PositionAction::Correct(micron(6.0)));
    }

    #[test]
    fn a_write_that_may_have_arrived_keeps_its_cz_until_one_is_answered() {
        let mut one = PositionController::default();
        let at = demand(1).read_at;
        next(&mut one, &demand(1));
        one.result((micron(5.0), at), PositionResult::Written);
        let lost = PositionResult::Failed { trouble: Trouble::Link, may_have_arrived: true };
        assert_eq!(one.result((micron(6.0), at), lost), None);
        assert_eq!(next(&mut one, &demand(3)), PositionAction::Correct(micron(6.0)));
    }

    #[test]
    fn what_is_not_shown_is_reported_once_and_its_end_too() {
        let (mut one, at) = (PositionController::default(), demand(1).read_at);
        let cz = (micron(5.0), at);
        assert_eq!(one.result(cz, PositionResult::NotShown), Some(PositionEvent::NotShown));
        assert_eq!(one.result(cz, PositionResult::NotShown), None);
        assert_eq!(one.result(cz, PositionResult::Written), Some(PositionEvent::Verified));
        assert_eq!(one.result(cz, PositionResult::Written), None);
    }

    #[test]
    fn an_open_interlock_is_reported_once_and_a_position_that_waits_for_its_device_is_taken_again() {
        let mut one = PositionController::default();
        let open = |second| PositionDemand { interlock: Condition::NotMet, ..demand(second) };
        let interlocked = PositionAction::Interlocked(Condition::NotMet);
        assert_eq!(one.next(&open(1), micron(STEP)), (interlocked, Some(PositionEvent::Interlocked)));
        assert_eq!(one.next(&open(2), micron(STEP)), (interlocked, None));
        let resting = PositionDemand { backs_off: true, ..demand(3) };
        assert_eq!(one.next(&resting, micron(STEP)), (PositionAction::Nothing, None));
        let corrected = PositionAction::Correct(micron(5.0));
        assert_eq!(one.next(&demand(3), micron(STEP)), (corrected, Some(PositionEvent::Released)));
    }

    #[test]
    fn dashes_come_when_nobody_corrects_and_again_after_ten_seconds() {
        let mut one = PositionController::default();
        let off = PositionDemand { decision: None, ..demand(1) };
        let second = |second: u64| Moment::from_nanos(second * 1_000_000_000);
        assert!(one.shows_nothing(&off, second(1)) && !one.shows_nothing(&demand(1), second(1)));
        one.nothing_is_shown(second(1));
        assert!(!one.shows_nothing(&off, second(10)) && one.shows_nothing(&off, second(11)));
    }
}
