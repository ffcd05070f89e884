//! An open connection of any kind, and what opens one.
//!
//! The border itself ([`super::wire`]) knows no transport. Here the one that most have is known by name.

use std::time::Duration;

use super::departure::Departure;
use super::error::{Fault, LinkFault};
use super::modbus::ModbusTcp;
use super::trace::Tap;
use super::wire::{Answer, Boxed, Request, Wire};

/// What opens connections.
pub trait Dial: Send {
    /// Opens one, for as long as it takes.
    fn dial(&mut self) -> Boxed<'_, Result<Connection, Fault>>;

    /// From now on the bytes of its connections pass this tap. One that does not know how leaves the wire log without
    /// bytes.
    fn tap(&mut self, _tap: &Tap) {}

    /// What it means that the other end closes a connection before its first answer.
    fn turned_away(&self) -> Fault {
        Fault::Link(LinkFault::TurnedAway)
    }

    /// How long that may take beyond the line's timeout.
    fn takes(&self) -> Duration {
        Duration::ZERO
    }
}

/// An open connection of any kind.
pub enum Connection {
    /// The kind that most have, spoken to without a detour: a loop that runs freely would feel it.
    Modbus(ModbusTcp),
    /// Any other.
    Other(Box<dyn Wire>),
}

impl Connection {
    /// As [`Wire::exchange`].
    ///
    /// # Errors
    /// Whatever makes the answer unusable.
    pub async fn exchange(
        &mut self,
        unit: u8,
        request: Request<'_>,
        departure: &mut Departure,
    ) -> Result<Answer, Fault> {
        match self {
            Connection::Modbus(wire) => wire.exchange(unit, request, departure).await,
            Connection::Other(wire) => wire.exchange(unit, request, departure).await,
        }
    }

    /// As [`Wire::time_under_way`].
    pub fn time_under_way(&self, request: Request<'_>) -> Duration {
        match self {
            Connection::Modbus(wire) => wire.time_under_way(request),
            Connection::Other(wire) => wire.time_under_way(request),
        }
    }

    /// It as any kind of wire.
    pub fn wire(&mut self) -> &mut dyn Wire {
        match self {
            Connection::Modbus(wire) => wire,
            Connection::Other(wire) => wire.as_mut(),
        }
    }
}
