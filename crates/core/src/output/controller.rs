//! Controller of one output. It decides what is sent to the register, when it is sent, and what the results mean.
//!
//! The function [`step`](super::step) chooses the next exchange with the register or the disk. The controller
//! works in *turns*: the task of the bus line gives the output a turn, which lasts from
//! [`Input::Demand`](super::Input::Demand) to [`Input::TurnEnds`](super::Input::TurnEnds). The controller
//! makes the other decisions:
//! - which decision of the axis the register step receives;
//! - when the axis resumes from the register value;
//! - what a failure means;
//! - what the interlock, the applied value and the set of the output allow.
//!
//! The caller passes inputs and executes actions, but makes no decisions.
//!
//! ```text
//! Demand ─► action ─► exchange ─► result ─► action ─► … ─► Nothing ─► TurnEnds
//! ```
//!
//! # How the output follows its axis
//! | state | event | next |
//! |---|---|---|
//! | any | the axis holds its offset, and the register value differs | `TakeOver`, once for each register value |
//! | any | own write arrived late, control restarted, interlock closed, failure over, disk works again | `TakeOver` |
//! | any but `TakeOver` | the last moment of a decision of the model passed | `Late` |
//! | any but `TakeOver` | the last moment of a fault action passed | `TakeOver` |
//! | any but `TakeOver` | the turn ends, and a change waits for a late write | `Waiting` |
//! | `Waiting` | the turn ends, and no change waits | `TakeOver` |
//! | `Late`, `HoldAt` | another decision | `Target` |
//! | `TakeOver` | the turn ends, armed and without trouble | `HoldAt`; the axis resumes from the verified value |

use std::mem::{replace, take};

use serde::{Deserialize, Serialize};

use super::applied::Applied;
use super::demand::{Condition, Demand, Input, Mode, NotSent, OutputDecision, SetCommit};
use super::follow::{Cause, Follow, OutputHealth, Trouble};
use super::reports::{ReportedTopics, Topic};
use super::settings::{Settings, Verify};
use super::slots::Slots;
use super::state_parts::ArmState;
use super::{Action, Event, Fact, State, step};
use crate::quantity::{Counts, Moment, Shift, Shifted, shifted};

/// Capacity for the events of one input. One input always causes fewer events.
pub const MOST_EVENTS: usize = 24;

/// Controller of one output. It contains the state of the register, and the state of its own decisions (policy).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Controller {
    state: State,
    policy: Policy,
    #[serde(skip)]
    events: Slots<Event, MOST_EVENTS>,
}

/// State of a controller, apart from the state of its register: the pending exchange, and whether the output follows
/// the decisions of its axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Policy {
    /// Exchange that was requested and has no result yet.
    action: Action,
    inputs: LastInputs,
    follow: Follow,
    mode: Mode,
    trouble: Option<Trouble>,
    applied: Applied,
    set: SetCommit,
    said: ReportedTopics,
}

/// Values of the last demand. A difference from the next demand shows what has changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
struct LastInputs {
    is_armed: bool,
    restarts: u64,
    pauses: u64,
    decided: Moment,
}

shifted!(LastInputs: decided);
shifted!(Policy: action, inputs, applied);

impl Shifted for Controller {
    fn shift(&mut self, by: Shift) {
        self.state.shift(by);
        self.policy.shift(by);
    }
}

impl Controller {
    /// Creates the controller of an output at a start of the gateway. `pauses` is the number of pauses of the computer
    /// so far.
    pub fn new(settings: &Settings, state: State, pauses: u64, now: Moment) -> Controller {
        let mut policy =
            Policy { inputs: LastInputs { pauses, ..LastInputs::default() }, ..Policy::default() };
        if is_open(&state, settings) {
            policy.said.first(Topic::Division);
        }
        policy.action = Action::Nothing { until: now };
        Controller::resumed(state, policy)
    }

