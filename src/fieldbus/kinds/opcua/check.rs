//! Check of the OPC UA lines of a profile: whether this program supports them, and whether their files are usable.

use isotherm_profile::{Errors, Profile, ProfileError};

/// Checks the OPC UA lines of a profile.
///
/// # Errors
/// All mistakes with their keys, in the order of the file.
pub fn check(profile: &Profile) -> Result<(), Errors> {
    let lines = profile.buses.iter().filter_map(|bus| bus.opcua.as_ref());
    let mut wrong: Vec<ProfileError> = lines.flat_map(wrong).collect();
    wrong.sort_by_key(|error| (error.line, error.column));
    if wrong.is_empty() { Ok(()) } else { Err(Errors(wrong)) }
}

#[cfg(feature = "opcua")]
use super::client::wrong;

#[cfg(not(feature = "opcua"))]
fn wrong(line: &isotherm_profile::OpcUa) -> Vec<ProfileError> {
    let help = "use a packaged program, or build one with OPC UA: `cargo build --release --features opcua`";
    vec![line.wrong_type("this program was built without OPC UA", help)]
}
