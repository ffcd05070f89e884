//! Texts about faults of outputs, with the names of the profile. For an output set, they name the node that failed.

use crate::fieldbus::error::Fault;
use crate::fieldbus::seen::Asked;
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

/// Returns the size of the read of an output, for the advice in messages. Returns [`Asked::Any`] for an output in a
/// set, because the read of a set does not depend on the device's `quirks` for reads of signals.
pub(in crate::gateway) fn read_of(profile: &Profile, id: OutputId) -> Asked {
    match profile.output(id).set {
        Some(_) => Asked::Any,
        None => Asked::Read { values: 1, gap: 0 },
    }
}

/// Returns the function code of the write of an output, for the advice in messages. For an output set, this
/// is the function code of its longest write request.
pub(in crate::gateway) fn write_of(profile: &Profile, id: OutputId) -> Asked {
    let output = profile.output(id);
    let device = profile.device(output.device);
    let registers = match output.set.map(|set| profile.set(set)) {
        Some(set) => {
            let stretches = set.stretches(set.members(profile), device.longest_request());
            stretches.iter().map(|stretch| stretch.count).max().unwrap_or(0)
        }
        None => output.encoding.data_type.registers(),
    };
    let function = device.functions.writes(registers);
    function.map_or(Asked::Any, |function| Asked::Write(function.code()))
}