    /// Creates a controller from states that were recorded earlier.
    pub fn resumed(state: State, policy: Policy) -> Controller {
        Controller { state, policy, events: Slots::default() }
    }

    /// Ends every pending exchange, because the task that executed it was interrupted.
    pub fn interrupted(&mut self, settings: &Settings, now: Moment) {
        let ends = [Fact::Paused, Fact::Unknown { left: now }, Fact::NoAnswer, Fact::NotKept, Fact::NoAnswer];
        for fact in ends {
            let _ = step(&mut self.state, settings, fact, now);
        }
        self.policy.action = Action::Nothing { until: now };
        debug_assert!(!self.state.is_asking(), "every open action has ended");
    }

    /// Returns the state of the register, for example its last verified value.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Returns the state of the register, which the caller changes at the end of a run.
    pub fn state_mut(&mut self) -> &mut State {
        &mut self.state
    }

    /// Returns the state of the controller, apart from the state of its register.
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Returns whether the output follows the decisions of its axis, and if it does not, the reason.
    pub fn follow(&self) -> Follow {
        self.policy.follow
    }

    /// Returns the reason why the register does not hold the decided value. `None` if there is no trouble.
    pub fn trouble(&self) -> Option<Trouble> {
        self.policy.trouble
    }

    /// Returns the exchange that was requested and has no result yet, or else [`Action::Nothing`].
    pub fn action(&self) -> Action {
        self.policy.action
    }

    /// Returns the events since the last call of this function, oldest first.
    pub fn take_events(&mut self) -> Slots<Event, MOST_EVENTS> {
        take(&mut self.events)
    }

    /// Returns whether the axis is armed and the interlock closed.
    pub fn is_driven(&self) -> bool {
        self.policy.inputs.is_armed && !self.state.is_interlocked()
    }

    /// Returns whether the axis is armed.
    pub fn is_armed(&self) -> bool {
        self.policy.inputs.is_armed
    }

    /// Returns whether it is uncertain that the control has taken the register values of the output set.
    pub fn is_bound(&self) -> bool {
        self.policy.set != SetCommit::Taken
    }

    /// Returns the last verified register value. If it is unknown, returns the bias, the register value for an offset
    /// of zero.
    pub fn held(&self, settings: &Settings) -> Counts {
        self.state.shown(settings).verified.map_or(settings.bias, |seen| seen.value)
    }

    /// Returns whether the caller must wait until the state is saved on disk. Some values must be on disk before they
    /// are sent. New parts of a shared register (operator offset, gateway share) are reported only after they are
    /// saved.
    pub fn must_keep(&self, settings: &Settings) -> bool {
        let mut said = self.policy.said;
        let has_to_report = is_open(&self.state, settings) && said.first(Topic::Division);
        settings.promises() && (self.state.is_promising() || has_to_report)
    }

    /// Returns the health of the output. `None` until its register has been read.
    pub fn health(&self, settings: &Settings, interlock: Condition) -> Option<OutputHealth> {
        let shown = self.state.shown(settings);
        let _ = shown.verified?;
        Some(match (shown.standing, interlock) {
            (ArmState::Barred, _) => OutputHealth::Foreign,
            (_, Condition::Unknown) if self.state.is_interlocked() => OutputHealth::Unverified,
            // The health stays the same when the condition is met again, until the axis has resumed from the register
            // value.
            _ if self.state.is_interlocked() => OutputHealth::Interlocked,
            _ if self.policy.trouble.is_some() => OutputHealth::Unverified,
            _ => OutputHealth::Verified,
        })
    }

