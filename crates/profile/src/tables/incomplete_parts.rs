//! Warnings about incomplete parts of a profile: axes without a model or an output, unused devices. They are not
//! errors, because a profile is usually written step by step. Unused signals cause no warning, but `isotherm check`
//! lists them.

use std::collections::HashSet;

use super::Check;

/// Returns the names of the signals that no model, condition, output or machine state uses. Returns an empty list while
/// an axis has no model.
pub(super) fn only_recorded(check: &Check<'_>) -> Vec<String> {
    // The signals of a missing model are unknown.
    if check.axes.names.iter().any(|name| lacks_model(check, name)) {
        return Vec::new();
    }
    let names = check.signals.names.iter().zip(check.report.used());
    names.filter(|(_, is_used)| !is_used).map(|(name, _)| name.clone()).collect()
}

fn lacks_model(check: &Check<'_>, name: &str) -> bool {
    check.raw.axis.get(name).is_some_and(|axis| axis.model.as_ref().is_none_or(Vec::is_empty))
}

pub(super) fn warn(check: &Check<'_>) {
    let raw = check.raw;
    let is_complete = check.outputs.resolved.iter().all(Option::is_some);
    let written: HashSet<usize> = check.outputs.valid().map(|output| output.axis.0).collect();
    for (index, name) in check.axes.names.iter().enumerate() {
        let at = check.at("axis").key(name);
        if lacks_model(check, name) {
            let message = format!("`{name}` has no model yet: the axis stays off");
            let help = "record test runs with `isotherm record`, find the model with `isotherm identify`, \
                        and put the block of the model here";
            at.warn_key(message, Some(help));
        }
        if is_complete && !written.contains(&index) {
            let message =
                format!("no output writes the Cz of `{name}`: this Cz is computed and shown, never applied");
            at.warn_key(message, None);
        }
    }
    two_at_a_time(check);
    let of_signals = raw.signal.values().filter_map(|signal| signal.device.as_ref());
    let of_outputs = raw.output.values().filter_map(|output| output.device.as_ref());
    let of_heartbeat = raw.heartbeat.iter().filter_map(|heartbeat| heartbeat.device.as_ref());
    let asked: HashSet<&String> = of_signals.chain(of_outputs).chain(of_heartbeat).collect();
    for (index, name) in check.devices.names.iter().enumerate() {
        if !asked.contains(name) && check.devices.get(index).is_some() {
            let message = format!("nothing is read from `{name}` and nothing is written to it");
            check.at("device").key(name).warn_key(message, None);
        }
    }
}

/// Warns about a `pipeline` that has no effect. Two requests at a time need an output that writes a position plus Cz,
/// and a signal that can be read at the same time.
fn two_at_a_time(check: &Check<'_>) {
    let line = |device: usize| check.devices.get(device).map(|device| device.bus.0);
    let corrected = check.outputs.valid().filter(|output| output.writes.position().is_some());
    let written: HashSet<usize> = corrected.filter_map(|output| line(output.device.0)).collect();
    let read: HashSet<usize> = check.signals.valid().filter_map(|signal| line(signal.device.0)).collect();
    for (place, name) in check.buses.names.iter().enumerate() {
        let is_two = check.buses.get(place).is_some_and(|bus| bus.pipeline > 1);
        if is_two && !(written.contains(&place) && read.contains(&place)) {
            let message = "`pipeline` has no effect here: on this bus, the gateway writes no corrected \
                           position, or reads no signal";
            check.at("bus").key(name).key("pipeline").warn_key(message, Some("remove `pipeline`"));
        }
    }
}
