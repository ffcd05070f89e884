//! Read that is sent in one segment after another request (`pipeline = 2`). The device receives the read while it
//! executes the first request. The next request for the same read returns the answer to the read that was already sent.
//! The age of this answer counts from the time at which the read was sent.

use crate::fieldbus::error::Fault;
use crate::fieldbus::kinds::modbus::request::ModbusRequest;
use crate::fieldbus::send_guard::SendGuard;
use crate::fieldbus::wire::{Answer, Request};
use isotherm_core::quantity::Moment;

/// Read that is sent directly after another request, without waiting for the answer to that request. At most one such
/// read is open.
#[derive(Debug, Default)]
pub(super) struct FollowUpRead {
    /// Unit and read that are sent directly after the next request; `None` if the line sends no such read.
    next: Option<(u8, ModbusRequest<'static>)>,
    open: Option<SentRead>,
}

/// Read that was sent directly after another request.
#[derive(Debug)]
struct SentRead {
    unit: u8,
    request: ModbusRequest<'static>,
    transaction: u16,
    asked: Moment,
    answer: Option<Result<Answer, Fault>>,
}

impl FollowUpRead {
    /// Sets the unit and the read to send after the next request. `None` means no read. A new read is ignored while an
    /// earlier one is unanswered.
    pub(super) fn ask(&mut self, read: Option<(u8, Request<'static>)>) {
        let is_free = self.unanswered().is_none();
        self.next = match read {
            Some((unit, Request::Modbus(read))) if is_free => Some((unit, read)),
            _ => None,
        };
    }

    /// Returns whether the line will send a read after the next request, or has sent a read that is unanswered.
    pub(super) fn is_under_way(&self) -> bool {
        self.next.is_some() || self.unanswered().is_some()
    }

    pub(super) fn take_question(&mut self) -> Option<(u8, ModbusRequest<'static>)> {
        self.next.take()
    }

    pub(super) fn left(
        &mut self,
        unit: u8,
        request: ModbusRequest<'static>,
        transaction: u16,
        asked: Moment,
    ) {
        self.open = Some(SentRead { unit, request, transaction, asked, answer: None });
    }

    /// Returns the transaction number, unit and request of the unanswered read; `None` if no read is unanswered.
    pub(super) fn unanswered(&self) -> Option<(u16, u8, ModbusRequest<'static>)> {
        let open = self.open.as_ref().filter(|open| open.answer.is_none())?;
        Some((open.transaction, open.unit, open.request))
    }

    /// Returns the unit, request and time of sending of the unanswered read; `None` if no read is unanswered.
    pub(super) fn unanswered_since(&self) -> Option<(u8, Request<'static>, Moment)> {
        let open = self.open.as_ref().filter(|open| open.answer.is_none())?;
        Some((open.unit, Request::Modbus(open.request), open.asked))
    }

    /// Removes the unanswered read, if `request` is that read, and returns its transaction number and its
    /// time of sending. Otherwise returns `None`.
    pub(super) fn take_unanswered(&mut self, unit: u8, request: ModbusRequest<'_>) -> Option<(u16, Moment)> {
        let is_it =
            |open: &mut SentRead| open.answer.is_none() && (open.unit, open.request) == (unit, request);
        let open = self.open.take_if(is_it)?;
        Some((open.transaction, open.asked))
    }

    pub(super) fn answered(&mut self, answer: Result<Answer, Fault>) {
        if let Some(open) = &mut self.open {
            open.answer = Some(answer);
        }
    }

    /// Returns the stored answer and the time at which its read was sent, if `request` is this read.
    /// Otherwise returns `None`. A stored answer is discarded if its read was sent longer ago than the
    /// timeout.
    pub(super) fn take(
        &mut self,
        unit: u8,
        request: ModbusRequest<'_>,
        send_guard: &mut SendGuard,
    ) -> Option<(Result<Answer, Fault>, Moment)> {
        let is_it = |open: &mut SentRead| (open.unit, open.request) == (unit, request);
        let open = self.open.take_if(is_it)?;
        let is_young = send_guard.is_within_timeout(open.asked);
        Some((open.answer.filter(|_| is_young)?, open.asked))
    }
}