    /// Processes an input and returns the requested exchange. While another exchange is pending, the result is
    /// [`Action::Nothing`].
    pub fn step(&mut self, settings: &Settings, input: Input, now: Moment) -> Action {
        let before = self.policy.action;
        match input {
            Input::Demand(demand) => self.demand(settings, &demand, now),
            Input::Fact(fact) => self.result(settings, fact, now),
            Input::NotSent(why) => self.not_sent(settings, why, now),
            Input::OnDisk => self.on_disk(settings, now),
            Input::Applied { found, asked } => self.applied(settings, found, asked),
            Input::AppliedNoAnswer { asked } => self.applied_no_answer(asked),
            Input::Set(commit) => self.set(settings, commit),
            Input::TurnEnds => self.turn_ends(settings, now),
        }
        if let (Some(_), Some(value)) = (&settings.applied, self.state.acknowledged()) {
            self.policy.applied.register_is(value, now);
        }
        let is_open = !matches!(before, Action::Nothing { .. }) && !input.is_result();
        if is_open && self.policy.action == before {
            Action::Nothing { until: Moment::END }
        } else {
            self.policy.action
        }
    }

    /// Returns the time of the next read of the applied value.
    pub fn applied_due(&self, settings: &Settings) -> Moment {
        settings.applied.map_or(Moment::END, |applied| self.policy.applied.due(&applied, settings.every))
    }

    fn demand(&mut self, settings: &Settings, demand: &Demand, now: Moment) {
        if replace(&mut self.policy.inputs.pauses, demand.pauses) != demand.pauses {
            self.give(settings, Fact::Paused, now);
        }
        if replace(&mut self.policy.inputs.restarts, demand.restarts) != demand.restarts {
            self.give(settings, Fact::Restarted, now);
        }
        let is_armed = demand.armed.is_some();
        let was_armed = replace(&mut self.policy.inputs.is_armed, is_armed);
        if is_armed {
            // The interlock comes first, because arming alone can request a write.
            self.interlock(settings, demand.interlock, now);
        }
        if was_armed != is_armed {
            if is_armed {
                self.policy.said.over(Topic::Question);
            }
            // Arming or disarming does not end the trouble with a device that does not answer.
            self.policy.trouble = self.policy.trouble.filter(|trouble| *trouble == Trouble::Link);
            let fact = demand.armed.map_or(Fact::Off, |by| Fact::Armed { by });
            self.give(settings, fact, now);
        }
        if !is_armed {
            self.interlock(settings, demand.interlock, now);
        }
        if !is_armed && self.policy.follow == Follow::Late {
            self.policy.follow = Follow::Target;
        }
        let may_decide = is_armed && demand.interlock == Condition::Met && !self.is_bound();
        if let Some(decision) = demand.decision.filter(|_| may_decide && !self.is_unapplied(settings))
            && replace(&mut self.policy.inputs.decided, decision.at) != decision.at
        {
            self.decide(settings, &decision, now);
        }
        self.give(settings, Fact::Look, now);
    }

    /// Records the condition of the interlock. When the interlock closes, the axis always resumes from the register
    /// value.
    fn interlock(&mut self, settings: &Settings, condition: Condition, now: Moment) {
        let is_armed = self.policy.inputs.is_armed;
        let is_held = is_armed && condition != Condition::Met;
        // If the condition is unknown, the lost signal is reported instead.
        if is_held && condition == Condition::NotMet && self.policy.said.first(Topic::Interlock) {
            self.report(Event::Interlocked);
        }
        if !is_held && self.policy.said.over(Topic::Interlock) && is_armed {
            self.report(Event::Released);
        }
        if is_held != self.state.is_interlocked() {
            self.give(settings, if is_held { Fact::Interlocked } else { Fact::Released }, now);
            if !is_held {
                self.policy.follow.take_over();
            }
        }
    }

