//! Interface of a transport: a wire sends one request and returns its answer.
//!
//! Only the implementations of [`Wire`] and [`Dial`](super::connection::Dial) depend on a transport. A new transport,
//! or the simulated device of a test, implements these two traits. A Modbus connection also implements
//! [`ModbusWire`](super::kinds::modbus::wire::ModbusWire).

use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

use super::error::Fault;
use super::send_guard::SendGuard;

pub use super::request::{
    Answer, CanRequest, ModbusRequest, NodeReading, NodeRequest, Request, SensorRequest, Stamped, TextRequest,
};

/// Boxed future, which a method of a trait object can return.
pub type Boxed<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// Future that resolves to the answer to a request.
pub type Call<'a> = Boxed<'a, Result<Answer, Fault>>;

/// Way in which a connection ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The connection was reset, or broken in the middle of an answer, or the end is unknown.
    Lost,
    /// The other end closed the connection in an orderly way, between two answers.
    Closed,
    /// Contact counts as kept, because the gateway detects an exchanged device by other means (OPC UA and CAN).
    Kept,
}

/// Open connection of one line, of any protocol.
pub trait Wire: Send {
    /// Sends the request and waits for its answer, without a timeout. The answer is checked against the request:
    /// transaction, unit, function, length, echo.
    fn exchange<'a>(&'a mut self, unit: u8, request: Request<'a>, send_guard: &'a mut SendGuard) -> Call<'a>;

    /// Returns the transmission time of the request and its answer, without the time that the device needs.
    fn time_under_way(&self, _request: Request<'_>) -> Duration {
        Duration::ZERO
    }

    /// Cancels the last exchange after its timeout. Returns [`Fault::Timeout`], or the fault of input that arrived but
    /// was no answer.
    fn missed(&mut self) -> Fault {
        Fault::Timeout
    }

    /// Returns a sentence about the last change of a subscription of the device. The next call returns `None`, unless
    /// there was another change.
    fn news(&mut self) -> Option<String> {
        None
    }

    /// Returns how the connection ended, as far as the transport can show this.
    fn ending(&mut self) -> Ending {
        Ending::Lost
    }

    /// Closes the connection in an orderly way, if the other end keeps a session for it.
    fn close(&mut self) -> Boxed<'_, ()> {
        Box::pin(std::future::ready(()))
    }
}
