//! TCP connections that send every write at once (`TCP_NODELAY`), for Modbus TCP and the other protocols of a line.
//!
//! Closing a connection discards its unsent bytes. Otherwise the system could send them for minutes, even after newer
//! bytes on the next connection.

use std::io::ErrorKind;
use std::time::Duration;

use socket2::SockRef;
use tokio::net::TcpStream;

use super::error::{Fault, LinkFault};
use crate::net::{ConnectError, connect, is_out_of_files};

/// Opens a TCP connection to `host:port`. The system closes the connection if the other end does not acknowledge data
/// within the timeout. The close discards data that is unsent or not acknowledged.
pub(super) async fn connected(address: &str, timeout: Duration) -> Result<TcpStream, Fault> {
    let stream = connect(address).await.map_err(|error| Fault::Link(fault(&error)))?;
    let socket = SockRef::from(&stream);
    let set = socket
        .set_linger(Some(Duration::ZERO))
        .and_then(|()| socket.set_tcp_user_timeout(Some(timeout)))
        // A small request must not wait for the answer to the last one.
        .and_then(|()| stream.set_nodelay(true));
    set.map_err(|_| Fault::Link(LinkFault::Broken))?;
    Ok(stream)
}

fn fault(error: &ConnectError) -> LinkFault {
    match error {
        ConnectError::Unresolved => LinkFault::Unresolved,
        ConnectError::Unreachable(error) if is_out_of_files(error) => LinkFault::NoDescriptors,
        ConnectError::Unreachable(error) if error.kind() == ErrorKind::ConnectionRefused => {
            LinkFault::Refused
        }
        _ => LinkFault::Unreachable,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Error;

    #[test]
    fn a_host_is_not_blamed_for_what_this_computer_lacks() {
        // Connection refused, no route to host, too many open files of the program, and of the computer.
        for (code, expected) in [
            (111, LinkFault::Refused),
            (113, LinkFault::Unreachable),
            (24, LinkFault::NoDescriptors),
            (23, LinkFault::NoDescriptors),
        ] {
            let error = ConnectError::Unreachable(Error::from_raw_os_error(code));
            assert_eq!(fault(&error), expected, "{code}");
        }
    }
}
