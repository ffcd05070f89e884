//! Connections to servers: resolution of host names, TCP connections, and TLS. The calling module adds advice to a
//! failure.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use rustix::io::Errno;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, ToSocketAddrs, lookup_host};
use tokio::sync::Mutex;
use tokio::task::{JoinHandle, spawn_blocking};
use tokio::time::timeout;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::ClientConfig;
use tokio_rustls::rustls::pki_types::ServerName;

use crate::tls::TlsFault;

/// Time limit for connecting to one address of a host name. The limit does not apply to the last address, for which
/// only the time limit of the caller applies.
const EACH: Duration = Duration::from_secs(3);

/// Reason why a connection could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// The host name has no address.
    #[error("the host name has no address")]
    Unresolved,
    /// The host cannot be reached.
    #[error("the host cannot be reached: {0}")]
    Unreachable(io::Error),
    /// The name of the host has a form that no certificate can contain.
    #[error("a certificate cannot contain the host name")]
    UnfitName,
    /// The TLS handshake failed.
    #[error("{0}")]
    Tls(TlsFault),
}

/// Returns whether an error means that too many files are open in this program or on this computer.
pub(crate) fn is_out_of_files(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::MFILE | Errno::NFILE))
}

/// Connects to the first address of a host that accepts a connection.
///
/// # Errors
/// The reason why none of the addresses has accepted a connection.
pub async fn connect(to: impl ToSocketAddrs) -> Result<TcpStream, ConnectError> {
    let found: Vec<SocketAddr> = lookup_host(to).await.map_err(unresolved)?.collect();
    let (last, others) = found.split_last().ok_or(ConnectError::Unresolved)?;
    for address in others {
        if let Ok(Ok(stream)) = timeout(EACH, TcpStream::connect(address)).await {
            return Ok(stream);
        }
    }
    TcpStream::connect(last).await.map_err(ConnectError::Unreachable)
}

/// Returns the reason why a host name could not be resolved. A possible reason is too many open files, because the
/// resolution opens files, too.
fn unresolved(error: io::Error) -> ConnectError {
    if is_out_of_files(&error) { ConnectError::Unreachable(error) } else { ConnectError::Unresolved }
}

/// Performs the TLS handshake with the server `name`.
///
/// # Errors
/// The reason why the handshake failed.
pub async fn secure<S: AsyncRead + AsyncWrite + Unpin>(
    stream: S,
    name: &ServerName<'static>,
    config: &Arc<ClientConfig>,
) -> Result<TlsStream<S>, ConnectError> {
    let connected = TlsConnector::from(config.clone()).connect(name.clone(), stream).await;
    connected.map_err(|error| {
        tracing::debug!(?name, %error, "no TLS connection");
        // Any other error says nothing about TLS.
        TlsFault::in_handshake(&error).map_or(ConnectError::Unreachable(error), ConnectError::Tls)
    })
}

/// Byte stream to a server and back, with or without TLS.
pub trait Stream: AsyncRead + AsyncWrite + Send + Sync + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Sync + Unpin> Stream for T {}

/// Server to which the gateway connects, with a host name or an IP address.
pub struct Host {
    name: String,
    port: u16,
    /// TLS settings. With `None`, connections do not use TLS.
    trust: Option<Arc<ClientConfig>>,
    /// Running resolution of the host name; `None` if no resolution is running. Two resolutions never run at the same
    /// time.
    lookup: Mutex<Option<JoinHandle<io::Result<Vec<SocketAddr>>>>>,
}

impl Host {
    /// Creates a server with this host name or IP address. An IPv6 address must not have brackets.
    pub fn new(name: &str, port: u16, trust: Option<Arc<ClientConfig>>) -> Host {
        Host { name: name.to_owned(), port, trust, lookup: Mutex::default() }
    }

    /// Opens a connection, including the TLS handshake. The function has no time limit of its own.
    ///
    /// # Errors
    /// The reason why no connection was opened.
    pub async fn open(&self) -> Result<Box<dyn Stream>, ConnectError> {
        let stream = connect(&self.addresses().await?[..]).await?;
        // Small messages are sent at once.
        let _ = stream.set_nodelay(true);
        let Some(config) = &self.trust else { return Ok(Box::new(stream)) };
        let name = ServerName::try_from(self.name.clone()).map_err(|_| ConnectError::UnfitName)?;
        Ok(Box::new(secure(stream, &name, config).await?))
    }

    async fn addresses(&self) -> Result<Vec<SocketAddr>, ConnectError> {
        let place = (self.name.clone(), self.port);
        let ask = move || std::net::ToSocketAddrs::to_socket_addrs(&place).map(Iterator::collect);
        let mut lookup = self.lookup.lock().await;
        // If this attempt times out, the next one uses the same lookup.
        let found = lookup.get_or_insert_with(|| spawn_blocking(ask)).await;
        *lookup = None;
        found.ok().and_then(Result::ok).ok_or(ConnectError::Unresolved)
    }
}