    /// Processes a new decision. An axis that holds its offset requests no write. Such an axis resumes from the
    /// register value if the register value differs from the offset of the axis.
    fn decide(&mut self, settings: &Settings, decision: &OutputDecision, now: Moment) {
        if self.policy.follow == Follow::Late {
            self.policy.follow = Follow::Target;
        }
        self.policy.mode = decision.mode;
        self.check_range(settings, decision.offset);
        let is_changed = !self.state.is_at(settings, decision.offset);
        let is_untaken = self.policy.trouble.is_some_and(Trouble::is_untaken);
        // An offset that the register did not take is sent again, even if the axis holds it.
        if decision.mode == Mode::Hold && !is_untaken {
            let verified = self.state.shown(settings).verified.map(|seen| seen.value);
            if is_changed && verified.is_some_and(|value| self.policy.follow != Follow::HoldAt(value)) {
                self.policy.follow.take_over();
            }
            return self.give(settings, Fact::Lapsed, now);
        }
        if matches!(self.policy.follow, Follow::HoldAt(_)) {
            self.policy.follow = Follow::Target;
        }
        if self.policy.trouble == Some(Trouble::Disk) {
            // When the disk works again, the axis resumes from the register value.
            return self.give(settings, Fact::Lapsed, now);
        }
        if is_changed && now > decision.not_after {
            return self.lapsed(decision.not_after);
        }
        let OutputDecision { offset, target, not_after, .. } = *decision;
        self.give(settings, Fact::Decided { offset, target, not_after }, now);
    }

    /// Reports a decision that exceeds the range of the register.
    fn check_range(&mut self, settings: &Settings, offset: Counts) {
        let account = self.state.shown(settings).account;
        let value = account.map_or(settings.bias, |account| account.base) + offset;
        let (lowest, highest) = settings.range;
        if (lowest..=highest).contains(&value) {
            self.policy.said.over(Topic::Range);
        } else if self.policy.said.first(Topic::Range) {
            self.report(Event::Saturated { value });
        }
    }

    /// Handles a decision whose last moment has passed, because its readings are too old. The next decision is sent. A
    /// fault action starts again from the register value.
    fn lapsed(&mut self, not_after: Moment) {
        match self.policy.mode {
            Mode::Follow => {
                self.policy.follow.late();
                self.report(Event::Late { not_after });
            }
            Mode::Hold | Mode::Finish => self.policy.follow.take_over(),
        }
    }

    /// Processes a fact, which may be the result of an exchange.
    fn result(&mut self, settings: &Settings, fact: Fact, now: Moment) {
        let is_shown = self.state.has_answered() && self.policy.inputs.is_armed;
        let expected = self.state.expected_offset(settings);
        match fact {
            Fact::NoAnswer => self.fails(Trouble::Link),
            Fact::Unknown { .. } => self.write_fails(Trouble::Unanswered),
            Fact::Refused => self.write_fails(Trouble::Untaken),
            _ => {}
        }
        if Input::Fact(fact).is_result() {
            self.policy.action = Action::Nothing { until: now };
        }
        self.give(settings, fact, now);
        match fact {
            Fact::Done { .. } => self.answered(settings, settings.verify == Verify::Echo),
            Fact::Read { .. } => {
                if expected.is_some() && self.state.expected_offset(settings) != expected {
                    self.policy.follow.take_over();
                }
                self.answered(settings, is_shown);
            }
            Fact::NotKept => self.policy.trouble = self.policy.trouble.or(Some(Trouble::Disk)),
            _ => {}
        }
    }

    /// Records a failed request. A failed write takes precedence over a failed read.
    fn fails(&mut self, trouble: Trouble) {
        let is_of_a_write = |known: Trouble| known.is_untaken() || known == Trouble::Unanswered;
        if !self.policy.trouble.is_some_and(is_of_a_write) {
            self.policy.trouble = Some(trouble);
        }
    }

    /// Records a failed write. A failure while the axis is off is not recorded: the register value is then only sent
    /// along with other outputs of its output set.
    fn write_fails(&mut self, trouble: Trouble) {
        if self.policy.inputs.is_armed {
            self.fails(trouble);
        }
    }

    /// Processes an answer of the device. `is_written` means that the register holds the written value.
    fn answered(&mut self, settings: &Settings, is_written: bool) {
        if self.state.shown(settings).is_untaken {
            let before = self.policy.trouble;
            if before != Some(Trouble::Unanswered) && !before.is_some_and(Trouble::is_untaken) {
                self.policy.trouble = Some(Trouble::Untaken);
            }
            if before.is_some_and(Trouble::is_untaken) {
                self.report(Event::StillUntaken);
            }
            return;
        }
        if is_written {
            self.report(Event::Written);
        }
        if !self.is_bound() && !self.is_unapplied(settings) {
            self.recover();
        }
    }

