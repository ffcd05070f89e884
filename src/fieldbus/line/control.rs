//! Control questions: additional reads for a unit behind a Modbus gateway (from TCP to a serial line). The
//! answers to these reads show whether the unit's answers belong to their requests. See
//! [`order_check`](crate::fieldbus::kinds::modbus::order_check).
//!
//! `place` is the index of a unit in the list of the line.

use super::DeviceLine;
use crate::fieldbus::error::Fault;
use crate::fieldbus::kinds::modbus::reply_signature::ReplySignature;
use crate::fieldbus::wire::{Answer, Request};
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

impl DeviceLine {
    /// Returns the control question to send before this request: an extra read that checks the order of the answers.
    /// `None` if none is needed or possible.
    pub(super) fn control_question(&self, place: usize, request: Request<'_>) -> Option<Request<'static>> {
        let unit = self.units.at(place);
        // If each answer ends its connection, the control question would need another connection.
        if !unit.is_behind_gateway || unit.quirks.close_after_each {
            return None;
        }
        let pending = self.units.pending.get(unit.number)?;
        // A repeated read may be answered by the answer to its first attempt.
        if pending.first_asked(request).is_some() {
            return None;
        }
        // A late answer would be taken for the answer to the control question.
        let is_allowed = |read: Request<'static>| {
            unit.functions.allow(read.function())
                && pending.marks().all(|mark| mark != ReplySignature::of(read))
        };
        pending.order.control(request, is_allowed)
    }

    /// Records the result of a control question (extra read that checks the order of the answers). Returns whether the
    /// waiting request may be sent, because the unit has answered with data or with a refusal.
    pub(super) fn may_follow(
        &mut self,
        place: usize,
        control: Request<'static>,
        answer: &Result<Answer, Fault>,
    ) -> bool {
        let Err(fault) = answer else { return true };
        self.units.pending(place).order.record_failed_control(control, *fault);
        fault.is_refusal() && !fault.is_of_a_gateway()
    }

    /// Stops requests to the unit for a time, because its Modbus gateway has sent the answer to an earlier request. The
    /// time doubles with each such answer, even if some answers in between were correct.
    pub(super) fn rest_out_of_order(&mut self, place: usize, now: Moment) {
        let lost = self.units.pending(place).order.lost;
        let breaker = &mut self.units.at_mut(place).breaker;
        if lost > 0 {
            breaker.succeed();
        }
        (0..lost).for_each(|_| breaker.fail(now));
    }

    /// Reports the result of a request to the observer, unless the gateway itself rejected the request before sending.
    pub(super) fn report(&self, device: DeviceId, request: Request<'_>, answer: &Result<Answer, Fault>) {
        let Some(observer) = &self.observer else { return };
        if !matches!(answer, Err(Fault::Caller(_) | Fault::UNVERIFIED)) {
            let outcome = answer.as_ref().map(|_| ()).map_err(|fault| *fault);
            observer.note(device, request, outcome, self.refusals());
        }
    }

    /// Reports to the observer that the device has answered a request with at least a part of the requested data.
    pub(super) fn report_delivery(&self, device: DeviceId, request: Request<'_>) {
        let Some(observer) = &self.observer else { return };
        observer.note_delivery(device, request, self.refusals(), self.send_guard.last_sample());
    }
}
