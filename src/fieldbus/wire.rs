//! Interface of a transport: a wire sends one request and returns its answer.
//!
//! Only the implementations of [`Wire`] and [`Dial`](super::connection::Dial) depend on a transport. A new transport,
//! or the simulated device of a test, implements these two traits.

use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

use super::error::Fault;
use super::reply_signature::ReplySignature;
use super::send_guard::SendGuard;
use isotherm_core::quantity::Moment;

pub use super::request::{Answer, CanRequest, NodeReading, NodeRequest, Request, Stamped};

/// Boxed future, which a method of a trait object can return.
pub type Boxed<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// Future that resolves to the answer to a request.
pub type Call<'a> = Boxed<'a, Result<Answer, Fault>>;

/// How a connection ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The connection was reset, or broken in the middle of an answer, or the end is unknown.
    Lost,
    /// The other end closed the connection in an orderly way, between two answers.
    Closed,
    /// Not relevant, because the gateway detects an exchanged device by other means. This is so for OPC UA and for CAN.
    Kept,
}

/// Whole frame that neither is a request of this line nor answers one, so another master uses the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ForeignFrame {
    /// Unit that the frame addresses, or that sent it.
    pub unit: u8,
    /// Form of the answer; `None` if the frame does not belong to a read.
    pub form: Option<ReplySignature>,
    /// Whether the frame is a request. If not, it is an answer.
    pub is_question: bool,
}

/// Open connection of one line, for any protocol.
pub trait Wire: Send {
    /// Sends the request and waits for its answer, without a timeout. The answer is checked against the request:
    /// transaction, unit, function, length, echo.
    fn exchange<'a>(&'a mut self, unit: u8, request: Request<'a>, send_guard: &'a mut SendGuard) -> Call<'a>;

    /// Returns whether an answer has a transaction number. Without one, as on a serial line, a late answer looks like
    /// the answer to the next request.
    fn has_transaction_id(&self) -> bool {
        true
    }

    /// Returns the transmission time of the request and its answer, without the time that the device needs.
    fn time_under_way(&self, _request: Request<'_>) -> Duration {
        Duration::ZERO
    }

    /// Cancels the last exchange after its timeout. Returns [`Fault::Timeout`], or the fault of input that arrived but
    /// was no answer.
    fn missed(&mut self) -> Fault {
        Fault::Timeout
    }

    /// Sets the unit and form of each late answer that may still arrive. The wire discards these answers.
    fn pass_over(&mut self, _owed: Vec<(u8, ReplySignature)>) {}

    /// Returns the units whose late answers have arrived since the last call.
    fn received_late(&mut self) -> Vec<u8> {
        Vec::new()
    }

    /// Returns the frames of other masters that were received since the last call.
    fn overheard(&mut self) -> Vec<ForeignFrame> {
        Vec::new()
    }

    /// Discards all input for `span`, and then until the unit has sent nothing for `quiet`.
    ///
    /// # Errors
    /// The unit does not stop sending, or the connection has ended.
    fn listen(&mut self, _unit: u8, _span: Duration, _quiet: Duration) -> Boxed<'_, Result<(), Fault>> {
        Box::pin(std::future::ready(Ok(())))
    }

    /// Sets a unit and a read to send together with the next request. A later request for the same read returns its
    /// answer. A wire without transaction numbers ignores it.
    fn set_follow_up(&mut self, _read: Option<(u8, Request<'static>)>) {}

    /// Returns whether a read that was set by [`Wire::set_follow_up`] waits to be sent, or was sent and is unanswered.
    fn has_follow_up(&self) -> bool {
        false
    }

    /// Returns the unit, the read and its time of sending, if a read set by [`Wire::set_follow_up`] was sent and is
    /// unanswered. The next request for the same read waits for this answer.
    fn unanswered_behind(&self) -> Option<(u8, Request<'static>, Moment)> {
        None
    }

    /// Returns the form of the answer to the last request, whether the answer is valid or not. Returns `None` if the
    /// answer is not that of a read, or if the wire does not record the form.
    fn received_form(&self) -> Option<ReplySignature> {
        None
    }

    /// Returns a sentence about the last change of a subscription, once; `None` if nothing has changed.
    fn subscription_news(&mut self) -> Option<String> {
        None
    }

    /// Returns how the connection ended, as far as the wire knows it.
    fn ending(&mut self) -> Ending {
        Ending::Lost
    }

    /// Closes the connection in an orderly way, if the other end keeps state for it.
    fn close(&mut self) -> Boxed<'_, ()> {
        Box::pin(std::future::ready(()))
    }
}
