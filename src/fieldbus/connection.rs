//! Open connection of any transport, and its opening.
//!
//! The trait [`super::wire::Wire`] depends on no transport. This module selects among the transports of Modbus.

use std::time::Duration;

use super::error::{Fault, LinkFault};
use super::local_tcp::LocalTcp;
use super::modbus::ModbusTcp;
use super::namespaces::NamespaceTable;
#[cfg(not(feature = "opcua"))]
use super::opcua_fault::OpcUaFault;
use super::rtu::Rtu;
use super::send_guard::SendGuard;
use super::serial::{PortHistory, SerialPort};
use super::tcp::connected;
use super::tls::{self, Client};
use super::trace::Tap;
use super::wire::{Answer, Boxed, Request, Wire};
use crate::tls::TlsFault;
use isotherm_profile::{Bus, Serial, Transport};

/// Opens the connections of one line, one after the other.
pub trait Dial: Send {
    /// Opens a connection; there is no time limit. `tap` receives the bytes of the connection, for the log of its
    /// frames. Some transports have no bytes to log.
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>>;

    /// Returns the fault to report if the other end closes a connection before its first answer.
    fn turned_away(&self) -> Fault {
        Fault::Link(LinkFault::TurnedAway)
    }

    /// Returns whether the last opened connection continues the one before it. Returns false if the transport detects
    /// that another device may be at its other end.
    fn resumes(&self) -> bool {
        true
    }

    /// Returns the namespaces of the server; `None` if its protocol has none.
    fn namespaces(&self) -> Option<NamespaceTable> {
        None
    }

    /// Returns the time that opening may take in addition to the timeout of the line.
    fn takes(&self) -> Duration {
        Duration::ZERO
    }
}

/// Opens the connections of one Modbus line.
pub(super) struct ModbusDial {
    address: String,
    timeout: Duration,
    over: LineTransport,
}

/// Transport of a Modbus line.
enum LineTransport {
    Tcp,
    /// Modbus inside TLS. `None`: the files in `tls` are unusable, as [`tls::check`] reports.
    Tls(Option<Client>),
    RtuOverTcp,
    Serial(Serial, PortHistory),
}

impl ModbusDial {
    /// Returns a dial for the address of this bus; `None` for CAN, OPC UA and the sensors of this computer. The system
    /// closes a TCP connection if the other end does not acknowledge data within the timeout of the bus.
    pub(super) fn new(bus: &Bus) -> Option<ModbusDial> {
        let over = match (&bus.transport, &bus.tls) {
            (Transport::Tcp, None) => LineTransport::Tcp,
            (Transport::Tcp, Some(tls)) => LineTransport::Tls(Client::new(tls).ok()),
            (Transport::RtuOverTcp, _) => LineTransport::RtuOverTcp,
            (Transport::Serial(serial), _) => LineTransport::Serial(*serial, PortHistory::default()),
            (Transport::Can | Transport::OpcUa | Transport::Sysfs, _) => return None,
        };
        Some(ModbusDial { address: bus.address.clone(), timeout: bus.timeout, over })
    }

    async fn open(&mut self, tap: &Tap) -> Result<Connection, Fault> {
        if let LineTransport::Serial(serial, history) = &mut self.over {
            let opened = SerialPort::open(&self.address, *serial);
            *history = history.and(opened.as_ref().ok().map(SerialPort::identity));
            let port = opened.map_err(Fault::Link)?;
            return Ok(Connection::Other(Box::new(Rtu::new(port, Some(*serial), tap))));
        }
        if matches!(self.over, LineTransport::Tls(None)) {
            return Err(Fault::Link(LinkFault::Tls(TlsFault::OurFiles)));
        }
        let stream = connected(&self.address, self.timeout).await?;
        Ok(match &self.over {
            LineTransport::RtuOverTcp => Connection::Other(Box::new(Rtu::new(stream, None, tap))),
            LineTransport::Tls(Some(client)) => {
                Connection::Modbus(ModbusTcp::new(client.secure(stream).await?, tap))
            }
            _ => Connection::Modbus(ModbusTcp::new(LocalTcp::new(stream), tap)),
        })
    }
}

impl Dial for ModbusDial {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        Box::pin(self.open(tap))
    }

    fn turned_away(&self) -> Fault {
        Fault::Link(match self.over {
            // With TLS 1.3, a device checks the gateway's certificate after the handshake, and not every device sends
            // the reason.
            LineTransport::Tls(_) => LinkFault::Tls(TlsFault::TurnedAway),
            _ => LinkFault::TurnedAway,
        })
    }

    /// Returns false if another serial port has taken over the name of the opened one. A port that was unplugged is
    /// reported by the line itself.
    fn resumes(&self) -> bool {
        match self.over {
            LineTransport::Serial(_, history) => history.resumes(),
            LineTransport::Tcp | LineTransport::Tls(_) | LineTransport::RtuOverTcp => true,
        }
    }

    fn takes(&self) -> Duration {
        if matches!(self.over, LineTransport::Tls(_)) { tls::HANDSHAKE } else { Duration::ZERO }
    }
}

/// Dial that opens nothing, because the program was built without the feature `opcua`.
#[cfg(not(feature = "opcua"))]
pub(super) struct NotBuiltIn;

#[cfg(not(feature = "opcua"))]
impl Dial for NotBuiltIn {
    fn dial<'a>(&'a mut self, _: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        Box::pin(std::future::ready(Err(Fault::Link(LinkFault::OpcUa(OpcUaFault::NotBuiltIn)))))
    }
}

/// An open connection of any kind.
#[allow(
    clippy::large_enum_variant,
    reason = "there is one value for each line, and Modbus TCP must not be called through a pointer"
)]
pub enum Connection {
    /// Modbus TCP, the most common transport. It is called without dynamic dispatch, whose cost is measurable in a fast
    /// loop.
    Modbus(ModbusTcp),
    /// Connection of any other transport, called by dynamic dispatch.
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
            Connection::Modbus(wire) => wire.exchange(unit, request, send_guard).await,
            Connection::Other(wire) => wire.exchange(unit, request, send_guard).await,
        }
    }

    /// Returns the connection as a [`Wire`].
    pub fn wire(&mut self) -> &mut dyn Wire {
        match self {
            Connection::Modbus(wire) => wire,
            Connection::Other(wire) => wire.as_mut(),
        }
    }
}
