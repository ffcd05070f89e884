//! Additional interface of a Modbus connection, besides [`Wire`], the interface of every connection: late answers,
//! frames of other masters, and a read that is sent together with another request.

use std::time::Duration;

use super::reply_signature::ReplySignature;
use crate::fieldbus::error::Fault;
use crate::fieldbus::request::Request;
use crate::fieldbus::send_guard::SendGuard;
use crate::fieldbus::wire::{Boxed, Wire};
use isotherm_core::quantity::Moment;

/// Whole frame that belongs to no request of this line: another master uses the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ForeignFrame {
    /// Unit that the frame addresses, or that sent it.
    pub unit: u8,
    /// Form (function and length) of the answer; `None` if the frame belongs to no read.
    pub form: Option<ReplySignature>,
    /// Whether the frame is a request of the other master. Otherwise it is an answer.
    pub is_question: bool,
}

/// Answer that arrived on a TCP connection after its request was given up. The wire has discarded it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LateReply {
    /// Unit of the request.
    pub unit: u8,
    /// Time at which the request was sent.
    pub asked: Moment,
    /// Time at which the answer arrived; `None` if this time is not known, because the wire did not receive at that
    /// time.
    pub received: Option<Moment>,
    /// Whether the answer came from a Modbus gateway instead of the unit, as exception 10 or 11.
    pub is_of_a_gateway: bool,
}

/// Open Modbus connection, with or without transaction numbers.
pub trait ModbusWire: Wire {
    /// Returns whether an answer has a transaction number. Without one, as on a serial line, a late answer looks like
    /// the answer to the next request.
    fn has_transaction_id(&self) -> bool {
        true
    }

    /// Returns whether the last request came back as an echo, and nothing else arrived before the timeout. An adapter
    /// or a serial server without echo suppression returns each request.
    fn has_come_back(&self) -> bool {
        false
    }

    /// Sets the late answers that may still arrive, as unit and form (function and length). The wire discards these
    /// answers.
    fn pass_over(&mut self, _owed: Vec<(u8, ReplySignature)>) {}

    /// Returns the units whose late answers have arrived since the last call.
    fn received_late(&mut self) -> Vec<u8> {
        Vec::new()
    }

    /// Returns the received frames of other masters since the last call.
    fn overheard(&mut self) -> Vec<ForeignFrame> {
        Vec::new()
    }

    /// Gives up the open request after its timeout. Returns whether the connection can still be used: the wire then
    /// recognises the late answer by its transaction number, and discards it.
    fn give_up(&mut self) -> bool {
        false
    }

    /// Returns whether a late answer may still arrive on this connection, to a given up request that was sent to this
    /// unit at `asked`.
    fn expects_late(&self, _unit: u8, _asked: Moment) -> bool {
        false
    }

    /// Discards late answers that have arrived, without waiting.
    ///
    /// # Errors
    /// The connection has ended, or other input has arrived.
    fn discard_arrived(&mut self) -> Result<(), Fault> {
        Ok(())
    }

    /// Discards late answers, until the answer to the given up request `_request` (its unit and its time of sending)
    /// has arrived. The caller limits the time. The call may be cancelled at any time.
    ///
    /// # Errors
    /// The connection has ended, or other input has arrived.
    fn await_late<'a>(
        &'a mut self,
        _request: (u8, Moment),
        _send_guard: &'a mut SendGuard,
    ) -> Boxed<'a, Result<(), Fault>> {
        Box::pin(std::future::ready(Ok(())))
    }

    /// Returns the late answers that were discarded since the last call.
    fn late_replies(&mut self) -> Vec<LateReply> {
        Vec::new()
    }

    /// Discards all input during `span`. Then continues until the unit has sent nothing for the time `quiet`.
    ///
    /// # Errors
    /// The unit does not stop sending, or the connection has ended.
    fn listen(&mut self, _unit: u8, _span: Duration, _quiet: Duration) -> Boxed<'_, Result<(), Fault>> {
        Box::pin(std::future::ready(Ok(())))
    }

    /// Sets a read to send together with the next request. The next request for the same read receives the answer to
    /// the read that was already sent. A wire without transaction numbers ignores this call.
    fn set_follow_up(&mut self, _read: Option<(u8, Request<'static>)>) {}

    /// Returns true if a read that was set by [`ModbusWire::set_follow_up`] waits to be sent, or was sent and is
    /// unanswered.
    fn has_follow_up(&self) -> bool {
        false
    }

    /// Returns the read that was set by [`ModbusWire::set_follow_up`], if it was sent and is unanswered: its unit, the
    /// read, and its time of sending. The next request for the same read receives the answer to the read that was
    /// already sent.
    fn unanswered_behind(&self) -> Option<(u8, Request<'static>, Moment)> {
        None
    }

    /// Returns the form (function and length) of the answer to the last request, even if the answer is invalid. `None`
    /// if the last message was not an answer to a read, or if the wire does not record the form.
    fn received_form(&self) -> Option<ReplySignature> {
        None
    }
}
