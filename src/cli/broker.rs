//! The MQTT broker of `[mqtt]`: checks of its files, a test connection, and the start of publishing.

use isotherm_profile::{Errors, Profile};
#[cfg(feature = "mqtt")]
use {
    super::connection_test::ConnectionTest,
    crate::fieldbus::tls,
    crate::gateway::make_directory,
    crate::observe::mqtt::{Publishing, kept_in, probe},
    crate::observe::status::{BrokerFigures, GatewayApi},
    std::path::Path,
    std::sync::Arc,
};

/// Checks the TLS files of `[mqtt]`, which the profile reader does not check.
///
/// # Errors
/// Every error of these TLS files, in the order of the keys in the profile.
#[cfg(feature = "mqtt")]
pub(super) fn check(profile: &Profile) -> Result<(), Errors> {
    let Some(Err(mut wrong)) = profile.mqtt.as_ref().map(tls::broker) else { return Ok(()) };
    wrong.sort_by_key(|error| (error.line, error.column));
    Err(Errors(wrong))
}

/// Rejects a profile with `[mqtt]`, because this program was built without MQTT and cannot publish.
///
/// # Errors
/// The profile has a table `[mqtt]`.
#[cfg(not(feature = "mqtt"))]
pub(super) fn check(profile: &Profile) -> Result<(), Errors> {
    let help = "use a packaged program, or build one with MQTT: `cargo build --release --features mqtt`";
    let wrong = |mqtt: &isotherm_profile::Mqtt| mqtt.invalid("this program was built without MQTT", help);
    profile.mqtt.as_ref().map_or(Ok(()), |mqtt| Err(Errors(vec![wrong(mqtt)])))
}

/// Starts publishing to the broker. Returns `None` if the profile has no `[mqtt]`.
///
/// # Errors
/// The system cannot start a thread for the connection.
#[cfg(feature = "mqtt")]
pub(super) fn publish(
    profile: &Profile,
    source: &Arc<dyn GatewayApi>,
    figures: Option<&Arc<BrokerFigures>>,
    state: &Path,
) -> std::io::Result<Option<Publishing>> {
    let Some((mqtt, figures)) = profile.mqtt.as_ref().zip(figures) else { return Ok(None) };
    // If the directory cannot be made, the error is reported when something is to be kept in it.
    let _ = make_directory(&kept_in(state, &profile.name));
    // Errors in these files have been reported already.
    let trust = tls::broker(mqtt).unwrap_or_default();
    Publishing::start((profile, mqtt), trust, source, figures, state).map(Some)
}

/// Connects to the broker and subscribes, without publishing. Returns the result; `None` if the profile has no
/// `[mqtt]`.
#[cfg(feature = "mqtt")]
pub(super) async fn test_connection(profile: &Profile) -> Option<ConnectionTest> {
    let mqtt = profile.mqtt.as_ref()?;
    // Errors in these files have been reported already.
    let trust = tls::broker(mqtt).unwrap_or_default();
    let fault = probe(profile, mqtt, trust).await.err();
    let well = "accepts the gateway and its subscriptions; nothing was published";
    Some(ConnectionTest::at("broker", mqtt.broker.to_string(), well, fault.map(|fault| fault.to_string())))
}
