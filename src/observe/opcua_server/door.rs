//! Access protection of the library: only the gate may connect to the loopback port on which the library listens.
//!
//! Without this protection, other users of the computer could bypass the limits of the gate, and use up all file
//! descriptors of the gateway. The kernel drops each packet to this port unless the gate has just bound the packet's
//! source port. Each accepted connection keeps the filter that was set when it was opened.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::os::fd::AsFd;

use socket2::{SockFilter, Socket};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::Mutex;

/// Number of recent source ports that the filter accepts. The kernel may still handle the packets of one connection
/// when the next connection begins.
const RECENT: usize = 4;

/// Instructions of the Berkeley Packet Filter: load 16 bits, compare and jump, and return the bytes to accept.
const LOAD: u16 = 0x28;
const IS_EQUAL: u16 = 0x15;
const RETURN: u16 = 0x06;

/// Protected access to the loopback port of the library.
pub(super) struct Door {
    address: SocketAddr,
    /// Socket on which the library listens; `None` if the system cannot filter its packets.
    listener: Option<Socket>,
    /// Source ports of the most recent connections.
    ports: Mutex<[u16; RECENT]>,
}

impl Door {
    /// Closes the port of this listener to all other programs.
    ///
    /// # Errors
    /// The socket cannot be used.
    pub(super) fn of(listener: &TcpListener) -> io::Result<Door> {
        let address = listener.local_addr()?;
        let socket = Socket::from(listener.as_fd().try_clone_to_owned()?);
        let ports = [0; RECENT];
        let listener = match socket.attach_filter(&program(&ports)) {
            Ok(()) => Some(socket),
            Err(error) => {
                tracing::warn!(
                    "the internal port {address} of the OPC UA server is not protected from other users of \
                     this computer: {error}"
                );
                None
            }
        };
        Ok(Door { address, listener, ports: Mutex::new(ports) })
    }

    /// Opens a connection to the library.
    ///
    /// # Errors
    /// The library does not listen, or too many files are open.
    pub(super) async fn connect(&self) -> io::Result<TcpStream> {
        let socket = TcpSocket::new_v4()?;
        socket.bind(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)))?;
        let port = socket.local_addr()?.port();
        let mut ports = self.ports.lock().await;
        ports.rotate_right(1);
        ports[0] = port;
        if let Some(listener) = &self.listener {
            listener.attach_filter(&program(&ports))?;
        }
        socket.connect(self.address).await
    }
}

/// Returns a filter that accepts TCP packets from these source ports. A packet begins with its source port.
fn program(ports: &[u16; RECENT]) -> Vec<SockFilter> {
    let compare = ports.iter().zip((1..=RECENT).rev()).map(|(port, to_end)| {
        let to_end = u8::try_from(to_end).unwrap_or(u8::MAX);
        SockFilter::new(IS_EQUAL, to_end, 0, u32::from(*port))
    });
    let load = [SockFilter::new(LOAD, 0, 0, 0)].into_iter();
    let ends = [SockFilter::new(RETURN, 0, 0, 0), SockFilter::new(RETURN, 0, 0, u32::MAX)];
    load.chain(compare).chain(ends).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};

    #[tokio::test]
    async fn the_gate_may_connect_as_often_as_it_likes_and_nobody_else() {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
        let address = listener.local_addr().unwrap();
        let door = Door::of(&listener).unwrap();
        let stranger = || std::net::TcpStream::connect_timeout(&address, Duration::from_millis(100));
        assert!(stranger().is_err());
        let mut open = Vec::new();
        for number in 0..3 * RECENT {
            let mut ours = door.connect().await.unwrap();
            let (mut theirs, from) = listener.accept().await.unwrap();
            assert_eq!(from, ours.local_addr().unwrap(), "{number}");
            ours.write_all(b"hello").await.unwrap();
            let mut five = [0; 5];
            theirs.read_exact(&mut five).await.unwrap();
            assert_eq!(&five, b"hello");
            open.push((ours, theirs));
        }
        assert!(stranger().is_err());
        // The first connection goes on, though its port is no longer among those that may connect.
        let (ours, theirs) = &mut open[0];
        theirs.write_all(b"there").await.unwrap();
        let mut five = [0; 5];
        ours.read_exact(&mut five).await.unwrap();
        assert_eq!(&five, b"there");
        ours.write_all(b"again").await.unwrap();
        theirs.read_exact(&mut five).await.unwrap();
        assert_eq!(&five, b"again");
    }
}
