//! Start of the OPC UA server that the table `[opcua_server]` of the profile describes.

use std::path::Path;
use std::sync::Arc;

use super::descriptors::Shares;
use super::port::hostname;
use crate::fieldbus::kinds::opcua::check as opcua_check;
use crate::observe::opcua_server::{Login, OwnCertificate, Secret, ServerFiles, ServerPlace, Serving};
use crate::observe::status::GatewayApi;
use isotherm_profile::{OpcUaServer, Profile, ServerLogin};

/// Starts to serve OPC UA clients. Returns `None` if the profile has no `[opcua_server]`.
///
/// # Errors
/// The system cannot start a thread for the server.
pub(super) fn serve(
    profile: &Profile,
    source: &Arc<dyn GatewayApi>,
    state: &Path,
) -> std::io::Result<Option<Serving>> {
    let Some(settings) = &profile.opcua_server else { return Ok(None) };
    let connections = Shares::now(profile.buses.len()).opcua;
    let hostname = hostname();
    let files = files(settings, &format!("urn:{hostname}:isotherm:{}", profile.name));
    let place = ServerPlace { state: state.to_owned(), hostname, connections };
    Serving::start((profile.name.as_str(), settings), files, source, place).map(Some)
}

/// Reads the certificates and the secrets of the users from the files that the profile names. `application` is the
/// application URI of a server without a certificate.
fn files(settings: &OpcUaServer, application: &str) -> ServerFiles {
    // Errors in these files have been reported already.
    let read = opcua_check::server_files(settings).unwrap_or_default();
    let users = settings.users.iter().zip(read.secrets).map(|(user, secret)| Login {
        name: user.name.clone(),
        secret: match user.login {
            ServerLogin::Password(_) => Secret::Password(String::from_utf8_lossy(&secret).into_owned()),
            ServerLogin::Certificate(_) => Secret::Certificate(secret),
        },
        takes_measured: user.takes_measured,
    });
    ServerFiles {
        own: read.own.map(|(cert, key)| OwnCertificate { cert, key }),
        application: read.application.unwrap_or_else(|| application.to_owned()),
        trusted: read.trusted,
        users: users.collect(),
    }
}