    /// Ends the trouble, because the register holds the expected value and can be written. Trouble with the disk stays.
    fn recover(&mut self) {
        if let Some(trouble) = self.policy.trouble.filter(|trouble| *trouble != Trouble::Disk) {
            self.policy.trouble = None;
            self.report(Event::Recovered { was_untaken: trouble == Trouble::StillUntaken });
            self.policy.follow.take_over();
        }
    }

    fn not_sent(&mut self, settings: &Settings, why: NotSent, now: Moment) {
        let change = match self.policy.action {
            Action::Write { not_after, is_repeat: false, .. } => Some(not_after),
            _ => None,
        };
        match why {
            NotSent::TooLate => {
                if let Some(not_after) = change {
                    self.lapsed(not_after);
                }
            }
            NotSent::Unreachable => self.write_fails(Trouble::Unanswered),
            NotSent::Rejected => self.write_fails(Trouble::Untaken),
            NotSent::BacksOff => self.policy.trouble = self.policy.trouble.or(Some(Trouble::Link)),
        }
        self.result(settings, Fact::NotSent, now);
    }

    fn on_disk(&mut self, settings: &Settings, now: Moment) {
        if self.policy.trouble == Some(Trouble::Disk) {
            self.policy.trouble = None;
            self.policy.follow.take_over();
        }
        if is_open(&self.state, settings)
            && let Some(account) = self.state.shown(settings).account
            && self.policy.said.first(Topic::Division)
        {
            self.report(Event::Opened { base: account.base, share: account.share });
        }
        self.result(settings, Fact::Kept, now);
    }

    fn applied(&mut self, settings: &Settings, found: Option<i64>, asked: Moment) {
        let Some(applied) = &settings.applied else { return };
        if self.policy.applied.read(found, asked, applied) {
            self.policy.said.over(Topic::Applied);
            // The control may apply a value other than one that was written and refused.
            if !self.is_bound() && !self.state.shown(settings).is_untaken {
                self.recover();
            }
            return;
        }
        if self.policy.applied.is_over(asked, applied) && self.is_driven() {
            self.is_not_taken();
            if self.policy.said.first(Topic::Applied) {
                self.report(Event::NotApplied);
            }
        } else if self.policy.trouble.is_some_and(Trouble::is_untaken) {
            self.policy.said.over(Topic::Applied);
        }
    }

    /// Records that a read of the applied value was not answered. The missing answer does not count as trouble while
    /// the control is known to apply the register value.
    fn applied_no_answer(&mut self, asked: Moment) {
        self.policy.applied.no_answer(asked);
        if !self.policy.applied.is_applied() {
            self.fails(Trouble::Link);
        }
    }

    /// Returns whether the control has not yet confirmed that it applies the register value.
    fn is_unapplied(&self, settings: &Settings) -> bool {
        let is_known = self.state.shown(settings).verified.is_some();
        settings.applied.is_some() && is_known && self.is_driven() && !self.policy.applied.is_applied()
    }

    fn set(&mut self, settings: &Settings, commit: SetCommit) {
        self.policy.set = commit;
        match commit {
            SetCommit::Taken if !self.state.shown(settings).is_untaken => self.recover(),
            SetCommit::Taken | SetCommit::Open => {}
            SetCommit::Failed => self.is_not_taken(),
        }
    }

    /// Records that the control did not take the register value.
    fn is_not_taken(&mut self) {
        if self.is_driven() {
            if !self.policy.trouble.is_some_and(Trouble::is_untaken) {
                self.policy.trouble = Some(Trouble::Untaken);
            }
            self.report(Event::StillUntaken);
        }
    }

