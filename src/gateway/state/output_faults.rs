//! Texts about faults of outputs, with the names of the profile. For an output set, they name the node that failed.

use crate::fieldbus::error::Fault;
use isotherm_profile::{OutputId, Profile};

/// Describes the fault of a read or a write of an output.
pub(in crate::gateway) fn of_an_output(profile: &Profile, output: OutputId, fault: Fault) -> String {
    let set = profile.output(output).set.map(|set| profile.set(set));
    let named = |place: u16| set?.holds_at(profile, usize::from(place).checked_sub(1)?);
    let label = set.map_or(String::new(), |set| set.label());
    let words = match fault {
        Fault::Part { status, place } => named(place).map(|node| {
            format!("the server has written only some values of {label}: it answers {status} to {node}")
        }),
        Fault::Unreadable { reason, place } => {
            named(place).map(|node| format!("{node} cannot be read: {}", Fault::of_a_node(reason)))
        }
        _ => None,
    };
    words.unwrap_or_else(|| fault.to_string())
}
