//! Controller of an output set: outputs that are read, written and taken together ([`Transaction`]).
//!
//! When one output is written, all outputs of the set are written: the other outputs with the values that were just
//! read. Heartbeat and control word therefore continue in every state. A value that another client writes between this
//! read and the write is lost.
//!
//! ```text
//! Demand ─► handshake of an earlier turn ─► Keep… ─► acknowledge down? ─► Read ─► Keep… ─► Write ─► Read ─► Keep…
//!                                                                                                      │
//!                                         TurnEnds ◄─ taken ◄─ acknowledge ◄─ Raise ◄──────────────────┘
//! ```
//!
//! The caller executes each action and gives its result. A wait for the control continues in the next turn.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::controller::Controller;
use super::demand::{Input, SetCommit};
use super::handshake::HandshakeFault;
use super::heartbeat::Beat;
use super::numbers::Attempt;
use super::set::{
    OutputAnswer, OwnWords, SetAction, SetDemand, SetInput, SetSettings, SetWords, StrobeResult, WriteResult,
};
use super::set_members::{Choice, SetMembers};
use super::set_phase::{After, DropReason, NextPhase, Phase, PromiseState, Reason};
use super::set_words::WrittenWords;
use super::strobe::{AcknowledgeResult, Awaited, Strobe, StrobeLevel};
use super::transaction::Transaction;
use super::{Action, Fact};
use crate::quantity::{Counts, Moment, Shift, Shifted};

/// Minimum time between a failure and the next attempt.
const RETRY: Duration = Duration::from_secs(1);

/// Controller of a set of outputs, which are written together.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct SetController {
    members: SetMembers,
    transaction: Transaction,
    strobe: Strobe,
    demand: SetDemand,
    phase: Phase,
    /// Register values of the outputs from the last read.
    found: Vec<Counts>,
    /// Number of restarts of the control so far.
    restarts: u64,
    #[serde(flatten)]
    words: WrittenWords,
    /// Earliest time for the next attempt to write the output set.
    tries_from: Moment,
    #[serde(skip)]
    faults: Vec<HandshakeFault>,
}

impl SetController {
    /// Creates the controller of an output set at a start of the gateway. `was_in_order`: the last run was stopped
    /// cleanly, and no task of this run was interrupted.
    pub fn new(
        settings: &SetSettings,
        members: Vec<Controller>,
        (strobe, was_in_order): (Strobe, bool),
        now: Moment,
    ) -> SetController {
        let (transaction, commit) = Transaction::new(settings.taking, settings.has_number, was_in_order);
        let mut set = SetController {
            members: SetMembers::new(members),
            transaction,
            strobe,
            demand: SetDemand::default(),
            phase: Phase::Rest,
            found: Vec::new(),
            restarts: 0,
            words: WrittenWords::default(),
            tries_from: now,
            faults: Vec::new(),
        };
        set.members.commit(settings, commit, now);
        set
    }

    /// Returns the controllers of the outputs.
    pub fn members(&self) -> &[Controller] {
        self.members.controllers()
    }

    /// Returns the controllers of the outputs, mutable for their events and the end of a run.
    pub fn members_mut(&mut self) -> &mut [Controller] {
        self.members.controllers_mut()
    }

    /// Returns the state of the handshake: level of the strobe signal, and the awaited level of the acknowledge signal.
    pub fn strobe(&self) -> &Strobe {
        &self.strobe
    }

    /// Returns the failures of the handshake since the last call.
    pub fn take_faults(&mut self) -> Vec<HandshakeFault> {
        std::mem::take(&mut self.faults)
    }

    /// Returns whether it is uncertain that the control has taken the register values.
    pub fn is_bound(&self) -> bool {
        self.members.is_bound()
    }

    /// Returns whether the control word may indicate that every axis is armed.
    pub fn may_say_enabled(&self) -> bool {
        self.words.may_say_enabled()
    }

    /// Returns whether the task of the bus line began its work on an output too late for the last decision.
    pub fn is_late(&self) -> bool {
        self.members.is_late()
    }

    /// Returns whether both controllers will make the same decisions at their next call, if each gets the
    /// same new demand.
    pub fn is_like(&self, other: &SetController) -> bool {
        let with_demand = |one: &SetController| SetController { demand: self.demand.clone(), ..one.clone() };
        self.phase == Phase::Rest && *self == with_demand(other)
    }

