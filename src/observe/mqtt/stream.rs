//! The way to a broker: TCP, or TLS over it; and what can be wrong with it, in words.

use std::io;
use std::sync::Arc;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, lookup_host};
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::pki_types::ServerName;
use tokio_rustls::rustls::{AlertDescription, CertificateError, ClientConfig, Error};

use super::broker::Fault;
use isotherm_profile::BrokerUrl;

/// Bytes to a broker and back.
pub(super) trait Bytes: AsyncRead + AsyncWrite + Send + Sync + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Sync + Unpin> Bytes for T {}

/// Connects to the first address that takes it. Whatever goes wrong is a [`Fault`] inside the error.
pub(super) async fn open(to: BrokerUrl, trust: Option<Arc<ClientConfig>>) -> io::Result<Box<dyn Bytes>> {
    let failed = |fault: Fault| io::Error::other(Inside(fault));
    let found = lookup_host((to.host.as_str(), to.port)).await;
    let addresses: Vec<_> = found.map_err(|_| failed(Fault::NoAddress))?.collect();
    let mut last = Fault::NoAddress;
    for address in addresses {
        match TcpStream::connect(address).await {
            Ok(stream) => {
                // Small messages are not held back for larger ones.
                let _ = stream.set_nodelay(true);
                return match trust {
                    None => Ok(Box::new(stream)),
                    Some(config) => secure(&to, config, stream).await.map_err(failed),
                };
            }
            Err(error) => last = Fault::Unreachable(error.kind()),
        }
    }
    Err(failed(last))
}

async fn secure(
    to: &BrokerUrl,
    config: Arc<ClientConfig>,
    stream: TcpStream,
) -> Result<Box<dyn Bytes>, Fault> {
    let name = ServerName::try_from(to.host.clone())
        .map_err(|_| Fault::Tls(format!("no certificate can be for the name `{}`", to.host)))?;
    let connected = TlsConnector::from(config).connect(name, stream).await;
    connected.map(|stream| Box::new(stream) as Box<dyn Bytes>).map_err(|error| tls_fault(&error, &to.host))
}

/// What TLS holds against the broker, or the broker against the gateway.
fn tls_fault(error: &io::Error, host: &str) -> Fault {
    let found = error.get_ref().and_then(|error| error.downcast_ref::<Error>());
    let Some(found) = found else {
        return Fault::Tls(format!("the connection ended while TLS was agreed on ({})", error.kind()));
    };
    said(found, host).unwrap_or_else(|| Fault::Tls(format!("TLS: {found}")))
}

/// Words for what is known to happen. With TLS 1.3 the broker's judgement of the gateway's certificate comes only after the handshake.
fn said(error: &Error, host: &str) -> Option<Fault> {
    let words = match error {
        Error::InvalidCertificate(why) => match why {
            CertificateError::Expired | CertificateError::ExpiredContext { .. } => {
                "its certificate has expired (or this computer's clock is wrong)".to_owned()
            }
            CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => {
                "its certificate is not valid yet (or this computer's clock is wrong)".to_owned()
            }
            CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. } => {
                format!("its certificate is for another name than {host}")
            }
            CertificateError::UnknownIssuer | CertificateError::BadSignature => {
                "its certificate is signed by nobody whom the gateway trusts: name the authority with `tls = { ca = \"…\" }`"
                    .to_owned()
            }
            why => format!("its certificate is of no use: {why}"),
        },
        Error::AlertReceived(alert) => match alert {
            AlertDescription::CertificateRequired => {
                "it wants to see a certificate of the gateway: name `cert` and `key` in `tls`".to_owned()
            }
            AlertDescription::CertificateExpired => "the gateway's certificate has expired".to_owned(),
            AlertDescription::BadCertificate
            | AlertDescription::UnsupportedCertificate
            | AlertDescription::CertificateRevoked
            | AlertDescription::CertificateUnknown
            | AlertDescription::UnknownCA
            | AlertDescription::DecryptError
            | AlertDescription::AccessDenied => "it does not take the gateway's certificate".to_owned(),
            alert => format!("it refuses the connection (TLS: {alert:?})"),
        },
        Error::PeerIncompatible(_) => "it speaks no TLS that the gateway speaks (1.2 or 1.3)".to_owned(),
        Error::InvalidMessage(_) => "it does not speak TLS there: try another port, or mqtt://".to_owned(),
        _ => return None,
    };
    Some(Fault::Tls(words))
}

/// A fault on its way through a library that knows only errors of input and output.
#[derive(Debug)]
struct Inside(Fault);

impl std::fmt::Display for Inside {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl std::error::Error for Inside {}

/// What an error of a connection says.
pub(super) fn fault_of(error: &io::Error, host: &str) -> Fault {
    let inside = error.get_ref();
    let own = inside.and_then(|error| error.downcast_ref::<Inside>()).map(|Inside(fault)| fault.clone());
    let tls = || inside?.downcast_ref::<Error>().and_then(|error| said(error, host));
    // What ends within a message was none.
    let other = if error.kind() == io::ErrorKind::Other { Fault::NoMqtt } else { Fault::Broken };
    own.or_else(tls).unwrap_or(other)
}
