//! TCP connections that keep nothing back: Modbus TCP is spoken on them, and whatever else a line carries through TCP.
//!
//! What was given up never leaves this computer: a closed connection's bytes would else be sent by the system for
//! minutes, after newer ones on the next connection.

use std::io;
use std::time::Duration;

use socket2::SockRef;
use tokio::net::TcpStream;

use super::connection::{Connection, Dial};
use super::eager::Eager;
use super::error::{Fault, LinkFault};
use super::modbus::ModbusTcp;
use super::trace::{Tap, Teed};
use super::wire::Boxed;

/// Opens Modbus TCP connections to one address.
#[derive(Clone, Debug)]
pub struct TcpDial {
    address: String,
    timeout: Duration,
    tap: Tap,
}

impl TcpDial {
    /// To `host:port`; what the other end has not confirmed within the timeout breaks the connection.
    pub fn new(address: &str, timeout: Duration) -> TcpDial {
        TcpDial { address: address.to_owned(), timeout, tap: Tap::default() }
    }
}

impl Dial for TcpDial {
    fn dial(&mut self) -> Boxed<'_, Result<Connection, Fault>> {
        Box::pin(async {
            let stream = connected(&self.address, self.timeout).await?;
            Ok(Connection::Modbus(ModbusTcp::over(Teed::new(Eager::new(stream), self.tap.clone()))))
        })
    }

    fn tap(&mut self, tap: &Tap) {
        self.tap = tap.clone();
    }
}

/// A TCP connection to `host:port`. Closing it throws away what has not been sent and what was not confirmed.
pub(super) async fn connected(address: &str, timeout: Duration) -> Result<TcpStream, Fault> {
    let stream = TcpStream::connect(address).await.map_err(|error| dial_fault(&error))?;
    let socket = SockRef::from(&stream);
    let set = socket
        .set_linger(Some(Duration::ZERO))
        .and_then(|()| socket.set_tcp_user_timeout(Some(timeout)))
        // A small request must not wait for the answer to the last one.
        .and_then(|()| stream.set_nodelay(true));
    set.map_err(|_| Fault::Link(LinkFault::Broken))?;
    Ok(stream)
}

fn dial_fault(error: &io::Error) -> Fault {
    Fault::Link(match error.kind() {
        io::ErrorKind::ConnectionRefused => LinkFault::Refused,
        _ => LinkFault::Unreachable,
    })
}
