//! Executor of an output that is written separately, and does not belong to an output set.

use super::demand::OutputDemand;
use super::failures::RequestKind;
use super::register::{OutputRegister, not_done};
use super::turn::{LineTurn, MOST_EXCHANGES};
use crate::fieldbus::error::{CallerFault, Fault};
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::Request;
use crate::gateway::shared::line_handle::LineHandle;
use crate::gateway::store::storage::OutputTransition;
use isotherm_core::output::{Action, Cause, Controller, Fact, Follow, Input, NotSent, Verify, WriteResult};
use isotherm_core::quantity::{Counts, Moment};
use isotherm_profile::OutputId;

#[derive(Debug)]
pub(in crate::gateway) struct Single {
    register: OutputRegister,
    controller: Controller,
    /// Time of the next turn of the output (work of the line task on it), if no event causes an earlier turn.
    pub(in crate::gateway) due: Moment,
}

impl Single {
    pub(in crate::gateway) fn new(shared: &LineHandle, id: OutputId, now: Moment) -> Single {
        let (register, controller) = OutputRegister::new(shared, id, false, now);
        Single { register, controller, due: now }
    }

    /// Returns whether the line task came too late to write the last decision to the output.
    pub(in crate::gateway) fn is_late(&self) -> bool {
        self.controller.follow() == Follow::Late
    }

    /// Executes one turn of the output (work of the line task on it). Carries out the actions of its controller until
    /// the controller has no further action.
    pub(in crate::gateway) async fn turn(&mut self, turn: &mut LineTurn<'_>) {
        let (shared, now) = (turn.shared, turn.now);
        let demand = OutputDemand::of(shared, &shared.core(), self.register.id, now);
        let asked = demand.in_counts(shared, self.register.id, &self.register.units);
        self.step(shared, Input::Demand(asked), now);
        for _ in 0..MOST_EXCHANGES {
            let result = match self.controller.action() {
                Action::Nothing { until } => {
                    self.due = until;
                    break;
                }
                Action::Read => self.read(turn).await,
                Action::Keep => match self.register.keep(turn, &self.controller).await {
                    Some(answer) => answer.input(),
                    None => {
                        self.due = now;
                        break;
                    }
                },
                Action::Write { value, not_after, .. } => self.write(turn, value, not_after).await,
            };
            self.result(turn, result);
        }
        if let Some(answer) = self.register.read_applied(turn, &self.controller).await {
            self.step(shared, answer.input(), turn.line.last_sample());
        }
        self.due = self.due.min(self.controller.applied_due(&self.register.settings));
        let resumes = self.step(shared, Input::TurnEnds, turn.line.last_sample());
        self.register.publish(shared, &self.controller, &demand, resumes);
    }

    /// Gives the controller the result of an exchange.
    fn result(&mut self, turn: &LineTurn<'_>, input: Input) {
        let (shared, now) = (turn.shared, turn.line.last_sample());
        if turn.line.send_guard.has_stalled() {
            self.step(shared, Input::Fact(Fact::Paused), now);
        }
        self.register.note(input);
        self.step(shared, input, now);
    }

    /// Gives the controller an input, reports its events, and writes input and action to the log. The new state is
    /// stored outside this task, so that it remains if the task fails. Returns the cause if the axis must continue
    /// from the register value.
    fn step(&mut self, shared: &LineHandle, input: Input, now: Moment) -> Option<Cause> {
        let (id, before) = (self.register.id, self.controller);
        let action = self.controller.step(&self.register.settings, input, now);
        let resumes = self.register.report_events(shared, &mut self.controller);
        let settings = &self.register.settings;
        let mut core = shared.core();
        let known = core.registers[id.0].replace(self.controller);
        if core.storage.outputs.is_kept() {
            let (is_continuous, after) = (known == Some(before), &self.controller);
            let stepped =
                OutputTransition { id, settings, before: &before, is_continuous, input, action, after };
            core.storage.outputs.stepped(&stepped, now);
        }
        resumes
    }

    async fn read(&mut self, turn: &mut LineTurn<'_>) -> Input {
        let output = turn.shared.profile.output(self.register.id);
        let at = output.reads_at();
        let request = Request::read(&at, output.encoding.data_type);
        let read = match request {
            Some(request) => turn.line.read_confirmed(output.device, request).await,
            None => Err(Fault::Caller(CallerFault::Function)),
        };
        match read.and_then(|answered| Ok((answered.answer.accepted()?, answered.asked))) {
            Ok((answer, asked)) => {
                let found = self.register.units.found(answer.registers());
                Input::Fact(Fact::Read { found, asked })
            }
            Err(fault) => {
                self.register.fail(turn.shared, &self.controller, (fault, RequestKind::Read));
                Input::Fact(Fact::NoAnswer)
            }
        }
    }

    async fn write(&mut self, turn: &mut LineTurn<'_>, value: Counts, not_after: Moment) -> Input {
        let output = turn.shared.profile.output(self.register.id);
        if turn.line.is_backing_off(output.device, turn.line.last_sample()) {
            return Input::NotSent(NotSent::BacksOff);
        }
        let Some(registers) = self.register.admitted(turn.shared, &self.controller, value) else {
            return Input::Fact(Fact::NotSent);
        };
        let functions = turn.shared.profile.device(output.device).functions;
        let request = Request::write(&output.address, registers.registers(), functions);
        let leave = match self.register.settings.verify {
            Verify::Reading => SendDeadline::OnConnection(not_after),
            Verify::Echo => SendDeadline::By(not_after),
        };
        let sent = turn.line.request(output.device, request, leave).await;
        // The clock sample follows the last byte: the write left no later than that.
        let left = turn.line.last_sample();
        let result = match sent {
            Ok(_) => WriteResult::Done,
            Err(fault) => {
                let failed = (fault, fault.outcome());
                self.register.write_failed(turn.shared, &self.controller, failed);
                not_done(failed)
            }
        };
        result.input(left)
    }
}
