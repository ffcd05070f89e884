//! Open connection of any transport, and the interface of the objects that open connections.
//!
//! [`super::wire::Wire`] is the interface of all connections. This module distinguishes Modbus TCP, other Modbus
//! connections, and connections of any other protocol.

use std::time::Duration;

use super::error::{Fault, LinkFault};
use super::kinds::modbus::tcp::ModbusTcp;
use super::kinds::modbus::wire::ModbusWire;
use super::kinds::opcua::namespaces::NamespaceTable;
use super::send_guard::SendGuard;
use super::trace::Tap;
use super::wire::{Answer, Boxed, Request, Wire};

/// Object that opens the connections of one line, one after another.
pub trait Dial: Send {
    /// Opens a connection, without a time limit. `tap` receives the bytes of the connection, for the log of its frames.
    /// Some transports have no bytes to log.
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>>;

    /// Returns the fault to report if the other end accepts a connection and closes the connection before the first
    /// answer.
    fn turned_away(&self) -> Fault {
        Fault::Link(LinkFault::TurnedAway)
    }

    /// Returns whether the last opened connection reaches the same device as the connection before it. Returns false if
    /// the transport detects that the new connection may reach another device.
    fn resumes(&self) -> bool {
        true
    }

    /// Returns the OPC UA namespaces of the server; `None` if the protocol of the connection has no namespaces.
    fn namespaces(&self) -> Option<NamespaceTable> {
        None
    }

    /// Returns the shortest pause before the next attempt to connect, after an attempt has failed with this fault. If
    /// the pause is zero, only the back-off of the line applies.
    fn pause_after(&self, _fault: Fault) -> Duration {
        Duration::ZERO
    }

    /// Returns the time that opening a connection may take in addition to the timeout of the line.
    fn takes(&self) -> Duration {
        Duration::ZERO
    }
}

/// Open connection of a line: Modbus TCP, another Modbus connection, or a connection of another protocol.
#[allow(
    clippy::large_enum_variant,
    reason = "each bus line has only one such value, and calls of Modbus TCP through a pointer would be slower"
)]
pub enum Connection {
    /// Modbus TCP, the most common kind. Its methods are called without dynamic dispatch, which would slow down a fast
    /// loop.
    ModbusTcp(ModbusTcp),
    /// Any other Modbus connection, for example with RTU frames, called by dynamic dispatch.
    Modbus(Box<dyn ModbusWire>),
    /// Connection of any other protocol, called by dynamic dispatch.
    Other(Box<dyn Wire>),
}

impl Connection {
    /// Sends a request and waits for the answer, see [`Wire::exchange`].
    ///
    /// # Errors
    /// The reason why there is no valid answer.
    pub async fn exchange(
        &mut self,
        unit: u8,
        request: Request<'_>,
        send_guard: &mut SendGuard,
    ) -> Result<Answer, Fault> {
        match self {
            Connection::ModbusTcp(wire) => wire.exchange(unit, request, send_guard).await,
            Connection::Modbus(wire) => wire.exchange(unit, request, send_guard).await,
            Connection::Other(wire) => wire.exchange(unit, request, send_guard).await,
        }
    }

    /// Returns the connection as a [`Wire`], the interface that all connections share.
    pub fn wire(&mut self) -> &mut dyn Wire {
        match self {
            Connection::ModbusTcp(wire) => wire,
            Connection::Modbus(wire) => &mut **wire,
            Connection::Other(wire) => wire.as_mut(),
        }
    }

    /// Returns the connection as a [`ModbusWire`], which has the additional functions of Modbus; `None` if the protocol
    /// is not Modbus.
    pub fn modbus(&mut self) -> Option<&mut dyn ModbusWire> {
        match self {
            Connection::ModbusTcp(wire) => Some(wire),
            Connection::Modbus(wire) => Some(wire.as_mut()),
            Connection::Other(_) => None,
        }
    }

    /// Returns whether each answer shows to which request it belongs, by a transaction number or by rules of the
    /// protocol. If not, as on a serial line, a late answer looks like the answer to the next request.
    pub(super) fn has_transaction_id(&mut self) -> bool {
        self.modbus().is_none_or(|modbus| modbus.has_transaction_id())
    }
}