    /// Processes an input and returns the requested exchange.
    pub fn step(&mut self, settings: &SetSettings, input: &SetInput, now: Moment) -> SetAction {
        match input {
            SetInput::Demand(demand) => self.begin_turn(demand),
            SetInput::Paused => self.members.each(settings, |_| Some(Fact::Paused.into()), now),
            SetInput::Member { place, answer } => self.answer(settings, *place, *answer, now),
            SetInput::DiskNotYet => self.disk_not_yet(settings, now),
            SetInput::Read { values, number, beat, asked } => {
                self.words.receive_beat(*beat);
                self.read(settings, (values, *number, *asked), now);
            }
            SetInput::NoAnswer => self.no_answer(settings, now),
            SetInput::Sent { result, left } => self.sent(settings, *result, *left),
            SetInput::NotAdmitted => self.give_up(settings, now),
            SetInput::Strobe(result) => self.strobe_written(settings, *result, now),
            SetInput::Acknowledge(Some(is_up)) => self.acknowledge(settings, *is_up, now),
            SetInput::Acknowledge(None) => self.acknowledge_not_read(settings, now),
            SetInput::TurnEnds => self.end_turn(settings, now),
        }
        self.next(settings, now)
    }

    fn begin_turn(&mut self, demand: &SetDemand) {
        self.demand.clone_from(demand);
        if demand.is_leaving {
            self.strobe.prepare_end();
        }
        self.phase = Phase::Handshake;
    }

    /// Ends the turn. While the output set waits for its control, the turns of the single outputs do not end.
    fn end_turn(&mut self, settings: &SetSettings, now: Moment) {
        self.phase = Phase::Rest;
        if self.strobe.awaits().is_none() {
            self.members.each(settings, |_| Some(Input::TurnEnds), now);
        }
    }

    /// Advances through the phases until an exchange is required or the set's turn is complete. Returns the exchange.
    fn next(&mut self, settings: &SetSettings, now: Moment) -> SetAction {
        loop {
            match &self.phase {
                Phase::Rest => return SetAction::Nothing { until: self.due(settings, now) },
                Phase::Handshake => self.resume_handshake(now),
                Phase::Ask(_) => return SetAction::Acknowledge,
                Phase::Drop(_) => return SetAction::Drop,
                Phase::Raise => return SetAction::Raise,
                Phase::Demand => self.demand(settings, now),
                Phase::Keep(from, then) => {
                    let Some(place) = self.members.keeps(*from) else {
                        self.phase = then.phase();
                        continue;
                    };
                    self.phase = Phase::Keep(place, *then);
                    return SetAction::Keep(place);
                }
                Phase::Decide => self.decide(settings, now),
                Phase::Clear(reason) => self.clear(settings, *reason, now),
                Phase::Read(_) => return SetAction::Read,
                Phase::Judge(reason) => self.assess(settings, *reason, now),
                Phase::GoAlong { .. } => {
                    if let Some(place) = self.piggyback(settings, now) {
                        return SetAction::Keep(place);
                    }
                }
                Phase::Write { values, own, not_after } => {
                    return SetAction::Write { values: values.clone(), own: *own, not_after: *not_after };
                }
                Phase::WriteOwn(own) => return SetAction::WriteOwn(*own),
                Phase::Confirm => self.confirm(settings, now),
            }
        }
    }

    fn answer(&mut self, settings: &SetSettings, place: usize, answer: OutputAnswer, now: Moment) {
        self.members.give(settings, place, answer.input(), now);
        match &mut self.phase {
            Phase::Keep(from, _) => *from = place + 1,
            Phase::GoAlong { promise, .. } => *promise = PromiseState::Asked,
            _ => {}
        }
    }

    fn disk_not_yet(&mut self, settings: &SetSettings, now: Moment) {
        match &mut self.phase {
            Phase::Keep(from, _) => *from += 1,
            Phase::GoAlong { .. } => self.give_up(settings, now),
            _ => {}
        }
    }

    /// Continues the handshake that an earlier turn of the output set has begun. A strobe that is still up is dropped.
    fn resume_handshake(&mut self, now: Moment) {
        self.phase = match self.strobe.next_read() {
            Some(ask) if now < ask => Phase::Rest,
            Some(_) => Phase::Ask(After::Begin),
            None if self.strobe.level() != StrobeLevel::Up => Phase::Demand,
            None if now >= self.tries_from || self.demand.is_leaving => Phase::Drop(DropReason::Left),
            None => Phase::Rest,
        };
    }

    /// Waits until the acknowledge signal is down. An acknowledge signal that rises after that belongs to the next
    /// strobe signal.
    fn clear(&mut self, settings: &SetSettings, reason: Reason, now: Moment) {
        let Some(timeout) = settings.timeout.filter(|_| !self.demand.is_leaving) else {
            self.phase = Phase::Read(NextPhase::Judge(reason));
            return;
        };
        if self.strobe.level() == StrobeLevel::Unknown {
            self.phase = Phase::Drop(DropReason::Clear(reason));
        } else {
            self.strobe.wait_for(Awaited::Clear, timeout, now);
            self.phase = Phase::Ask(After::Clear(reason));
        }
    }

