//! Causes of a failed TLS handshake: what either end rejects. The remedy depends on the keys of the profile, and is
//! added by the module that connects.

use std::io::{self, ErrorKind};

use tokio_rustls::rustls::{AlertDescription, CertificateError, Error};

/// Cause of a failed TLS connection. In the messages, "its" means the other end's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum TlsFault {
    /// The certificate of the other end has expired.
    #[error("its certificate has expired, or this computer's clock is wrong")]
    Expired,
    /// The certificate of the other end is not valid yet.
    #[error("its certificate is not valid yet, or this computer's clock is wrong")]
    NotYetValid,
    /// The certificate of the other end is for another name.
    #[error("its certificate is for another name")]
    OtherName,
    /// No trusted authority has signed the certificate.
    #[error("nobody who is trusted has signed its certificate")]
    UnknownAuthority,
    /// The certificate is invalid for another reason.
    #[error("its certificate is of no use as a server's")]
    BadCertificate,
    /// The other end requires a certificate, and received none.
    #[error("it wants to see a certificate of the gateway")]
    OursMissing,
    /// The gateway's certificate has expired.
    #[error("it finds that the gateway's certificate has expired")]
    OursExpired,
    /// The other end rejects the gateway's certificate.
    #[error("it does not take the gateway's certificate")]
    OursRefused,
    /// The two ends have no TLS version, cipher or signature in common.
    #[error("no TLS version or cipher in common: this end speaks 1.2 with ECDHE, and 1.3")]
    NothingInCommon,
    /// The other end does not support TLS.
    #[error("whoever listens there does not speak TLS")]
    NoTls,
    /// The other end closed the connection during the handshake, without a reason.
    #[error("closed in the middle of the TLS handshake")]
    Silent,
    /// The other end closed the connection after the handshake, before its first answer.
    #[error("closed before the first answer")]
    TurnedAway,
    /// The other end ended the handshake for another reason.
    #[error("it has ended the TLS handshake")]
    Refused,
    /// The files of the profile for the gateway's end are unusable.
    #[error("the files in `tls` are of no use")]
    OurFiles,
}

impl TlsFault {
    /// Returns the cause if the error is an error of TLS. With TLS 1.3, the other end checks the gateway's certificate
    /// only after the handshake. Its alert then arrives in place of the first answer.
    pub fn of(error: &io::Error) -> Option<TlsFault> {
        Some(match error.get_ref()?.downcast_ref::<Error>()? {
            Error::InvalidCertificate(why) => match why {
                CertificateError::Expired | CertificateError::ExpiredContext { .. } => TlsFault::Expired,
                CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => {
                    TlsFault::NotYetValid
                }
                CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. } => {
                    TlsFault::OtherName
                }
                // Signed by another authority of the same name.
                CertificateError::UnknownIssuer | CertificateError::BadSignature => {
                    TlsFault::UnknownAuthority
                }
                _ => TlsFault::BadCertificate,
            },
            Error::AlertReceived(alert) => match alert {
                AlertDescription::CertificateRequired => TlsFault::OursMissing,
                AlertDescription::CertificateExpired => TlsFault::OursExpired,
                AlertDescription::BadCertificate
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
        })
    }

    /// Returns the cause of an error in the handshake, where an end without an alert is a cause as well.
    pub fn in_handshake(error: &io::Error) -> Option<TlsFault> {
        let is_end = matches!(
            error.kind(),
            ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset | ErrorKind::BrokenPipe
        );
        TlsFault::of(error).or(is_end.then_some(TlsFault::Silent))
    }

    /// Returns the cause with its remedy.
    pub fn advised(self, remedy: Option<&str>) -> String {
        remedy.map_or(self.to_string(), |remedy| format!("{self}: {remedy}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio_rustls::rustls::InvalidMessage;

    #[test]
    fn what_the_library_says_is_judged_and_put_into_words() {
        let told = |error: Error| TlsFault::of(&io::Error::new(ErrorKind::InvalidData, error));
        for (error, words) in [
            (Error::InvalidCertificate(CertificateError::Expired), "its certificate has expired"),
            (Error::InvalidCertificate(CertificateError::NotValidYet), "is not valid yet"),
            (Error::InvalidCertificate(CertificateError::NotValidForName), "is for another name"),
            (Error::InvalidCertificate(CertificateError::UnknownIssuer), "nobody who is trusted"),
            (Error::InvalidCertificate(CertificateError::BadSignature), "nobody who is trusted"),
            (Error::InvalidCertificate(CertificateError::InvalidPurpose), "is of no use"),
            (Error::AlertReceived(AlertDescription::CertificateRequired), "wants to see a certificate"),
            (Error::AlertReceived(AlertDescription::CertificateExpired), "the gateway's certificate has"),
            (Error::AlertReceived(AlertDescription::UnknownCA), "does not take the gateway's"),
            (Error::AlertReceived(AlertDescription::ProtocolVersion), "no TLS version or cipher in common"),
            (Error::AlertReceived(AlertDescription::InternalError), "it has ended the TLS handshake"),
            (Error::InvalidMessage(InvalidMessage::InvalidContentType), "does not speak TLS"),
        ] {
            let said = told(error.clone()).map(|fault| fault.to_string()).unwrap_or_default();
            assert!(said.contains(words), "{error}: {said}");
        }
    }

    #[test]
    fn an_end_without_a_word_says_something_in_the_handshake_alone() {
        let (ended, late) = (ErrorKind::UnexpectedEof.into(), ErrorKind::TimedOut.into());
        assert_eq!((TlsFault::of(&ended), TlsFault::in_handshake(&ended)), (None, Some(TlsFault::Silent)));
        assert_eq!(TlsFault::in_handshake(&late), None);
    }
}
