//! The small border behind which a transport lives: a wire carries one request and brings one answer.
//!
//! Everything the gateway knows of a transport is in the files that implement [`Wire`] and
//! [`Dial`](super::connection::Dial); another one, or a test's own device, replaces them in a day.

use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

use super::departure::Departure;
use super::error::Fault;
use super::owed::Mark;

pub use super::request::{Answer, CanRequest, NodeReading, NodeRequest, Request, Stamped};

/// A future that a trait object can return.
pub type Boxed<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// How a connection ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Reset, broken in the middle of an answer, or not known.
    Lost,
    /// Closed by the other end in order, between two answers.
    Closed,
    /// The wire or its owner recognises an exchanged device by other means, as OPC UA and frames do.
    Kept,
}

/// A whole frame that neither asks nor answers anything for this line: another master speaks there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overheard {
    /// Unit that is asked or answers.
    pub unit: u8,
    /// Form of the answer; `None` if it is no read.
    pub form: Option<Mark>,
    /// It is a request, not an answer.
    pub is_question: bool,
}

/// An open connection.
pub trait Wire: Send {
    /// Sends the request and waits for its answer, for as long as it takes. The answer has been checked against the
    /// request: transaction, unit, function, length, echo.
    fn exchange<'a>(
        &'a mut self,
        unit: u8,
        request: Request<'a>,
        departure: &'a mut Departure,
    ) -> Boxed<'a, Result<Answer, Fault>>;

    /// Whether an answer names the question it belongs to. Where it does not, as on a serial line, a late answer looks
    /// like the one to the next question.
    fn has_transaction_id(&self) -> bool {
        true
    }

    /// How long the question and its answer are under way by themselves, beyond what the device needs.
    fn time_under_way(&self, _request: Request<'_>) -> Duration {
        Duration::ZERO
    }

    /// The last call was given up: what it waited for in vain, or what came instead.
    fn missed(&mut self) -> Fault {
        Fault::Timeout
    }

    /// What units may still answer to questions that were given up: it is passed over when it comes.
    fn pass_over(&mut self, _owed: Vec<(u8, Mark)>) {}

    /// The units that have answered such a question since this was last asked.
    fn heard_late(&mut self) -> Vec<u8> {
        Vec::new()
    }

    /// Returns the frames of other masters since the last call.
    fn overheard(&mut self) -> Vec<Overheard> {
        Vec::new()
    }

    /// Discards whatever comes for this long, and until nothing has come from the unit for a while.
    ///
    /// # Errors
    /// It does not become quiet, or the connection is at its end.
    fn listen(&mut self, _unit: u8, _span: Duration, _quiet: Duration) -> Boxed<'_, Result<(), Fault>> {
        Box::pin(std::future::ready(Ok(())))
    }

    /// This read goes out with the next question, behind it, and whoever asks it next is given its answer. Nothing on a
    /// wire whose answers do not name their questions.
    fn ask_behind(&mut self, _read: Option<(u8, Request<'static>)>) {}

    /// One goes out with the next question, or has not been answered.
    fn has_behind(&self) -> bool {
        false
    }

    /// What there is to say of a subscription, once.
    fn subscription_news(&mut self) -> Option<String> {
        None
    }

    /// Returns how the connection ended, as far as the wire knows.
    fn ending(&mut self) -> Ending {
        Ending::Lost
    }

    /// Takes leave of the other end, where that keeps something for this one until then.
    fn close(&mut self) -> Boxed<'_, ()> {
        Box::pin(std::future::ready(()))
    }
}
