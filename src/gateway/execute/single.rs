//! An offset that is written by itself.

use super::order::Order;
use super::register::Register;
use super::trouble::{Access, Trouble};
use super::{LineTurn, MOST_EXCHANGES, applied};
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{CallerFault, Fault};
use crate::fieldbus::wire::Request;
use crate::gateway::line_handle::LineHandle;
use isotherm_core::output::{Action, Fact, Verify};
use isotherm_core::quantity::{Counts, Moment};
use isotherm_profile::OutputId;

#[derive(Debug)]
pub(in crate::gateway) struct Single {
    register: Register,
    /// When it wants to be called again, if nothing else happens.
    pub(in crate::gateway) due: Moment,
}

impl Single {
    pub(in crate::gateway) fn new(shared: &LineHandle, id: OutputId, now: Moment) -> Single {
        Single { register: Register::new(shared, id, now), due: now }
    }

    /// Its turn came too late for what was decided last.
    pub(in crate::gateway) fn is_late(&self) -> bool {
        self.register.is_late
    }

    /// Does what there is to do.
    pub(in crate::gateway) async fn turn(&mut self, turn: &mut LineTurn<'_>) {
        let (shared, now) = (turn.shared, turn.now);
        let order = Order::of(shared, &shared.core(), self.register.id, now);
        self.register.hear(shared, &order, now);
        for _ in 0..MOST_EXCHANGES {
            let fact = match self.register.action {
                Action::Nothing { until } => {
                    self.due = until;
                    break;
                }
                Action::Read => self.read(turn).await,
                Action::Keep => match self.register.keep(turn).await {
                    Some(fact) => fact,
                    None => {
                        self.due = now;
                        break;
                    }
                },
                Action::Write { value, not_after, .. } => {
                    self.register.is_to_be_changed = false;
                    self.write(turn, value, not_after, &order).await
                }
            };
            self.register.comes_of(turn, fact);
        }
        self.due = self.due.min(applied::look(&mut self.register, turn).await);
        self.register.ends_turn(turn, &order);
    }

    async fn read(&mut self, turn: &mut LineTurn<'_>) -> Fact {
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
                Fact::Read { found, asked }
            }
            Err(fault) => {
                self.register.fail(turn.shared, fault, Access::Read);
                Fact::NoAnswer
            }
        }
    }

    async fn write(
        &mut self,
        turn: &mut LineTurn<'_>,
        value: Counts,
        not_after: Moment,
        order: &Order,
    ) -> Fact {
        let output = turn.shared.profile.output(self.register.id);
        if turn.line.is_resting(output.device, turn.line.looked()) {
            self.register.troubles.now = self.register.troubles.now.or(Some(Trouble::Link));
            return Fact::NotSent;
        }
        let Some(registers) = self.register.admitted(turn.shared, value) else { return Fact::NotSent };
        let functions = turn.shared.profile.device(output.device).functions;
        let request = Request::write(&output.address, registers.registers(), functions);
        let leave = match self.register.settings.verify {
            Verify::Reading => Leave::Here(not_after),
            Verify::Echo => Leave::By(not_after),
        };
        let sent = turn.line.request(output.device, request, leave).await;
        // Looked at after its last byte: it left no later than that.
        let left = turn.line.looked();
        match sent {
            Ok(_) => Fact::Done { left },
            Err(fault) => self.register.failed(turn.shared, order, (fault, fault.outcome()), left),
        }
    }
}
