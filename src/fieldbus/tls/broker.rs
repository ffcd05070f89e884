//! TLS client for an MQTT broker: the authorities that it trusts, and its own certificate if the profile names such a
//! certificate.

use std::sync::Arc;

use tokio_rustls::rustls::ClientConfig;

use super::plant_client::{own, showing, trusting};
use isotherm_profile::{Mqtt, ProfileError};

/// Returns the TLS settings for the broker of a profile, with TLS 1.2 or 1.3. Returns `None` if the broker is used
/// without TLS.
///
/// # Errors
/// The mistakes in each of the files that the profile names.
pub fn broker(mqtt: &Mqtt) -> Result<Option<Arc<ClientConfig>>, Vec<ProfileError>> {
    if !mqtt.broker.tls {
        return Ok(None);
    }
    let ca = mqtt.ca.as_ref();
    let builder = trusting(ca.map(|ca| ca.bytes.as_slice())).map_err(|why| {
        vec![ca.map_or_else(
            || mqtt.invalid(&why, "write `ca` into `tls`, for example tls = { ca = \"…\" }"),
            |ca| ca.invalid(&why),
        )]
    })?;
    let config = match &mqtt.own {
        None => builder.with_no_client_auth(),
        Some((cert, key)) => showing(builder, own(cert, key)?, (cert, key))?,
    };
    Ok(Some(Arc::new(config)))
}
