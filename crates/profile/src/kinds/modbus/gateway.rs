//! Preview of the devices that a Modbus TCP line reaches through a Modbus gateway. A Modbus gateway connects a network
//! to a serial line.

use crate::document::Section;
use crate::{BusId, Profile};

/// Returns the preview of the devices behind a Modbus gateway, and how isotherm treats them. `None` if no
/// device of the line is behind a Modbus gateway.
pub(super) fn preview(profile: &Profile, id: BusId) -> Option<Section> {
    let here = profile.devices_on(id).filter(|(device, _)| profile.is_behind_gateway(*device));
    let devices: Vec<&str> = here.map(|(_, device)| device.name.as_str()).collect();
    if devices.is_empty() {
        return None;
    }
    let mut section = Section::default();
    section.line(format!(
        "  devices assumed to be behind a Modbus gateway to a serial line (`quirks.gateway`): {}",
        devices.join(", ")
    ));
    section.line(
        "  after a missing answer, the next request to a unit waits until a late answer can no longer arrive",
    );
    section.line(
        "  isotherm sends few requests to a unit that does not answer, so that the readings of other units \
         stay recent",
    );
    section.line("  isotherm sends a request to such a unit at least every five minutes");
    section.entry("devices", &devices);
    Some(section)
}
