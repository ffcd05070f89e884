//! Check of the OPC UA lines and of the OPC UA server of a profile: whether this program was built with OPC UA, and
//! whether the files that they name are usable.

use isotherm_profile::{Errors, OpcUaServer, Profile, ProfileError};

/// Checks the OPC UA lines and the OPC UA server of a profile.
///
/// # Errors
/// All mistakes with their keys, in the order of the file.
pub fn check(profile: &Profile) -> Result<(), Errors> {
    let lines = profile.buses.iter().filter_map(|bus| bus.opcua.as_deref());
    let of_server = profile.opcua_server.iter().flat_map(wrong_server);
    let mut wrong: Vec<ProfileError> = lines.flat_map(wrong).chain(of_server).collect();
    wrong.sort_by_key(|error| (error.line, error.column));
    if wrong.is_empty() { Ok(()) } else { Err(Errors(wrong)) }
}

#[cfg(feature = "opcua")]
pub use super::client::server_files::ServerFiles;
#[cfg(feature = "opcua")]
use super::client::wrong;

/// Reads the files that the table `[opcua_server]` of the profile names.
///
/// # Errors
/// All mistakes in these files.
#[cfg(feature = "opcua")]
pub fn server_files(server: &OpcUaServer) -> Result<ServerFiles, Vec<ProfileError>> {
    super::client::server_files::read(server)
}

#[cfg(feature = "opcua")]
fn wrong_server(server: &OpcUaServer) -> Vec<ProfileError> {
    server_files(server).err().unwrap_or_default()
}

/// Message and hint for a program that was built without OPC UA.
#[cfg(not(feature = "opcua"))]
const NOT_BUILT_IN: (&str, &str) = (
    "this program was built without OPC UA",
    "use a packaged program, or build one with OPC UA: `cargo build --release --features opcua`",
);

#[cfg(not(feature = "opcua"))]
fn wrong(line: &isotherm_profile::OpcUa) -> Vec<ProfileError> {
    vec![line.wrong_type(NOT_BUILT_IN.0, NOT_BUILT_IN.1)]
}

#[cfg(not(feature = "opcua"))]
fn wrong_server(server: &OpcUaServer) -> Vec<ProfileError> {
    vec![server.invalid(NOT_BUILT_IN.0, NOT_BUILT_IN.1)]
}
