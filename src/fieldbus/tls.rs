//! Modbus/TCP Security: Modbus TCP inside TLS, as the Modbus Organization specifies it (MB-TCP-Security v2.1), by
//! rustls. What the two ends hold against each other's certificates is told in words.

use std::io;
use std::time::Duration;

use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;

use super::connection::{Connection, Dial};
use super::eager::Eager;
use super::error::{Fault, LinkFault, TlsFault};
use super::modbus::ModbusTcp;
use super::port::Any;
use super::tcp::connected;
use super::trace::{Tap, Teed};
use super::wire::Boxed;
use isotherm_profile::Tls;

mod client;
mod fault;

use client::Client;
pub use client::check;
pub(super) use fault::told;

/// Controllers without a processor for it take a second or two for the two signatures of a handshake.
const HANDSHAKE: Duration = Duration::from_secs(5);

/// Opens secured TCP connections to one address.
#[derive(Clone, Debug)]
pub struct TlsDial {
    address: String,
    timeout: Duration,
    /// `None`: its files are of no use, as [`check`] says.
    client: Option<Client>,
    tap: Tap,
}

impl TlsDial {
    /// To `host:port`; what the other end has not confirmed within the timeout breaks the connection.
    pub fn new(address: &str, timeout: Duration, tls: &Tls) -> TlsDial {
        TlsDial { address: address.to_owned(), timeout, client: Client::new(tls).ok(), tap: Tap::default() }
    }
}

impl Dial for TlsDial {
    fn dial(&mut self) -> Boxed<'_, Result<Connection, Fault>> {
        Box::pin(async {
            let Some(client) = &self.client else {
                return Err(Fault::Link(LinkFault::Tls(TlsFault::OurFiles)));
            };
            let stream: TcpStream = connected(&self.address, self.timeout).await?;
            let connector = TlsConnector::from(client.config.clone());
            let secured = connector.connect(client.name.clone(), Eager::new(stream)).await;
            let secured = secured.map_err(|error| {
                tracing::debug!(address = self.address, %error, "no TLS connection");
                handshake_fault(&error)
            })?;
            Ok(Connection::Modbus(ModbusTcp::over(Teed::new(Any(secured), self.tap.clone()))))
        })
    }

    /// Above TLS: what is heard is Modbus.
    fn tap(&mut self, tap: &Tap) {
        self.tap = tap.clone();
    }

    /// With TLS 1.3 its judgement of our certificate comes after the handshake, and not every device says it.
    fn turned_away(&self) -> Fault {
        Fault::Link(LinkFault::Tls(TlsFault::TurnedAway))
    }

    fn takes(&self) -> Duration {
        HANDSHAKE
    }
}

/// An end in the middle of the handshake without a word is also what a plain Modbus server does.
fn handshake_fault(error: &io::Error) -> Fault {
    told(error).unwrap_or(match error.kind() {
        io::ErrorKind::UnexpectedEof | io::ErrorKind::ConnectionReset => {
            Fault::Link(LinkFault::Tls(TlsFault::Silent))
        }
        _ => Fault::Link(LinkFault::Broken),
    })
}
