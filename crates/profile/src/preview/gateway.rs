//! Preview of a Modbus TCP line with a gateway to a serial line.

use crate::document::Section;
use crate::{BusId, Profile};

/// Preview of the devices behind a gateway. `None` if there are none.
pub(super) fn preview(profile: &Profile, id: BusId) -> Option<Section> {
    let here = profile.devices_on(id).filter(|(device, _)| profile.is_behind_gateway(*device));
    let devices: Vec<&str> = here.map(|(_, device)| device.name.as_str()).collect();
    if devices.is_empty() {
        return None;
    }
    let mut section = Section::default();
    section
        .line(format!("  as behind a gateway to a serial line (`quirks.gateway`): {}", devices.join(", ")));
    section.line("  after a missed answer a unit is not asked before its late answer has had its time");
    section.entry("devices", &devices);
    Some(section)
}
