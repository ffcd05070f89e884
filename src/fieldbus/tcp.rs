//! TCP connections without send delay, for Modbus TCP and other protocols of a line.
//!
//! Closing a connection discards its unsent bytes. Otherwise the system could send them for minutes, after newer bytes
//! on the next connection.

use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use socket2::SockRef;
use tokio::net::TcpStream;

use super::error::{Fault, LinkFault};

/// Opens a TCP connection to `host:port`. It breaks if the other end has not confirmed data within the timeout. Closing
/// it discards unsent and unconfirmed data.
pub(super) async fn connected(address: &str, timeout: Duration) -> Result<TcpStream, Fault> {
    // An address needs no name lookup.
    let found = match address.parse::<SocketAddr>() {
        Ok(address) => vec![address],
        Err(_) => {
            let found = tokio::net::lookup_host(address).await;
            found.map_err(|_| Fault::Link(LinkFault::Unresolved))?.collect()
        }
    };
    let stream = TcpStream::connect(&found[..]).await.map_err(|error| dial_fault(&error))?;
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
