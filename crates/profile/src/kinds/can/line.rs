//! Preview of a CAN line: the SYNC messages that the gateway sends, and the filters in the kernel. The kernel discards
//! received frames that no filter matches.

use crate::document::{Section, entries, grouped};
use crate::duration::shown;
use crate::{BusId, Profile};
use isotherm_core::codec::{Address, CanId, CanMatch};

/// Services of a CANopen node. The node sends each service with this identifier plus its node number.
const SERVICES: [(u32, &str); 3] =
    [(0x80, "emergencies"), (0x580, "SDO answers"), (0x700, "boot-up and heartbeat")];

pub(super) fn preview(profile: &Profile, id: BusId) -> Section {
    let values = profile.signals.iter().filter_map(|signal| match &signal.address {
        Address::Frame(field) => Some((field.frames, profile.device(signal.device))),
        _ => None,
    });
    let values = values.filter(|(_, device)| device.bus == id);
    let values = values.map(|(frames, device)| (frames, format!("values of {}", device.name)));
    let services = profile.devices_on(id).flat_map(|(_, device)| {
        let node = device.can.as_ref().and_then(|can| can.node);
        node.into_iter().flat_map(move |node| {
            SERVICES.into_iter().filter_map(move |(base, what)| {
                let id = CanId::standard(base + u32::from(node))?;
                Some((CanMatch::exactly(id), format!("{what} of {}", device.name)))
            })
        })
    });
    // A device may have several values in one frame.
    let once =
        grouped(values.chain(services).map(|filter| (filter, ()))).into_iter().map(|(filter, _)| filter);
    let mut filters = grouped(once);
    filters.sort_by_key(|(frames, _)| *frames);
    let filters: Vec<String> =
        filters.iter().map(|(frames, what)| format!("{frames}: {}", what.join(", "))).collect();
    let sync = profile.bus(id).sync.map(|sync| format!("SYNC {} every {}", sync.id, shown(sync.every)));
    let mut section = Section::default();
    section.lines("  sends ", &sync);
    section.line(match filters.is_empty() {
        true => "  the kernel passes no frames",
        false => "  the kernel passes only these frames:",
    });
    section.lines("    ", &filters);
    entries!(section, sync, filters);
    section
}
