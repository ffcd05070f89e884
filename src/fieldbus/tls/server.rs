//! What a server shows by its files, to clients that need no certificate: the page.

use std::sync::Arc;

use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::{Error, InconsistentKeys, ServerConfig};

use super::pem::{certificates, private_key};

/// Which of the two files is wrong, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wrong {
    /// The certificate.
    Cert(String),
    /// The private key.
    Key(String),
}

/// TLS 1.2 or 1.3 that shows the certificate in `cert`, whose private key is in `key`: the contents of files in PEM form.
///
/// # Errors
/// Which of them is of no use, and why.
pub fn server(cert: &[u8], key: &[u8]) -> Result<ServerConfig, Wrong> {
    let chain = certificates(cert).map_err(Wrong::Cert)?;
    let key = private_key(key).map_err(Wrong::Key)?;
    let config = ServerConfig::builder_with_provider(Arc::new(default_provider()))
        .with_safe_default_protocol_versions()
        .and_then(|config| config.with_no_client_auth().with_single_cert(chain, key));
    config.map_err(|error| match error {
        Error::InconsistentKeys(InconsistentKeys::KeyMismatch) => {
            Wrong::Key("this key does not belong to the certificate in `cert`".to_owned())
        }
        Error::InvalidCertificate(_) => Wrong::Cert(format!("the certificate is of no use: {error}")),
        _ => Wrong::Key(format!("the key is of no use: {error}")),
    })
}
