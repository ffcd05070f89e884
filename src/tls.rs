//! Causes of a failed TLS connection: which end rejects the connection, and why. The calling module adds the remedy,
//! because the remedy depends on the keys of the profile.

use std::io::{self, ErrorKind};

use tokio_rustls::rustls::{AlertDescription, CertificateError, Error};

/// Cause of a failed TLS connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum TlsFault {
    /// The certificate of the other end has expired.
    #[error("the certificate of the server has expired, or this computer's clock is wrong")]
    Expired,
    /// The certificate of the other end is not valid yet.
    #[error("the certificate of the server is not valid yet, or this computer's clock is wrong")]
    NotYetValid,
    /// The certificate of the other end is for another name.
    #[error("the certificate of the server is for another name")]
    OtherName,
    /// No trusted authority has signed the certificate of the other end.
    #[error("no trusted authority has signed the certificate of the server")]
    UnknownAuthority,
    /// The certificate of the other end is invalid for another reason.
    #[error("the certificate of the server cannot be used as a server certificate")]
    BadCertificate,
    /// The other end requires a certificate of the gateway, but received none.
    #[error("the server requires a certificate of the gateway")]
    OursMissing,
    /// The gateway's certificate has expired.
    #[error("the server reports that the gateway's certificate has expired")]
    OursExpired,
    /// The other end rejects the gateway's certificate.
    #[error("the server rejects the gateway's certificate")]
    OursRefused,
    /// The two ends have no TLS version, cipher or signature in common.
    #[error(
        "gateway and server have no TLS version or cipher in common: the gateway supports TLS 1.2 with \
         ECDHE, and TLS 1.3"
    )]
    NothingInCommon,
    /// The other end does not support TLS.
    #[error("the program at this port does not speak TLS")]
    NoTls,
    /// The other end closed the connection during the handshake, and gave no reason.
    #[error("the connection was closed in the middle of the TLS handshake")]
    Silent,
    /// The other end closed the connection after the handshake, before its first answer.
    #[error("the connection was closed before the first answer")]
    TurnedAway,
    /// The other end ended the handshake for a reason that none of the other causes describes.
    #[error("the server has ended the TLS handshake")]
    Refused,
    /// The gateway's own TLS files, whose paths are in the profile, are unusable.
    #[error("the files in `tls` cannot be used")]
    OurFiles,
}

impl TlsFault {
    /// Returns the cause of the failed TLS connection; `None` if the error is not from TLS. With TLS 1.3, the other
    /// end may check the gateway's certificate only after the handshake. The gateway then receives a TLS alert
    /// instead of the first answer.
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

    /// Returns the cause of an error during the handshake; `None` if the error is not from TLS. If the connection
    /// ends without a TLS alert, the cause is [`TlsFault::Silent`].
    pub fn in_handshake(error: &io::Error) -> Option<TlsFault> {
        let is_end = matches!(
            error.kind(),
            ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset | ErrorKind::BrokenPipe
        );
        TlsFault::of(error).or(is_end.then_some(TlsFault::Silent))
    }

    /// Returns the cause with its remedy as a text for users.
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
            (Error::InvalidCertificate(CertificateError::Expired), "of the server has expired"),
            (Error::InvalidCertificate(CertificateError::NotValidYet), "is not valid yet"),
            (Error::InvalidCertificate(CertificateError::NotValidForName), "is for another name"),
            (Error::InvalidCertificate(CertificateError::UnknownIssuer), "no trusted authority"),
            (Error::InvalidCertificate(CertificateError::BadSignature), "no trusted authority"),
            (Error::InvalidCertificate(CertificateError::InvalidPurpose), "cannot be used as a server"),
            (Error::AlertReceived(AlertDescription::CertificateRequired), "requires a certificate of"),
            (Error::AlertReceived(AlertDescription::CertificateExpired), "the gateway's certificate has"),
            (Error::AlertReceived(AlertDescription::UnknownCA), "rejects the gateway's certificate"),
            (Error::AlertReceived(AlertDescription::ProtocolVersion), "no TLS version or cipher in common"),
            (Error::AlertReceived(AlertDescription::InternalError), "has ended the TLS handshake"),
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