    fn strobe_written(&mut self, settings: &SetSettings, result: StrobeResult, now: Moment) {
        let timeout = settings.timeout.unwrap_or_default();
        match (&self.phase, result) {
            (Phase::Raise, StrobeResult::Done) => {
                self.strobe.wait_for(Awaited::Acknowledge, timeout, now);
                self.phase = Phase::Ask(After::End);
            }
            (Phase::Raise, StrobeResult::NotDone) => {
                self.strobe.drops();
                self.fail(settings, HandshakeFault::StrobeNotWritten, now);
            }
            (Phase::Raise, StrobeResult::Unknown) => {
                self.strobe.may_rise_until(now.after(late(settings)));
                self.fail(settings, HandshakeFault::StrobeNotWritten, now);
            }
            (Phase::Drop(why), StrobeResult::Done) => {
                let why = *why;
                self.strobe.drops();
                match why {
                    DropReason::Left => self.phase = Phase::Handshake,
                    DropReason::Clear(reason) => self.phase = Phase::Clear(reason),
                    DropReason::Acknowledged(after) => {
                        self.strobe.wait_for(Awaited::Release, timeout, now);
                        self.phase = Phase::Ask(after);
                    }
                    DropReason::Failed(fault) => self.fail(settings, fault, now),
                }
            }
            (Phase::Drop(_), _) => {
                // If the strobe cannot be dropped, that failure is reported instead.
                self.report(HandshakeFault::StrobeNotDropped);
                self.doubt(settings, now);
            }
            _ => {}
        }
    }

    fn acknowledge(&mut self, settings: &SetSettings, is_up: bool, now: Moment) {
        let Phase::Ask(after) = self.phase else { return };
        match self.strobe.receive_acknowledge(is_up, now) {
            None | Some(AcknowledgeResult::NotYet) => self.phase = Phase::Rest,
            Some(AcknowledgeResult::There(Awaited::Clear)) => {
                self.phase = match after {
                    After::Clear(reason) => Phase::Read(NextPhase::Judge(reason)),
                    After::Raise => return self.raise(),
                    After::Begin | After::End => Phase::Handshake,
                }
            }
            Some(AcknowledgeResult::There(Awaited::Acknowledge)) => {
                self.transaction.attempt(Attempt::Acknowledged);
                self.phase = Phase::Drop(DropReason::Acknowledged(after));
            }
            Some(AcknowledgeResult::There(Awaited::Release)) => {
                self.taken(settings, now);
                self.phase = if after == After::End { Phase::Rest } else { Phase::Handshake };
            }
            Some(AcknowledgeResult::Missing(what)) => {
                if what == Awaited::Acknowledge {
                    self.transaction.attempt(Attempt::Refused);
                }
                self.fail(settings, what.fault(), now);
            }
        }
    }

    fn acknowledge_not_read(&mut self, settings: &SetSettings, now: Moment) {
        if self.strobe.awaits() == Some(Awaited::Acknowledge) {
            self.transaction.attempt(Attempt::Unknown);
        }
        self.fail(settings, HandshakeFault::AcknowledgeNotRead, now);
    }

    /// Handles a failed handshake: drops the strobe signal, then reports the failure.
    fn fail(&mut self, settings: &SetSettings, fault: HandshakeFault, now: Moment) {
        self.strobe.stop_waiting();
        if self.strobe.level() == StrobeLevel::Up {
            self.phase = Phase::Drop(DropReason::Failed(fault));
            return;
        }
        self.report(fault);
        self.doubt(settings, now);
    }

    fn report(&mut self, fault: HandshakeFault) {
        if self.strobe.fails(fault) {
            self.faults.push(fault);
        }
    }

    /// Records that the control has not taken the sent values, or has perhaps not taken them.
    fn doubt(&mut self, settings: &SetSettings, now: Moment) {
        self.tries_from = now.after(RETRY);
        self.transaction.doubt();
        let failed = Input::Set(SetCommit::Failed);
        self.members.each(settings, |one| one.is_driven().then_some(failed), now);
        self.phase = Phase::Rest;
    }

    /// Records that the control has taken the register values.
    fn taken(&mut self, settings: &SetSettings, now: Moment) {
        self.strobe.succeeded();
        if self.transaction.is_taken() {
            self.members.each(settings, |_| Some(Input::Set(SetCommit::Taken)), now);
        }
    }

