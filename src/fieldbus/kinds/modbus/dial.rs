//! Opens the connections of a Modbus line, over each of its transports.

use std::time::Duration;

use super::ascii::AsciiPort;
use super::rtu::Rtu;
use super::tcp::ModbusTcp;
use crate::fieldbus::connection::{Connection, Dial};
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::local_tcp::LocalTcp;
use crate::fieldbus::serial::{PortHistory, SerialPort};
use crate::fieldbus::tcp::connected;
use crate::fieldbus::tls::{self, Client};
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::Boxed;
use crate::tls::TlsFault;
use isotherm_profile::{Bus, Serial, Transport};

/// Opener of the connections of one Modbus line.
pub(super) struct ModbusDial {
    address: String,
    timeout: Duration,
    over: LineTransport,
}

/// Transport of a Modbus line, with the settings that opening the connection requires.
enum LineTransport {
    Tcp,
    /// Modbus TCP inside TLS. `None`: the files in `tls` are unusable, as [`tls::check`] reports.
    Tls(Option<Client>),
    RtuOverTcp,
    AsciiOverTcp,
    Serial(Serial, PortHistory),
    SerialAscii {
        serial: Serial,
        data_bits: u8,
        history: PortHistory,
    },
}

impl ModbusDial {
    /// Returns a connection opener (dial) for the address of this bus; `None` for another type of bus. A TCP connection
    /// ends if the other end has not confirmed data within the timeout of the bus.
    pub(super) fn new(bus: &Bus) -> Option<ModbusDial> {
        let over = match (&bus.transport, &bus.tls) {
            (Transport::Tcp, None) => LineTransport::Tcp,
            (Transport::Tcp, Some(tls)) => LineTransport::Tls(Client::new(tls).ok()),
            (Transport::RtuOverTcp, _) => LineTransport::RtuOverTcp,
            (Transport::ModbusAsciiOverTcp, _) => LineTransport::AsciiOverTcp,
            (Transport::Serial(serial), _) => LineTransport::Serial(*serial, PortHistory::default()),
            (Transport::ModbusAscii { serial, data_bits }, _) => LineTransport::SerialAscii {
                serial: *serial,
                data_bits: *data_bits,
                history: PortHistory::default(),
            },
            _ => return None,
        };
        Some(ModbusDial { address: bus.address.clone(), timeout: bus.timeout, over })
    }

    async fn open(&mut self, tap: &Tap) -> Result<Connection, Fault> {
        if let LineTransport::Serial(serial, history) = &mut self.over {
            let opened = SerialPort::open(&self.address, *serial);
            *history = history.and(opened.as_ref().ok().map(SerialPort::identity));
            let port = opened.map_err(Fault::Link)?;
            return Ok(Connection::Modbus(Box::new(Rtu::new(port, Some(*serial), tap))));
        }
        if let LineTransport::SerialAscii { serial, data_bits, history } = &mut self.over {
            let opened = SerialPort::open_for_text(&self.address, *serial, *data_bits);
            *history = history.and(opened.as_ref().ok().map(SerialPort::identity));
            let port = AsciiPort::new(opened.map_err(Fault::Link)?);
            return Ok(Connection::Modbus(Box::new(Rtu::new(port, Some(serial.for_ascii()), tap))));
        }
        if matches!(self.over, LineTransport::Tls(None)) {
            return Err(Fault::Link(LinkFault::Tls(TlsFault::OurFiles)));
        }
        let stream = connected(&self.address, self.timeout).await?;
        Ok(match &self.over {
            LineTransport::RtuOverTcp => Connection::Modbus(Box::new(Rtu::new(stream, None, tap))),
            LineTransport::AsciiOverTcp => {
                Connection::Modbus(Box::new(Rtu::new(AsciiPort::new(stream), None, tap)))
            }
            LineTransport::Tls(Some(client)) => {
                Connection::ModbusTcp(ModbusTcp::new(client.secure(stream).await?, tap))
            }
            _ => Connection::ModbusTcp(ModbusTcp::new(LocalTcp::new(stream), tap)),
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

    /// Returns false if another serial port now has the path of the port that was open before. A port that hangs up or
    /// cannot be opened is reported by the line, not by this function.
    fn resumes(&self) -> bool {
        match self.over {
            LineTransport::Serial(_, history) | LineTransport::SerialAscii { history, .. } => {
                history.resumes()
            }
            LineTransport::Tcp
            | LineTransport::Tls(_)
            | LineTransport::RtuOverTcp
            | LineTransport::AsciiOverTcp => true,
        }
    }

    fn takes(&self) -> Duration {
        if matches!(self.over, LineTransport::Tls(_)) { tls::HANDSHAKE } else { Duration::ZERO }
    }
}
