//! What is received, asked, sent and watched on a CAN line.

use std::fmt;

use serde::Serialize;

use crate::{BusId, CanDevice, DeviceId, Profile};
use isotherm_core::codec::{Address, CanId, CanMatch, Field};

/// What the kernel lets through, and what is sent to all.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CanLineExplained {
    /// `SYNC 0x080 every 100ms`.
    pub sync: Option<String>,
    /// `0x185: process data of axtc`. Everything else on the line costs nothing but this.
    pub filters: Vec<String>,
}

/// What a device does on a CAN line.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CanExplained {
    /// CANopen node number.
    pub node: Option<u8>,
    /// Whether it is started by NMT, and how its heartbeat is watched.
    pub watched: Vec<String>,
    /// `before each start writes 1800:05 = 100 (u16): TPDO1 every 100 ms`.
    pub setup: Vec<String>,
    /// `0x185: column (16 bits from 0 up (Intel), signed)`.
    pub frames: Vec<String>,
    /// `object 6150:01, u8, every 1s: column_status`.
    pub objects: Vec<String>,
    /// `sends 0x20c, 8 bytes, 00 00 00 00 00 00 01 00 before the value: shown_x`.
    pub sends: Vec<String>,
    /// `emergency 0xff01: open thermocouple`.
    pub emergencies: Vec<String>,
}

pub(super) fn line(profile: &Profile, id: BusId) -> CanLineExplained {
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
    for device in profile.devices.iter().filter(|device| device.bus == id) {
        let Some(node) = device.can.as_ref().and_then(|can| can.node) else { continue };
        for (base, what) in [(0x80, "emergencies"), (0x580, "SDO answers"), (0x700, "boot-up and heartbeat")]
        {
            if let Some(id) = CanId::standard(base + u32::from(node)) {
                add(CanMatch::exactly(id), format!("{what} of {}", device.name));
            }
        }
    }
    filters.sort_by_key(|(frames, _)| *frames);
    let shown = |(frames, what): &(CanMatch, String)| format!("{frames}: {what}");
    CanLineExplained {
        sync: profile
            .bus(id)
            .sync
            .map(|sync| format!("SYNC {} every {}", sync.id, humantime::format_duration(sync.every))),
        filters: filters.iter().map(shown).collect(),
    }
}

pub(super) fn device(profile: &Profile, id: DeviceId, can: &CanDevice) -> CanExplained {
    let device = profile.device(id);
    let mut watched = Vec::new();
    if let Some(node) = can.node {
        watched.push(if can.start {
            format!("node {node} is started by NMT at the beginning and after each boot-up")
        } else {
            format!("node {node} is not started by NMT: it starts by itself, or another master starts it")
        });
        watched.push(match can.heartbeat {
            Some(span) => {
                format!(
                    "its heartbeat is missed after {}, never seen counts as missed",
                    humantime::format_duration(span)
                )
            }
            None => "its heartbeat is not watched".to_owned(),
        });
    }
    let setup = can.setup.iter().map(|entry| {
        let (object, kind, value) = (entry.object, entry.object.data_type.name(), entry.value);
        let what = if entry.what.is_empty() { String::new() } else { format!(": {}", entry.what) };
        format!("before each start writes {object} = {value} ({kind}){what}")
    });
    let every = humantime::format_duration(device.every);
    let own = || profile.signals.iter().filter(|signal| signal.device == id);
    let mut fields: Vec<(&Field, Vec<&str>)> = Vec::new();
    for signal in own() {
        let Address::Frame(field) = &signal.address else { continue };
        match fields.iter_mut().find(|(known, _)| *known == field) {
            Some((_, names)) => names.push(&signal.name),
            None => fields.push((field, vec![&signal.name])),
        }
    }
    let mut frames: Vec<(CanMatch, Vec<String>)> = Vec::new();
    for (field, names) in fields {
        let choice: String = field.multiplex.iter().map(|selector| format!(", {selector}")).collect();
        let value = format!("{} ({}{choice})", names.join(" and "), field.bits);
        match frames.iter_mut().find(|(known, _)| *known == field.frames) {
            Some((_, values)) => values.push(value),
            None => frames.push((field.frames, vec![value])),
        }
    }
    let objects = profile.objects(id).into_iter().filter_map(|object| {
        let of = own().filter(|signal| signal.address == Address::Object(object));
        let names: Vec<&str> = of.map(|signal| signal.name.as_str()).collect();
        let kind = object.data_type.name();
        (!names.is_empty()).then(|| format!("object {object}, {kind}, every {every}: {}", names.join(", ")))
    });
    let sends = can.written.iter().map(|frame| {
        let of = profile.outputs.iter().filter(|output| {
            let is_in = |field: &Field| field.frames.takes(frame.id());
            output.device == id && matches!(&output.address, Address::Frame(field) if is_in(field))
        });
        let names: Vec<&str> = of.map(|output| output.name.as_str()).collect();
        let bytes: Vec<String> = frame.data().iter().map(|byte| format!("{byte:02x}")).collect();
        let kind = if frame.is_fd() { "CAN FD, " } else { "" };
        let (id, count) = (frame.id(), bytes.len());
        format!(
            "sends {id}, {kind}{count} bytes, {} before the values: {}",
            bytes.join(" "),
            names.join(", ")
        )
    });
    let emergencies = can.emergencies.iter().map(|known| {
        let mask = if known.mask == u16::MAX {
            String::new()
        } else {
            format!(" in the bits of {:#06x}", known.mask)
        };
        format!("emergency {:#06x}{mask}: {}", known.code, known.meaning)
    });
    CanExplained {
        node: can.node,
        watched,
        setup: setup.collect(),
        frames: frames
            .iter()
            .map(|(frames, values)| format!("frame {frames}: {}", values.join(", ")))
            .collect(),
        objects: objects.collect(),
        sends: sends.collect(),
        emergencies: emergencies.collect(),
    }
}

impl fmt::Display for CanLineExplained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(sync) = &self.sync {
            writeln!(f, "  sends {sync}")?;
        }
        if self.filters.is_empty() {
            return writeln!(f, "  the kernel lets nothing through");
        }
        writeln!(f, "  the kernel lets through")?;
        self.filters.iter().try_for_each(|filter| writeln!(f, "    {filter}"))
    }
}

impl fmt::Display for CanExplained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lists = [&self.watched, &self.setup, &self.frames, &self.objects, &self.sends, &self.emergencies];
        lists.into_iter().flatten().try_for_each(|line| writeln!(f, "    {line}"))
    }
}