    /// Ends the turn of the output (the work of the bus line's task on it). A requested read or write that was not
    /// executed is dropped.
    fn turn_ends(&mut self, settings: &Settings, now: Moment) {
        let given_up = match self.policy.action {
            Action::Nothing { .. } | Action::Keep => None,
            Action::Read => Some(Fact::NoAnswer),
            Action::Write { .. } => Some(Fact::NotSent),
        };
        if let Some(fact) = given_up {
            self.policy.action = Action::Nothing { until: now };
            self.give(settings, fact, now);
        }
        if let Some(not_after) = self.state.overdue(settings, now) {
            self.lapsed(not_after);
            self.give(settings, Fact::Lapsed, now);
        }
        self.ask(settings);
        let shown = self.state.shown(settings);
        let follow = &mut self.policy.follow;
        match (*follow, shown.waits_until) {
            (Follow::TakeOver(_), _) => {}
            (_, Some(_)) => *follow = Follow::Waiting,
            (Follow::Waiting, None) => follow.take_over(),
            _ => {}
        }
        if let (Follow::TakeOver(cause), Some(seen)) = (*follow, shown.verified) {
            if !self.policy.inputs.is_armed {
                *follow = Follow::Target;
            } else if self.policy.trouble.is_none() {
                *follow = Follow::HoldAt(seen.value);
                self.report(Event::TakeOver { cause });
            }
        }
        if self.policy.trouble == Some(Trouble::Untaken) {
            self.policy.trouble = Some(Trouble::StillUntaken);
        }
    }

    /// Disarms the axis if only the operator can say which part of the register value is the operator offset. The axis
    /// stays off until the operator arms it.
    fn ask(&mut self, settings: &Settings) {
        let shown = self.state.shown(settings);
        let is_asked = settings.is_shared && shown.standing == ArmState::Barred && shown.verified.is_some();
        if is_asked && self.policy.said.first(Topic::Question) {
            self.policy.inputs.is_armed = false;
            self.report(Event::Question);
        }
    }

    /// Passes a fact to [`step`]. Stores the action that it returns, unless another action is pending.
    fn give(&mut self, settings: &Settings, fact: Fact, now: Moment) {
        let was_open = is_open(&self.state, settings);
        let action = step(&mut self.state, settings, fact, now);
        if is_open(&self.state, settings) && !was_open {
            self.policy.said.over(Topic::Division);
        }
        if matches!(self.policy.action, Action::Nothing { .. }) {
            self.policy.action = action;
        }
        for event in self.state.take_events().iter() {
            match event {
                Event::CncRestarted { .. } => self.policy.follow = Follow::TakeOver(Cause::Restart),
                Event::ForeignValue { .. } => {
                    self.policy.follow = Follow::Target;
                    self.policy.inputs.is_armed = false;
                }
                _ => {}
            }
            self.report(*event);
        }
    }

    fn report(&mut self, event: Event) {
        // The capacity is larger than the number of events of one input.
        let _ = self.events.push(event);
    }

    /// Returns a copy in which `to` is applied to every moment, for the comparison of two states that differ only in
    /// time. The events are dropped. `now` is the earliest time of the next call.
    #[doc(hidden)]
    pub fn moved(&self, to: impl Fn(Moment) -> Moment, now: Moment) -> Controller {
        let Policy { inputs, applied, action, .. } = self.policy;
        let inputs = LastInputs { decided: to(inputs.decided), ..inputs };
        let action = match action.moved(&to) {
            Action::Nothing { until } => Action::Nothing { until: until.max(now) },
            action => action,
        };
        let policy = Policy { action, inputs, applied: applied.moved(&to), ..self.policy };
        Controller { state: self.state.moved(&to), policy, events: Slots::default() }
    }
}

/// Returns whether both parts of a shared register's value are known for certain: operator offset and gateway share.
fn is_open(state: &State, settings: &Settings) -> bool {
    state.shown(settings).account.is_some_and(|account| account.doubt.is_none())
}
