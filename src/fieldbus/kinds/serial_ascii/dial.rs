//! Opens the ports of devices that send text.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::pending::PendingAnswers;
use super::port::TextPort;
use super::wire::TextWire;
use crate::fieldbus::connection::{Connection, Dial};
use crate::fieldbus::error::Fault;
use crate::fieldbus::serial::{PortHistory, SerialPort};
use crate::fieldbus::tcp::connected;
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::Boxed;
use isotherm_profile::{Bus, Serial, Transport};

/// Number of data bits of the characters that a serial server passes on. The user makes the settings of the port at the
/// serial server itself.
const OVER_TCP: u8 = 8;

/// Opener of the connections of one line with text.
pub(super) struct TextDial {
    address: String,
    timeout: Duration,
    over: TextTransport,
    /// Requests whose answers may still arrive, also on the next connection.
    pending: Arc<Mutex<PendingAnswers>>,
}

/// Transport of a line with text.
enum TextTransport {
    Serial { serial: Serial, data_bits: u8, history: PortHistory },
    Tcp,
}

impl TextDial {
    /// Returns a connection opener (dial) for the address of this bus; `None` for another type of bus.
    pub(super) fn new(bus: &Bus) -> Option<TextDial> {
        let over = match bus.transport {
            Transport::Ascii { serial, data_bits } => {
                TextTransport::Serial { serial, data_bits, history: PortHistory::default() }
            }
            Transport::AsciiOverTcp => TextTransport::Tcp,
            _ => return None,
        };
        Some(TextDial { address: bus.address.clone(), timeout: bus.timeout, over, pending: Arc::default() })
    }

    /// Opens the serial port, or the TCP connection to the serial server.
    pub(super) async fn open(&mut self, tap: &Tap) -> Result<TextPort, Fault> {
        match &mut self.over {
            TextTransport::Serial { serial, data_bits, history } => {
                let opened = SerialPort::open_for_text(&self.address, *serial, *data_bits);
                *history = history.and(opened.as_ref().ok().map(SerialPort::identity));
                Ok(TextPort::new(opened.map_err(Fault::Link)?, *data_bits, tap))
            }
            TextTransport::Tcp => {
                let stream = connected(&self.address, self.timeout).await?;
                Ok(TextPort::new(stream, OVER_TCP, tap))
            }
        }
    }

    fn serial(&self) -> Option<Serial> {
        if let TextTransport::Serial { serial, .. } = self.over { Some(serial) } else { None }
    }
}

impl Dial for TextDial {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        Box::pin(async move {
            let port = self.open(tap).await?;
            let wire = TextWire::of(port, self.serial(), self.timeout, self.pending.clone());
            Ok(Connection::Other(Box::new(wire)))
        })
    }

    /// Returns false if another serial port now has the path of the port that was open before.
    fn resumes(&self) -> bool {
        match &self.over {
            TextTransport::Serial { history, .. } => history.resumes(),
            TextTransport::Tcp => true,
        }
    }
}
