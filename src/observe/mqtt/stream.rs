//! Connection to a broker: TCP, or TLS over TCP, with its faults in words.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, lookup_host};
use tokio::time::timeout;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::ClientConfig;
use tokio_rustls::rustls::pki_types::ServerName;

use super::broker::Fault;
use crate::tls::TlsFault;
use isotherm_profile::BrokerUrl;

/// Byte stream to a broker and back.
pub(super) trait Bytes: AsyncRead + AsyncWrite + Send + Sync + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Sync + Unpin> Bytes for T {}

/// Timeout of each address except the last one.
const EACH: Duration = Duration::from_secs(3);

/// Connects to the first address that accepts. The error contains a [`Fault`].
pub(super) async fn open(to: BrokerUrl, trust: Option<Arc<ClientConfig>>) -> io::Result<Box<dyn Bytes>> {
    let failed = |fault: Fault| io::Error::other(Inside(fault));
    let found = lookup_host((to.host.as_str(), to.port)).await;
    let addresses: Vec<_> = found.map_err(|_| failed(Fault::NoAddress))?.collect();
    let stream = connected(&addresses).await.map_err(failed)?;
    // Small messages are sent at once.
    let _ = stream.set_nodelay(true);
    match trust {
        None => Ok(Box::new(stream)),
        Some(config) => secure(&to, config, stream).await.map_err(failed),
    }
}

async fn connected(addresses: &[SocketAddr]) -> Result<TcpStream, Fault> {
    let (last, others) = addresses.split_last().ok_or(Fault::NoAddress)?;
    for address in others {
        if let Ok(Ok(stream)) = timeout(EACH, TcpStream::connect(address)).await {
            return Ok(stream);
        }
    }
    TcpStream::connect(last).await.map_err(|error| Fault::Unreachable(error.kind()))
}

async fn secure(
    to: &BrokerUrl,
    config: Arc<ClientConfig>,
    stream: TcpStream,
) -> Result<Box<dyn Bytes>, Fault> {
    let name = ServerName::try_from(to.host.clone())
        .map_err(|_| Fault::Tls(format!("a certificate cannot contain the name `{}`", to.host)))?;
    let connected = TlsConnector::from(config).connect(name, stream).await;
    connected.map(|stream| Box::new(stream) as Box<dyn Bytes>).map_err(|error| {
        tracing::debug!(%error, "no TLS connection");
        // Any other error says nothing about the certificates.
        TlsFault::in_handshake(&error).map_or(Fault::Unreachable(error.kind()), secured)
    })
}

/// Cause of a failed TLS handshake, with a remedy.
fn secured(fault: TlsFault) -> Fault {
    let remedy = match fault {
        TlsFault::OtherName => {
            Some("write that name into `broker`, or name the certificate itself with `tls = { ca = \"…\" }`")
        }
        TlsFault::UnknownAuthority => {
            Some("name the authority that signed the certificate of the broker with `tls = { ca = \"…\" }`")
        }
        TlsFault::BadCertificate => {
            Some("to trust a self-signed certificate, name it with `tls = { ca = \"…\" }`")
        }
        TlsFault::OursMissing => Some("name `cert` and `key` in `tls`"),
        TlsFault::OursExpired => Some("renew the certificate that `cert` names in `tls`"),
        TlsFault::OursRefused => {
            Some("does the broker trust the authority of the certificate that `cert` names in `tls`?")
        }
        TlsFault::NoTls => Some("try another port, or mqtt://"),
        TlsFault::Silent => Some("does the server speak TLS there, or plain MQTT (mqtt://)?"),
        _ => None,
    };
    Fault::Tls(fault.advised(remedy))
}

/// Carries a fault through a library that knows only I/O errors.
#[derive(Debug)]
struct Inside(Fault);

impl std::fmt::Display for Inside {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl std::error::Error for Inside {}

/// Fault of a connection error.
pub(super) fn fault_of(error: &io::Error) -> Fault {
    let inside = error.get_ref().and_then(|error| error.downcast_ref::<Inside>());
    let own = inside.map(|Inside(fault)| fault.clone());
    // If the connection ended within a message (`Other`), the server does not speak MQTT.
    let other = if error.kind() == io::ErrorKind::Other { Fault::NoMqtt } else { Fault::Broken };
    own.or_else(|| TlsFault::of(error).map(secured)).unwrap_or(other)
}