    fn demand(&mut self, settings: &SetSettings, now: Moment) {
        let demands = self.demand.members.iter().map(|member| member.demand);
        let restarts = demands.clone().map(|demand| demand.restarts).max().unwrap_or_default();
        if std::mem::replace(&mut self.restarts, restarts) != restarts {
            self.transaction.forget_number();
        }
        self.members.demand(settings, demands, now);
        self.phase = Phase::Keep(0, NextPhase::Decide);
    }

    fn decide(&mut self, settings: &SetSettings, now: Moment) {
        // A write requested now follows a read of another turn.
        self.members.give_up_writing(settings, now);
        self.members.demand_again(settings, &mut self.transaction, &self.demand, now);
        let reason = if self.sends_anyway(settings, now) {
            Some(Reason::Send)
        } else if self.members.may_write(settings, now) {
            Some(Reason::Change)
        } else {
            self.members.is_reading().then_some(Reason::Look)
        };
        self.phase = match reason {
            None => Phase::Rest,
            Some(Reason::Look) => Phase::Read(NextPhase::Judge(Reason::Look)),
            Some(reason) => Phase::Clear(reason),
        };
    }

    /// Returns whether the output set must be sent although no output changes: for a refresh, for a new control word,
    /// or because the control has not taken the register values.
    fn sends_anyway(&self, settings: &SetSettings, now: Moment) -> bool {
        if now < self.tries_from {
            return false;
        }
        let has_words = settings.words != SetWords::None && self.demand.beat != Beat::Silent;
        let is_driven = self.members.is_driven();
        let is_due = self.words.refreshes(settings).is_some_and(|refresh| now >= refresh);
        let is_untaken = self.is_bound() && (has_words || self.members.is_settled());
        (has_words && (is_due || self.words.has_news(settings, &self.demand)))
            || (is_driven && (is_due || is_untaken))
    }

    fn read(
        &mut self,
        settings: &SetSettings,
        (values, number, asked): (&[Counts], Option<u16>, Moment),
        now: Moment,
    ) {
        let Phase::Read(then) = self.phase else { return };
        self.members.read(settings, (values, asked), now);
        self.found = values.to_vec();
        if let Some(commit) = self.transaction.read(number, values, late(settings), now) {
            self.members.commit(settings, commit, now);
        }
        self.phase = Phase::Keep(0, then);
    }

    fn no_answer(&mut self, settings: &SetSettings, now: Moment) {
        let is_reading = |one: &Controller| one.action() == Action::Read;
        self.members.each(settings, |one| is_reading(one).then_some(Fact::NoAnswer.into()), now);
        if self.phase != Phase::Read(NextPhase::Confirm) {
            self.tries_from = now.after(RETRY);
        }
        self.phase = Phase::Rest;
    }

    fn assess(&mut self, settings: &SetSettings, reason: Reason, now: Moment) {
        self.members.wait_for_each_other(settings, now);
        let is_due = self.members.is_writing() || reason == Reason::Send;
        // With `Reason::Look`, the acknowledge has not been checked. The next turn checks it.
        if !is_due || (reason == Reason::Look && settings.timeout.is_some()) {
            self.phase = Phase::Rest;
            return;
        }
        // Promises that would be dropped are not begun, because the next attempt would wait for them.
        let next = self.members.next_values(&self.found);
        if self.transaction.is_whole(&self.members.views(settings), &next) {
            let promise = PromiseState::NotAsked;
            self.phase = Phase::GoAlong { values: Vec::new(), not_after: Moment::END, promise };
        } else {
            self.give_up(settings, now);
        }
    }

    /// Chooses the value of the next output. Returns the index of the output if its state must first be saved.
    fn piggyback(&mut self, settings: &SetSettings, now: Moment) -> Option<usize> {
        let Phase::GoAlong { values, not_after, promise } = &mut self.phase else { return None };
        let place = values.len();
        let Some(found) = self.found.get(place).copied() else {
            self.go(settings);
            return None;
        };
        let may_keep = *promise == PromiseState::NotAsked;
        match self.members.choose(settings, place, (found, may_keep), now) {
            Choice::KeepsFirst => return Some(place),
            Choice::Value(value, last) => {
                values.push(value);
                (*not_after, *promise) = ((*not_after).min(last), PromiseState::NotAsked);
            }
            Choice::Nothing => self.give_up(settings, now),
        }
        None
    }

    fn go(&mut self, settings: &SetSettings) {
        let own = self.own(settings);
        if let Phase::GoAlong { values, not_after, .. } = &mut self.phase {
            self.phase = Phase::Write { values: std::mem::take(values), own, not_after: *not_after };
        }
    }

