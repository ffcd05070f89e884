//! Preview of a CAN line in the output of `isotherm check`: the SYNC messages that the gateway sends, and the
//! receive filters of the kernel. The kernel discards received frames that match no filter. This file also
//! contains the preview of a device on a CAN line.

use super::emergency::Emergency;
use super::node::{CanDevice, Setup};
use crate::document::{Section, entries, grouped};
use crate::duration::shown;
use crate::{BusId, DeviceId, Profile};
use isotherm_core::codec::{Address, CanId, CanMatch};

/// Services of a CANopen node: base identifier and name. The node sends each service with the base identifier plus its
/// node number.
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
        true => "  the kernel passes no frames to the gateway",
        false => "  the kernel passes only these frames:",
    });
    section.lines("    ", &filters);
    entries!(section, sync, filters);
    section
}

impl CanDevice {
    /// Returns the preview of the device: monitoring, setup, received frames, requested objects, written
    /// frames.
    pub(crate) fn preview(&self, profile: &Profile, id: DeviceId) -> Section {
        let own = || profile.signals_of(id).map(|(_, signal)| signal);
        let watched = self.node.map(|node| {
            let started = match self.start {
                true => format!(
                    "the gateway starts node {node} by NMT at each start of the gateway and after each \
                     boot-up of the node"
                ),
                false => {
                    format!(
                        "the gateway does not start node {node}: the node starts by itself, or another master \
                         starts the node"
                    )
                }
            };
            let heartbeat =
                self.heartbeat.map_or("the heartbeat of the node is not monitored".to_owned(), |span| {
                    format!(
                        "the heartbeat of the node counts as missing after {}, also if none was ever \
                         received",
                        shown(span)
                    )
                });
            [started, heartbeat]
        });
        let setup = self.setup.iter().map(|Setup { object, value, what }| {
            let what = if what.is_empty() { String::new() } else { format!(": {what}") };
            format!(
                "before each start of the node, the gateway writes {object} = {value} ({}){what}",
                object.data_type.name()
            )
        });
        let fields = own().filter_map(|signal| match &signal.address {
            Address::Frame(field) => Some((field, signal.name.as_str())),
            _ => None,
        });
        let values = grouped(fields).into_iter().map(|(field, names)| {
            let choice: String = field.multiplex.iter().map(|selector| format!(", {selector}")).collect();
            (field.frames, format!("{} ({}{choice})", names.join(" and "), field.bits))
        });
        let frames = grouped(values).into_iter();
        let frames = frames.map(|(frames, values)| format!("frame {frames}: {}", values.join(", ")));
        let every = shown(profile.device(id).every);
        let objects = profile.objects(id).into_iter().filter_map(|object| {
            let of = own().filter(|signal| signal.address == Address::Object(object));
            let names: Vec<&str> = of.map(|signal| signal.name.as_str()).collect();
            let kind = object.data_type.name();
            (!names.is_empty())
                .then(|| format!("object {object}, {kind}, every {every}: {}", names.join(", ")))
        });
        let sends = self.written.iter().map(|frame| {
            let is_in = |address: &Address| matches!(address, Address::Frame(field) if field.frames.takes(frame.id()));
            let of = profile.outputs.iter().filter(|output| output.device == id && is_in(&output.address));
            let names: Vec<&str> = of.map(|output| output.name.as_str()).collect();
            let bytes: Vec<String> = frame.data().iter().map(|byte| format!("{byte:02x}")).collect();
            let kind = if frame.is_fd() { "CAN FD, " } else { "" };
            let (id, count, bytes, names) = (frame.id(), bytes.len(), bytes.join(" "), names.join(", "));
            format!("sends {id}, {kind}{count} bytes: {bytes}, into which the values of {names} are inserted")
        });
        let emergencies = self.emergencies.iter().map(|Emergency { code, mask, meaning }| {
            let bits = if *mask == u16::MAX { String::new() } else { format!(" in the bits of {mask:#06x}") };
            format!("emergency {code:#06x}{bits}: {meaning}")
        });
        let mut section = Section::default();
        section.entry("node", self.node);
        let lists: [(&str, Vec<String>); 6] = [
            ("watched", watched.into_iter().flatten().collect()),
            ("setup", setup.collect()),
            ("frames", frames.collect()),
            ("objects", objects.collect()),
            ("sends", sends.collect()),
            ("emergencies", emergencies.collect()),
        ];
        for (key, list) in lists {
            section.lines("    ", &list);
            section.entry(key, list);
        }
        section
    }
}
