//! TLS server of the web page, for clients without a certificate.

use std::sync::Arc;

use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::{Error, InconsistentKeys, ServerConfig};

use super::pem::{certificates, private_key};

/// File of the TLS server (certificate or key) that has a mistake, with a sentence about the mistake.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wrong {
    /// The certificate file has a mistake; contains the message.
    Cert(String),
    /// The private key file has a mistake; contains the message.
    Key(String),
}

/// Returns a server for TLS 1.2 or 1.3 with this certificate and its private key, both in PEM form.
///
/// # Errors
/// The file that is unusable, with the reason.
pub fn server(cert: &[u8], key: &[u8]) -> Result<ServerConfig, Wrong> {
    let chain = certificates(cert).map_err(Wrong::Cert)?;
    let key = private_key(key).map_err(Wrong::Key)?;
    let config = ServerConfig::builder_with_provider(Arc::new(default_provider()))
        .with_safe_default_protocol_versions()
        .and_then(|config| config.with_no_client_auth().with_single_cert(chain, key));
    config.map_err(Wrong::from)
}

impl From<Error> for Wrong {
    fn from(error: Error) -> Wrong {
        match error {
            Error::InconsistentKeys(InconsistentKeys::KeyMismatch) => {
                Wrong::Key("this key is not the key of the certificate in `cert`".to_owned())
            }
            Error::InvalidCertificate(_) => Wrong::Cert(format!("the certificate cannot be used: {error}")),
            _ => Wrong::Key(format!("the key cannot be used: {error}")),
        }
    }
}
