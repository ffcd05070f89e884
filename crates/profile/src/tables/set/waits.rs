//! Checks the handshakes of output sets: their timeouts, and the bits with which the control acknowledges.

use std::collections::HashMap;

use super::OutputSet;
use crate::duration::shown;
use crate::tables::Check;

/// Reports a handshake timeout that is not longer than the bus timeout. A handshake waits twice: for the
/// acknowledge signal to rise, and to drop. Also reports a timeout with which both waits may take as long as
/// the period of the axis, or as the refresh of an output.
pub(super) fn has_time(check: &Check<'_>, set: &OutputSet) {
    let Some(handshake) = &set.handshake else { return };
    let at = set.at(check).key("handshake").key("timeout");
    let bus = check.devices.get(set.device.0).and_then(|device| check.bus_of(device));
    if let Some(bus) = bus.filter(|bus| handshake.timeout <= bus.timeout) {
        let (name, timeout) = (&bus.name, shown(bus.timeout));
        let message = format!(
            "the bus `{name}` waits {timeout} for an answer: there is no time to read the acknowledge signal"
        );
        at.invalid(message, "write a duration longer than `timeout` of the bus");
    }
    let whole = handshake.timeout * 2;
    for output in set.outputs.iter().filter_map(|id| check.outputs.get(id.0)) {
        let axis = check.axes.get(output.axis.0).map(|axis| &axis.settings);
        let called = axis.map(|axis| (format!("axis `{}`'s period", axis.name), axis.every));
        let refreshed =
            output.refresh.map(|refresh| (format!("`refresh` of output `{}`", output.name), refresh));
        for (what, every) in called.into_iter().chain(refreshed).filter(|(_, every)| *every <= whole) {
            let message = format!(
                "two waits of {} (for the acknowledge signal to rise and to drop) take at least as \
                 long as {what}, {}",
                shown(handshake.timeout),
                shown(every)
            );
            at.invalid(message, "shorten this timeout, or lengthen the period");
        }
    }
}

/// Reports an acknowledge bit that two handshakes use. Such a bit would not show which of the two is acknowledged.
pub(super) fn acknowledges_apart(check: &Check<'_>, sets: &[Option<OutputSet>]) {
    let mut users = HashMap::new();
    for set in sets.iter().flatten() {
        let Some(handshake) = &set.handshake else { continue };
        let other = *users.entry((set.device, handshake.acknowledge.to_string())).or_insert(set);
        if !std::ptr::eq(other, set) {
            let message = format!("{} uses the same acknowledge signal", other.label());
            let help = "use another acknowledge signal for each, or put the outputs into one set";
            set.at(check).key("handshake").key("acknowledge").invalid(message, help);
        }
    }
}
