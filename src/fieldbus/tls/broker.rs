//! TLS client of an MQTT broker: the authorities that it trusts, and its own certificate, if any.

use std::sync::Arc;

use tokio_rustls::rustls::{ClientConfig, Error, InconsistentKeys};

use super::pem::{certificates, private_key};
use super::visitor::trusting;
use isotherm_profile::{Mqtt, ProfileError};

/// Returns the TLS settings of a profile, for TLS 1.2 or 1.3; `None` if the broker is used without TLS.
///
/// # Errors
/// The mistakes in each of its files.
pub fn broker(mqtt: &Mqtt) -> Result<Option<Arc<ClientConfig>>, Vec<ProfileError>> {
    if !mqtt.broker.tls {
        return Ok(None);
    }
    let ca = mqtt.ca.as_ref();
    let builder = trusting(ca.map(|ca| ca.bytes.as_slice())).map_err(|why| {
        vec![ca.map_or_else(
            || mqtt.wrong(&why, "write `ca` in `tls`, as tls = { ca = \"…\" }"),
            |ca| ca.wrong(&why),
        )]
    })?;
    let Some((cert, key)) = &mqtt.own else { return Ok(Some(Arc::new(builder.with_no_client_auth()))) };
    let chain = certificates(&cert.bytes).map_err(|why| cert.wrong(&why));
    let private = private_key(&key.bytes).map_err(|why| key.wrong(&why));
    let (chain, private) = match (chain, private) {
        (Ok(chain), Ok(private)) => (chain, private),
        (chain, private) => return Err(chain.err().into_iter().chain(private.err()).collect()),
    };
    let config = builder.with_client_auth_cert(chain, private).map_err(|error| {
        vec![match error {
            Error::InconsistentKeys(InconsistentKeys::KeyMismatch) => {
                key.wrong("this key is not the key of the certificate in `cert`")
            }
            Error::InvalidCertificate(_) => cert.wrong(&format!("the certificate cannot be used: {error}")),
            _ => key.wrong(&format!("the key cannot be used: {error}")),
        }]
    });
    config.map(|config| Some(Arc::new(config)))
}