    fn own(&self, settings: &SetSettings) -> OwnWords {
        let number = settings.has_number.then(|| self.transaction.next_number());
        self.words.next(&self.demand, number)
    }

    /// Drops the writes of the outputs. Heartbeat and control word are then written alone, if the control accepts them
    /// without the values.
    fn give_up(&mut self, settings: &SetSettings, now: Moment) {
        self.members.give_up_writing(settings, now);
        let is_due = self.words.refreshes(settings).is_some_and(|refresh| now >= refresh)
            || self.words.has_news(settings, &self.demand);
        if settings.words.can_leave_alone() && self.demand.beat != Beat::Silent && is_due {
            self.phase = Phase::WriteOwn(self.own(settings));
        } else {
            self.put_off(settings, now);
        }
    }

    /// Delays the next attempt to write the set, but not beyond the time of its next refresh.
    fn put_off(&mut self, settings: &SetSettings, now: Moment) {
        let refresh = self.words.refreshes(settings).filter(|refresh| *refresh > now);
        self.tries_from = now.after(RETRY).min(refresh.unwrap_or(Moment::END));
        self.phase = Phase::Rest;
    }

    fn sent(&mut self, settings: &SetSettings, result: WriteResult, left: Moment) {
        match std::mem::take(&mut self.phase) {
            Phase::Write { values, own, .. } => {
                self.members.sent(settings, &values, result, left);
                self.words.sent(own, result, left);
                let is_done = result == WriteResult::Done;
                if result.may_have_arrived() {
                    let values = values.iter().map(|value| value.counts()).collect();
                    if let Some(commit) = self.transaction.sends(own.number, values, is_done) {
                        self.members.commit(settings, commit, left);
                    }
                }
                if is_done {
                    self.phase = Phase::Read(NextPhase::Confirm);
                } else {
                    self.tries_from = left.after(RETRY);
                }
            }
            Phase::WriteOwn(own) => {
                self.words.sent(own, result, left);
                self.put_off(settings, left);
            }
            phase => self.phase = phase,
        }
    }

    /// Checks the registers after the write. If the registers hold the sent values, the control must take these values
    /// now.
    fn confirm(&mut self, settings: &SetSettings, now: Moment) {
        self.phase = Phase::Rest;
        if !self.transaction.is_sent(&self.found) || self.demand.is_leaving {
            return;
        }
        match settings.timeout {
            None => self.taken(settings, now),
            Some(timeout) if self.strobe.may_rise(now) => {
                self.strobe.wait_for(Awaited::Clear, timeout, now);
                self.phase = Phase::Ask(After::Raise);
            }
            Some(_) => self.raise(),
        }
    }

    fn raise(&mut self) {
        self.strobe.rises();
        self.phase = Phase::Raise;
    }

    /// Returns the time at which the controller must be called next. While an acknowledge signal is awaited,
    /// [`Strobe::next_read`] gives that time.
    fn due(&self, settings: &SetSettings, now: Moment) -> Moment {
        let is_unfinished = self.strobe.level() == StrobeLevel::Up || self.is_bound();
        let tries = is_unfinished.then_some(self.tries_from.max(now));
        let refreshes = self.words.refreshes(settings).map(|at| at.max(self.tries_from));
        [self.members.wakes(now), tries, refreshes].into_iter().flatten().min().unwrap_or(Moment::END)
    }

    /// Returns a copy in which `to` is applied to every moment, for the comparison of two states that differ only in
    /// time. The demand, the faults and the events of the outputs are dropped. `now` is the earliest time of the next
    /// call of an output.
    #[doc(hidden)]
    #[must_use]
    pub fn moved(&self, to: impl Fn(Moment) -> Moment, now: Moment) -> SetController {
        SetController {
            members: self.members.moved(&to, now),
            strobe: self.strobe.moved(&to),
            transaction: self.transaction.moved(&to),
            words: self.words.moved(&to),
            tries_from: to(self.tries_from),
            demand: SetDemand::default(),
            faults: Vec::new(),
            ..self.clone()
        }
    }
}

impl Shifted for SetController {
    fn shift(&mut self, by: Shift) {
        self.members.shift(by);
        self.transaction.shift(by);
        self.strobe.shift(by);
        self.demand.shift(by);
        self.phase.shift(by);
        self.words.shift(by);
        self.tries_from.shift(by);
    }
}

/// Returns the longest delay with which a write of the output set may arrive.
fn late(settings: &SetSettings) -> Duration {
    settings.members.iter().map(|member| member.late).max().unwrap_or_default()
}
