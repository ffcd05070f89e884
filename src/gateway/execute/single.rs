//! An offset that is written by itself.

use super::demand::OutputDemand;
use super::failures::Access;
use super::register::Register;
use super::{LineTurn, MOST_EXCHANGES};
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{CallerFault, Fault};
use crate::fieldbus::wire::Request;
use crate::gateway::line_handle::LineHandle;
use isotherm_core::output::{Action, Fact, Follow, Input, NotSent, Verify};
use isotherm_core::quantity::{Counts, Moment};
use isotherm_profile::OutputId;

#[derive(Debug)]
pub(in crate::gateway) struct Single {
    register: Register,
    /// When it is to be called again, if nothing else happens.
    pub(in crate::gateway) due: Moment,
}

impl Single {
    pub(in crate::gateway) fn new(shared: &LineHandle, id: OutputId, now: Moment) -> Single {
        Single { register: Register::new(shared, id, now), due: now }
    }

    /// Returns whether its turn came too late for the last decision.
    pub(in crate::gateway) fn is_late(&self) -> bool {
        self.register.controller.follow() == Follow::Late
    }

    /// Executes what the controller asks for.
    pub(in crate::gateway) async fn turn(&mut self, turn: &mut LineTurn<'_>) {
        let (shared, now) = (turn.shared, turn.now);
        let demand = OutputDemand::of(shared, &shared.core(), self.register.id, now);
        self.register.begins_turn(shared, &demand, now);
        for _ in 0..MOST_EXCHANGES {
            let result = match self.register.action() {
                Action::Nothing { until } => {
                    self.due = until;
                    break;
                }
                Action::Read => self.read(turn).await,
                Action::Keep => match self.register.keep(turn).await {
                    Some(result) => result,
                    None => {
                        self.due = now;
                        break;
                    }
                },
                Action::Write { value, not_after, .. } => self.write(turn, value, not_after).await,
            };
            self.register.result(turn, result);
        }
        self.due = self.due.min(self.register.read_applied(turn).await);
        self.register.ends_turn(turn, &demand);
    }

    async fn read(&mut self, turn: &mut LineTurn<'_>) -> Input {
        let output = turn.shared.profile.output(self.register.id);
        let at = output.reads_at();
        let request = Request::read(&at, output.encoding.data_type);
        let read = match request {
            Some(request) => turn.line.request(output.device, request, Leave::Whenever).await,
            None => Err(Fault::Caller(CallerFault::Function)),
        };
        match read.and_then(|answered| Ok((answered.answer.believed()?, answered.asked))) {
            Ok((answer, asked)) => {
                let found = self.register.units.found(answer.registers());
                Input::Fact(Fact::Read { found, asked })
            }
            Err(fault) => {
                self.register.fail(turn.shared, fault, Access::Read);
                Input::Fact(Fact::NoAnswer)
            }
        }
    }

    async fn write(&mut self, turn: &mut LineTurn<'_>, value: Counts, not_after: Moment) -> Input {
        let output = turn.shared.profile.output(self.register.id);
        if turn.line.is_resting(output.device, turn.line.looked()) {
            return Input::NotSent(NotSent::BacksOff);
        }
        let Some(registers) = self.register.admitted(turn.shared, value) else {
            return Input::Fact(Fact::NotSent);
        };
        let functions = turn.shared.profile.device(output.device).functions;
        let request = Request::write(&output.address, registers.registers(), functions);
        let leave = match self.register.settings.verify {
            Verify::Reading => Leave::Here(not_after),
            Verify::Echo => Leave::By(not_after),
        };
        let sent = turn.line.request(output.device, request, leave).await;
        // The clock sample follows the last byte: the write left no later than that.
        let left = turn.line.looked();
        match sent {
            Ok(_) => Input::Fact(Fact::Done { left }),
            Err(fault) => self.register.failed(turn.shared, (fault, fault.outcome()), left),
        }
    }
}
