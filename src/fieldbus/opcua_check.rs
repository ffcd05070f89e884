//! What is wrong with the OPC UA lines of a profile that only whoever opens them can tell: that this program cannot, or
//! that their files are of no use.

use isotherm_profile::{Errors, Profile, ProfileError};

/// What is wrong with the OPC UA lines of a profile, at its keys.
///
/// # Errors
/// All of it, in the order of the file.
pub fn check(profile: &Profile) -> Result<(), Errors> {
    let lines = profile.buses.iter().filter_map(|bus| bus.opcua.as_ref());
    let mut wrong: Vec<ProfileError> = lines.flat_map(wrong).collect();
    wrong.sort_by_key(|error| (error.line, error.column));
    if wrong.is_empty() { Ok(()) } else { Err(Errors(wrong)) }
}

#[cfg(feature = "opcua")]
use super::opcua::wrong;

#[cfg(not(feature = "opcua"))]
fn wrong(line: &isotherm_profile::OpcUa) -> Vec<ProfileError> {
    let help = "take a packaged program, or build it in: `cargo build --release --features opcua`";
    vec![line.wrong_type("this program was built without OPC UA", help)]
}
