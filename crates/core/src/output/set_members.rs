//! Controllers of the outputs of a set, and their common decisions.

use serde::{Deserialize, Serialize};

use super::controller::Controller;
use super::demand::{Demand, Input, SetCommit};
use super::follow::Follow;
use super::set::{SetDemand, SetSettings, SetValue, WriteResult};
use super::settings::Settings;
use super::transaction::{Member, Transaction};
use super::{Action, Fact};
use crate::quantity::{Counts, Moment, Shift, Shifted};

/// Controllers of the outputs of a set, in the order of the outputs in its settings.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct SetMembers {
    controllers: Vec<Controller>,
}

/// Value of an output in the next request.
pub(super) enum Choice {
    /// Value to send, and the last moment for sending it.
    Value(SetValue, Moment),
    /// The state of the output must first be saved to disk.
    KeepsFirst,
    /// The output must not be written now.
    Nothing,
}

impl SetMembers {
    pub(super) fn new(controllers: Vec<Controller>) -> SetMembers {
        SetMembers { controllers }
    }

    pub(super) fn controllers(&self) -> &[Controller] {
        &self.controllers
    }

    pub(super) fn controllers_mut(&mut self) -> &mut [Controller] {
        &mut self.controllers
    }

    fn with<'a>(&'a self, settings: &'a SetSettings) -> impl Iterator<Item = (&'a Controller, &'a Settings)> {
        self.controllers.iter().zip(&settings.members)
    }

    fn with_mut<'a>(
        &'a mut self,
        settings: &'a SetSettings,
    ) -> impl Iterator<Item = (&'a mut Controller, &'a Settings)> {
        self.controllers.iter_mut().zip(&settings.members)
    }

    /// Passes an input to the output with this index.
    pub(super) fn give(
        &mut self,
        settings: &SetSettings,
        place: usize,
        input: impl Into<Input>,
        now: Moment,
    ) {
        if let Some((controller, settings)) = self.with_mut(settings).nth(place) {
            controller.step(settings, input.into(), now);
        }
    }

    /// Passes to each output the input that `input` returns for it.
    pub(super) fn each(
        &mut self,
        settings: &SetSettings,
        input: impl Fn(&Controller) -> Option<Input>,
        now: Moment,
    ) {
        for (controller, settings) in self.with_mut(settings) {
            if let Some(input) = input(controller) {
                controller.step(settings, input, now);
            }
        }
    }

    /// Passes to each output its demand, in the order of the outputs.
    pub(super) fn demand(
        &mut self,
        settings: &SetSettings,
        demands: impl Iterator<Item = Demand>,
        now: Moment,
    ) {
        for ((controller, settings), demand) in self.with_mut(settings).zip(demands) {
            controller.step(settings, Input::Demand(demand), now);
        }
    }

    /// Requests that the values of the last write are sent again, if the registers hold only a part of them.
    pub(super) fn demand_again(
        &mut self,
        settings: &SetSettings,
        transaction: &mut Transaction,
        demand: &SetDemand,
        now: Moment,
    ) {
        let views = self.views(settings);
        let until = |place: usize| demand.members.get(place).and_then(|member| member.again_until);
        let is_missing = |place: usize, value: Counts| {
            views.get(place).is_some_and(|view| view.is_driven && value != view.held)
        };
        let can_be = |place: usize, value: Counts| {
            let step = settings.members.get(place).map_or(Counts::ZERO, |settings| settings.step);
            let is_near =
                views.get(place).is_some_and(|view| value.abs_diff(view.held) <= step.unsigned_abs());
            !is_missing(place, value) || (is_near && until(place).is_some_and(|until| now <= until))
        };
        let Some(values) = transaction.demanded_again(&views, can_be) else { return };
        for (place, (controller, settings)) in self.with_mut(settings).enumerate() {
            if let Some(value) = values.get(place).copied().filter(|value| is_missing(place, *value)) {
                let (offset, not_after) = (value - settings.bias, until(place).unwrap_or_default());
                controller.step(settings, Fact::Decided { offset, target: None, not_after }.into(), now);
            }
        }
    }

    pub(super) fn action(&self, place: usize) -> Action {
        self.controllers.get(place).map_or(Action::Nothing { until: Moment::END }, Controller::action)
    }

    /// Returns the index of the first output, from `from` on, whose state must be saved to disk. `None` if there is no
    /// such output.
    pub(super) fn keeps(&self, from: usize) -> Option<usize> {
        (from..self.controllers.len()).find(|place| self.action(*place) == Action::Keep)
    }

    pub(super) fn is_reading(&self) -> bool {
        self.controllers.iter().any(|one| one.action() == Action::Read)
    }

    pub(super) fn is_writing(&self) -> bool {
        self.controllers.iter().any(is_writing)
    }

    pub(super) fn is_bound(&self) -> bool {
        self.controllers.iter().any(Controller::is_bound)
    }

    pub(super) fn is_driven(&self) -> bool {
        self.controllers.iter().any(Controller::is_driven)
    }

    pub(super) fn is_settled(&self) -> bool {
        self.controllers.iter().all(|one| one.state().is_settled())
    }

    pub(super) fn is_late(&self) -> bool {
        self.controllers.iter().any(|one| one.follow() == Follow::Late)
    }

    /// Returns whether at least one output of the set will request a write if the next read shows the
    /// expected values.
    pub(super) fn may_write(&self, settings: &SetSettings, now: Moment) -> bool {
        self.with(settings).any(|(controller, settings)| controller.state().may_write(settings, now))
    }

    /// Returns the earliest time at which an output must be called. `None` if the output set has no outputs.
    pub(super) fn wakes(&self, now: Moment) -> Option<Moment> {
        let wakes = self.controllers.iter().map(|one| match one.action() {
            Action::Nothing { until } => until,
            _ => now,
        });
        wakes.min()
    }

    /// Returns the state of each output as [`Transaction`] needs it: register value, permission to write, and whether
    /// the control may still have to take this value.
    pub(super) fn views(&self, settings: &SetSettings) -> Vec<Member> {
        let view = |(one, settings): (&Controller, _)| Member {
            held: one.held(settings),
            is_driven: one.is_driven(),
            is_bound: one.is_bound(),
        };
        self.with(settings).map(view).collect()
    }

    /// Passes `commit` (whether the control has taken the output set) to each output whose present state is
    /// different.
    pub(super) fn commit(&mut self, settings: &SetSettings, commit: SetCommit, now: Moment) {
        let is_open = commit != SetCommit::Taken;
        self.each(settings, |one| (one.is_bound() != is_open).then_some(Input::Set(commit)), now);
    }

    pub(super) fn give_up_writing(&mut self, settings: &SetSettings, now: Moment) {
        self.each(settings, |one| is_writing(one).then_some(Fact::NotSent.into()), now);
    }

    /// Passes the register values to the outputs. An output with an open interlock ignores them: its control may be off
    /// or starting.
    pub(super) fn read(&mut self, settings: &SetSettings, (values, asked): (&[Counts], Moment), now: Moment) {
        for ((controller, settings), found) in self.with_mut(settings).zip(values) {
            let learns = match controller.action() {
                Action::Read => true,
                Action::Nothing { .. } => !controller.state().is_interlocked(),
                Action::Keep | Action::Write { .. } => false,
            };
            if learns {
                controller.step(settings, Fact::Read { found: *found, asked }.into(), now);
            }
        }
    }

    /// Makes all outputs wait if one of them may not take its next step, because a late write may still arrive. Outputs
    /// whose values the control takes together must move together.
    pub(super) fn wait_for_each_other(&mut self, settings: &SetSettings, now: Moment) {
        let waits = self
            .with(settings)
            .any(|(one, settings)| one.is_armed() && one.state().shown(settings).waits_until.is_some());
        let is_change = |one: &Controller| matches!(one.action(), Action::Write { is_repeat: false, .. });
        if waits {
            self.each(settings, |one| is_change(one).then_some(Fact::NotSent.into()), now);
        }
    }

    /// Returns the values of the next request: the new value of each output that changes, and the value in `found` of
    /// each other output.
    pub(super) fn next_values(&self, found: &[Counts]) -> Vec<Counts> {
        let next = self.controllers.iter().zip(found).map(|(one, found)| match one.action() {
            Action::Write { value, is_repeat: false, .. } => value,
            _ => *found,
        });
        next.collect()
    }

    /// Chooses the value of an output whose register holds `found`. If the output is not written, it keeps the register
    /// value. `may_keep`: the state of the output may be saved to disk first.
    pub(super) fn choose(
        &mut self,
        settings: &SetSettings,
        place: usize,
        (found, may_keep): (Counts, bool),
        now: Moment,
    ) -> Choice {
        let Some((one, settings)) = self.with_mut(settings).nth(place) else { return Choice::Nothing };
        if !is_writing(one) {
            if one.state().is_interlocked() {
                return Choice::Value(SetValue::AsRead(found), Moment::END);
            }
            one.step(settings, Fact::PiggybackAsked.into(), now);
        }
        match one.action() {
            Action::Keep if may_keep => Choice::KeepsFirst,
            Action::Write { value, not_after, is_repeat: false } => {
                Choice::Value(SetValue::New(value), not_after)
            }
            Action::Write { .. } if one.held(settings) == found => {
                Choice::Value(SetValue::AsRead(found), Moment::END)
            }
            _ => Choice::Nothing,
        }
    }

    /// Passes the result of a write to the outputs.
    pub(super) fn sent(
        &mut self,
        settings: &SetSettings,
        values: &[SetValue],
        result: WriteResult,
        left: Moment,
    ) {
        let is_done = result == WriteResult::Done;
        for ((one, settings), value) in self.with_mut(settings).zip(values) {
            if is_writing(one) {
                one.step(settings, result.input(left), left);
            } else if result.may_have_arrived() {
                let fact = Fact::Piggybacked { value: value.counts(), left, is_done };
                one.step(settings, fact.into(), left);
            }
        }
    }

    pub(super) fn moved(&self, to: impl Fn(Moment) -> Moment, now: Moment) -> SetMembers {
        SetMembers { controllers: self.controllers.iter().map(|one| one.moved(&to, now)).collect() }
    }
}

fn is_writing(one: &Controller) -> bool {
    matches!(one.action(), Action::Write { .. })
}

impl Shifted for SetMembers {
    fn shift(&mut self, by: Shift) {
        self.controllers.shift(by);
    }
}
