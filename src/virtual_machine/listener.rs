//! TCP ports of virtual devices, which faults close and open again.

use std::io;
use std::net::SocketAddr;

use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::task::JoinSet;

/// Command to open (`true`) or close a listener or a port, and the channel that reports its execution.
pub(super) type Switch = (bool, oneshot::Sender<()>);

/// Number of connections that may wait until they are accepted.
const BACKLOG: u32 = 1024;

/// TCP port at which the devices of a line listen: open, or closed by a fault.
pub(super) enum TcpPort {
    Open(TcpListener),
    /// Bound socket that does not listen. It refuses connections, and keeps the port reserved.
    Closed(TcpSocket),
}

impl TcpPort {
    /// Opens or closes the port.
    ///
    /// # Errors
    /// Another program has taken the port, or the system has no more sockets.
    pub(super) fn switched(self, is_open: bool) -> io::Result<TcpPort> {
        match (self, is_open) {
            (TcpPort::Open(listener), false) => {
                let address = listener.local_addr()?;
                drop(listener);
                Ok(TcpPort::Closed(bound(address)?))
            }
            (TcpPort::Closed(socket), true) => Ok(TcpPort::Open(socket.listen(BACKLOG)?)),
            (unchanged, _) => Ok(unchanged),
        }
    }

    /// Waits for the next connection. Never returns while the port is closed.
    pub(super) async fn accept(&self) -> io::Result<(TcpStream, SocketAddr)> {
        match self {
            TcpPort::Open(listener) => listener.accept().await,
            TcpPort::Closed(_) => std::future::pending().await,
        }
    }
}

/// Returns a socket that is bound to this address, but does not listen yet.
fn bound(address: SocketAddr) -> io::Result<TcpSocket> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    Ok(socket)
}

/// Accepts connections and starts `converse` for each, until `stop` changes or its sender is dropped. Closing the
/// listener also ends its connections.
pub(super) async fn serve<S, F>(
    listener: TcpListener,
    mut switched: mpsc::Receiver<S>,
    mut stop: watch::Receiver<bool>,
    converse: impl Fn(TcpStream) -> F + Send + 'static,
) -> io::Result<()>
where
    S: Into<Switch>,
    F: Future<Output = io::Result<()>> + Send + 'static,
{
    let mut port = TcpPort::Open(listener);
    let mut connections: JoinSet<io::Result<()>> = JoinSet::new();
    loop {
        tokio::select! {
            _ = stop.changed() => return Ok(()),
            switch = switched.recv() => {
                let Some((is_open, done)) = switch.map(Into::<Switch>::into) else { return Ok(()) };
                port = port.switched(is_open)?;
                if !is_open {
                    connections.shutdown().await;
                }
                let _ = done.send(());
            }
            accepted = port.accept() => {
                let (stream, _) = accepted?;
                // A connection without this option is only slower.
                let _ = stream.set_nodelay(true);
                connections.spawn(converse(stream));
            }
            Some(ended) = connections.join_next() => {
                if let Err(error) = ended && error.is_panic() {
                    return Err(io::Error::other(error));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_closed_port_refuses_connections_and_stays_reserved() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let closed = TcpPort::Open(listener).switched(false).unwrap().switched(false).unwrap();
        let refused = TcpStream::connect(address).await.unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::ConnectionRefused);
        let taken = TcpSocket::new_v4().unwrap().bind(address).unwrap_err();
        assert_eq!(taken.kind(), io::ErrorKind::AddrInUse);
        let open = closed.switched(true).unwrap();
        let (client, accepted) = tokio::join!(TcpStream::connect(address), open.accept());
        assert_eq!(accepted.unwrap().1, client.unwrap().local_addr().unwrap());
    }
}
