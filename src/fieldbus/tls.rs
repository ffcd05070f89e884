//! Modbus/TCP Security: Modbus TCP inside TLS, as the Modbus Organization specifies it (MB-TCP-Security v2.1), by
//! rustls. What the two ends hold against each other's certificates is said in words.

use std::io;
use std::time::Duration;

use tokio_rustls::rustls::{AlertDescription, CertificateError, Error};

use super::error::{Fault, LinkFault, TlsFault};

#[cfg(feature = "mqtt")]
mod broker;
mod client;
mod pem;
mod server;
mod visitor;

#[cfg(feature = "mqtt")]
pub use broker::broker;
pub(super) use client::Client;
pub use client::check;
pub use server::{Wrong, server};
pub use visitor::visitor;

/// Controllers without a processor for it take a second or two for the two signatures of a handshake.
pub(super) const HANDSHAKE: Duration = Duration::from_secs(5);

/// What TLS itself says of an error, if it has a word in it. With TLS 1.3 the device's judgement of the gateway's
/// certificate comes only after the handshake, in place of the first answer.
pub(super) fn tls_fault(error: &io::Error) -> Option<Fault> {
    let fault = match error.get_ref()?.downcast_ref::<Error>()? {
        Error::InvalidCertificate(why) => match why {
            CertificateError::Expired | CertificateError::ExpiredContext { .. } => TlsFault::Expired,
            CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => {
                TlsFault::NotYetValid
            }
            CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. } => {
                TlsFault::OtherName
            }
            // Signed by somebody of the same name.
            CertificateError::UnknownIssuer | CertificateError::BadSignature => TlsFault::UnknownAuthority,
            _ => TlsFault::BadCertificate,
        },
        Error::AlertReceived(alert) => match alert {
            AlertDescription::CertificateExpired => TlsFault::OursExpired,
            AlertDescription::CertificateRequired
            | AlertDescription::BadCertificate
            | AlertDescription::UnsupportedCertificate
            | AlertDescription::CertificateRevoked
            | AlertDescription::CertificateUnknown
            | AlertDescription::UnknownCA
            | AlertDescription::DecryptError
            | AlertDescription::AccessDenied => TlsFault::OursRefused,
            AlertDescription::HandshakeFailure
            | AlertDescription::ProtocolVersion
            | AlertDescription::InsufficientSecurity => TlsFault::NothingInCommon,
            AlertDescription::UnrecognisedName => TlsFault::OtherName,
            _ => TlsFault::Refused,
        },
        Error::PeerIncompatible(_) => TlsFault::NothingInCommon,
        Error::InvalidMessage(_) => TlsFault::NoTls,
        _ => TlsFault::Refused,
    };
    Some(Fault::Link(LinkFault::Tls(fault)))
}
