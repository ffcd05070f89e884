//! What the kernel lets through of a CAN line, and what is sent to all of its nodes. Everything else on the line costs
//! nothing but this.

use crate::document::Section;
use crate::duration::shown;
use crate::{BusId, Profile};
use isotherm_core::codec::{Address, CanId, CanMatch};

pub(super) fn preview(profile: &Profile, id: BusId) -> Section {
    let mut filters: Vec<(CanMatch, String)> = Vec::new();
    let mut add = |frames: CanMatch, what: String| {
        let known = filters.iter_mut().find(|(known, _)| *known == frames);
        match known {
            Some((_, there)) if there.contains(&what) => {}
            Some((_, there)) => *there = format!("{there}, {what}"),
            None => filters.push((frames, what)),
        }
    };
    for signal in &profile.signals {
        let device = profile.device(signal.device);
        if let (Address::Frame(field), true) = (&signal.address, device.bus == id) {
            add(field.frames, format!("values of {}", device.name));
        }
    }
    for (_, device) in profile.devices_on(id) {
        let Some(node) = device.can.as_ref().and_then(|can| can.node) else { continue };
        for (base, what) in [(0x80, "emergencies"), (0x580, "SDO answers"), (0x700, "boot-up and heartbeat")]
        {
            if let Some(id) = CanId::standard(base + u32::from(node)) {
                add(CanMatch::exactly(id), format!("{what} of {}", device.name));
            }
        }
    }
    filters.sort_by_key(|(frames, _)| *frames);
    let filters: Vec<String> = filters.iter().map(|(frames, what)| format!("{frames}: {what}")).collect();
    let sync = profile.bus(id).sync.map(|sync| format!("SYNC {} every {}", sync.id, shown(sync.every)));
    let mut section = Section::default();
    section.lines("  sends ", &sync);
    section.line(match filters.is_empty() {
        true => "  the kernel lets nothing through",
        false => "  the kernel lets through",
    });
    section.lines("    ", &filters);
    section.entry("sync", sync);
    section.entry("filters", filters);
    section
}
