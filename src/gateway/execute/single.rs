//! An offset that is written by itself.

use super::applied::AppliedOffset;
use super::order::Order;
use super::register::Register;
use super::{Asked, MOST_EXCHANGES, Trouble};
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{CallerFault, Fault};
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::{Answer, Request};
use crate::gateway::line_handle::LineHandle;
use isotherm_core::output::{Action, Fact, Verify};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Output, OutputId};

/// Owns one output.
#[derive(Debug)]
pub(in crate::gateway) struct Single {
    id: OutputId,
    register: Register,
    applied: AppliedOffset,
    /// When it wants to be called again.
    due: Moment,
}

impl Single {
    pub(in crate::gateway) fn new(shared: &LineHandle, id: OutputId, now: Moment) -> Single {
        Single { id, register: Register::new(shared, id, now), applied: AppliedOffset::default(), due: now }
    }

    /// When it wants to be called again, if nothing else happens.
    pub(in crate::gateway) fn due(&self) -> Moment {
        self.due
    }

    /// Its turn came too late for what was decided last.
    pub(in crate::gateway) fn is_late(&self) -> bool {
        self.register.is_late
    }

    /// Does what there is to do.
    pub(in crate::gateway) async fn turn(&mut self, line: &mut DeviceLine, shared: &LineHandle, now: Moment) {
        let output = shared.profile.output(self.id);
        let order = Order::of(shared, &shared.core(), self.id, now);
        self.register.hear(shared, output, &order, now);
        for _ in 0..MOST_EXCHANGES {
            let fact = match self.register.action {
                Action::Nothing { until } => {
                    self.due = until;
                    break;
                }
                Action::Read => self.read(line, shared, output).await,
                Action::Keep => match self.register.keep(line, shared, output, now).await {
                    Some(fact) => fact,
                    None => {
                        self.due = now;
                        break;
                    }
                },
                Action::Write { value, not_after, .. } => {
                    self.register.is_to_be_changed = false;
                    self.write(line, shared, output, value, not_after, &order).await
                }
            };
            self.register.comes_of(line, shared, output, fact);
        }
        let looks_again = self.applied.look(line, shared, output, &mut self.register).await;
        self.due = self.due.min(looks_again);
        self.register.ends_turn(line, shared, output, &order);
    }

    async fn read(&mut self, line: &mut DeviceLine, shared: &LineHandle, output: &Output) -> Fact {
        let request = Request::read(&output.reads_at(), output.encoding.data_type);
        let read = match request {
            Some(request) => line.request(output.device, request, Leave::Whenever).await,
            None => Err(Fault::Caller(CallerFault::Function)),
        };
        match read {
            Ok(answered) => {
                let found = match &answered.answer {
                    Answer::Words(words) => self.register.units.found(&output.encoding, words),
                    Answer::Bits(_) | Answer::Done => self.register.units.found(&output.encoding, &[]),
                };
                Fact::Read { found, asked: answered.asked }
            }
            Err(fault) => {
                self.register.fail(shared, output, fault, Asked::Read);
                Fact::NoAnswer
            }
        }
    }

    async fn write(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        output: &Output,
        value: i64,
        not_after: Moment,
        order: &Order,
    ) -> Fact {
        if line.is_resting(output.device, line.looked()) {
            self.register.trouble = self.register.trouble.or(Some(Trouble::Link));
            return Fact::NotSent;
        }
        let registers = self.register.units.registers(&output.encoding, value);
        let functions = shared.profile.device(output.device).functions;
        let request = Request::write(&output.address, registers.words(), functions);
        let leave = match self.register.settings.verify {
            Verify::Reading => Leave::Here(not_after),
            Verify::Echo => Leave::By(not_after),
        };
        let sent = line.request(output.device, request, leave).await;
        // Looked at after its last byte: it left no later than that.
        let left = line.looked();
        match sent {
            Ok(_) => Fact::Done { left },
            Err(fault) => self.register.failed(shared, output, order, (fault, fault.outcome()), left),
        }
    }
}
