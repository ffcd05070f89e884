//! What the two ends of a secured line hold against each other, in our own words.

use std::io;

use tokio_rustls::rustls::{AlertDescription, CertificateError, Error};

use crate::fieldbus::error::{Fault, LinkFault, TlsFault};

/// What TLS itself says of an error, if it has a word in it. With TLS 1.3 the device's judgement of the gateway's
/// certificate comes only after the handshake, in place of the first answer.
pub(in crate::fieldbus) fn told(error: &io::Error) -> Option<Fault> {
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
