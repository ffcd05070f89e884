//! What hangs on a CAN line: the line, its nodes, their objects.

use super::{Check, Zero, shown};
use crate::place::{child, element};
use crate::raw::{BusType, RawBus, RawDevice, RawSetup, RawVerify};
use crate::{CanDevice, Emergency, Expected, Setup, Sync};
use isotherm_core::codec::{Address, CanId, DataType, Entry, Object};

mod conflicts;
mod dbc;
mod output;
mod signal;

pub(super) use dbc::Dbcs;
pub(super) use output::{Target, Written};
pub(super) use signal::Located;

/// Longest name of a network interface on Linux.
const LONGEST_NAME: usize = 15;
/// SYNC, where nothing else is said.
const SYNC: u32 = 0x80;

impl Check<'_> {
    /// Whether a device hangs on a CAN line; `None` where its line is not known.
    pub(super) fn is_on_can(&self, device: &str) -> Option<bool> {
        let bus = self.raw.device.get(device)?.bus.as_ref()?;
        Some(self.raw.bus.get(bus)?.kind? == BusType::Can)
    }

    pub(super) fn interface(&mut self, path: &str, raw: &RawBus) -> Option<String> {
        let Some(name) = &raw.interface else {
            let help = "write the network interface, as \"can0\"; `ip link` shows which there are";
            self.missing(path, "interface", "`interface` is missing: where is the line?", help);
            return None;
        };
        let plain = |c: char| c != '/' && !c.is_whitespace();
        if name.is_empty() || name.len() > LONGEST_NAME || !name.chars().all(plain) {
            let help = "write its name, as \"can0\": up to 15 characters; `ip link` shows which there are";
            self.wrong(&child(path, "interface"), format!("`{name}` cannot be a network interface"), help);
            return None;
        }
        Some(name.clone())
    }

    pub(super) fn sync(&mut self, path: &str, raw: &RawBus) -> Option<Sync> {
        let sync = raw.sync.as_ref()?;
        let path = child(path, "sync");
        let every = self.span(&child(&path, "every"), sync.every.as_ref(), Zero::Refused);
        Some(Sync { id: CanId::standard(sync.cob_id.unwrap_or(SYNC))?, every: every? })
    }

    /// What a device has on a CAN line; `None` where it hangs on another.
    pub(super) fn can_device(&mut self, path: &str, name: &str, raw: &RawDevice) -> Option<CanDevice> {
        let on_can = self.is_on_can(name);
        let objects = raw.verify.iter().flatten().any(|verify| verify.sdo.is_some());
        let of_can = [
            ("dbc", raw.dbc.is_some()),
            ("source_address", raw.source_address.is_some()),
            ("node", raw.node.is_some()),
            ("start", raw.start.is_some()),
            ("heartbeat", raw.heartbeat.is_some()),
            ("setup", raw.setup.is_some()),
            ("emergency", raw.emergency.is_some()),
        ];
        if on_can != Some(true) {
            for (key, _) in of_can.iter().filter(|(_, there)| *there && on_can == Some(false)) {
                let help = "remove it, or put the device on a bus of type \"can\"";
                self.wrong_key(&child(path, key), format!("`{key}` belongs to a device on a CAN line"), help);
            }
            if objects && on_can == Some(false) {
                let help = "write `register`, as \"coil:268\" or \"holding:256\"";
                self.wrong_key(&child(path, "verify"), "a Modbus device has no CANopen objects", help);
            }
            return None;
        }
        for (key, there) in [
            ("unit", raw.unit.is_some()),
            ("functions", raw.functions.is_some()),
            ("quirks", raw.quirks.is_some()),
        ] {
            if there {
                let help = "remove it; a CANopen device has a `node`, and others are known by their frames";
                self.wrong_key(&child(path, key), format!("`{key}` belongs to a Modbus device"), help);
            }
        }
        self.only_of_a_node(path, raw);
        if raw.source_address.is_some() && raw.dbc.is_none() {
            let help = "write dbc = \"…\" as well: parameter groups come from a DBC file";
            self.wrong_key(&child(path, "source_address"), "`source_address` needs a DBC file", help);
        }
        let heartbeat = self.span(&child(path, "heartbeat"), raw.heartbeat.as_ref(), Zero::Refused);
        let at = child(path, "setup");
        let setup = raw.setup.iter().flatten().enumerate();
        let setup = setup.filter_map(|(place, raw)| self.setup(&element(&at, place), raw)).collect();
        let emergencies = raw.emergency.iter().flatten().filter_map(|raw| {
            let (code, words) = (raw.code?, raw.means.clone()?);
            Some(Emergency { code, mask: raw.mask.unwrap_or(u16::MAX), words })
        });
        Some(CanDevice {
            node: raw.node,
            start: raw.start.unwrap_or(true),
            heartbeat,
            setup,
            emergencies: emergencies.collect(),
            written: Vec::new(),
        })
    }

    fn only_of_a_node(&mut self, path: &str, raw: &RawDevice) {
        if raw.node.is_some() || self.places.contains(&child(path, "node")) {
            return;
        }
        for (key, there) in [
            ("start", raw.start.is_some()),
            ("heartbeat", raw.heartbeat.is_some()),
            ("setup", raw.setup.is_some()),
            ("emergency", raw.emergency.is_some()),
            ("verify", raw.verify.is_some()),
        ] {
            if there {
                let help = "write node = 5, the node number set at the device, 1 to 127";
                self.wrong(&child(path, key), format!("`{key}` needs a CANopen node"), help);
            }
        }
    }

    fn setup(&mut self, path: &str, raw: &RawSetup) -> Option<Setup> {
        let object = self.entry(&child(path, "sdo"), raw.sdo.as_ref()?);
        let at = child(path, "type");
        let data_type = self.object_type(&at, DataType::from(raw.kind?));
        let (entry, data_type, value) = (object?, data_type?, raw.value?);
        let Some((low, high)) = data_type.integer_range() else {
            let help = "take an integer type: u8, u16, i16, u32, i32, …";
            self.wrong(&at, "a floating-point object cannot be set up", help);
            return None;
        };
        if !(low..=high).contains(&i128::from(value)) {
            let message = format!("{} never holds {value}", data_type.name());
            self.wrong(&child(path, "value"), message, format!("allowed: {low} to {high}"));
        }
        let what = raw.what.clone().unwrap_or_default();
        Some(Setup { object: Object { entry, data_type }, value, what })
    }

    /// Index and subindex: "1800:05".
    pub(super) fn entry(&mut self, path: &str, text: &str) -> Option<Entry> {
        let parsed = text.split_once(':').and_then(|(index, sub)| {
            let plain = |part: &str, length| {
                part.len() == length && part.bytes().all(|byte| byte.is_ascii_hexdigit())
            };
            let fits = plain(index, 4) && plain(sub, 2);
            let numbers = (u16::from_str_radix(index, 16).ok()?, u8::from_str_radix(sub, 16).ok()?);
            fits.then_some(Entry::new(numbers.0, numbers.1))
        });
        if parsed.is_none() {
            let help = "write index and subindex in hexadecimal, four digits and two, as \"7130:01\"";
            self.wrong(path, format!("`{text}` is no CANopen object"), help);
        }
        parsed
    }

    /// The types that an object can have.
    pub(super) fn object_type(&mut self, path: &str, kind: DataType) -> Option<DataType> {
        match kind {
            // A BOOLEAN takes a byte of its own.
            DataType::Bool => Some(DataType::unsigned(8)),
            DataType::Decimal24(_) => {
                let help = "allowed: bool, u8, i8, u16, i16, u32, i32, u64, i64, f32, f64";
                self.wrong(path, "decimal24 is a type of Modbus displays", help);
                None
            }
            kind => Some(kind),
        }
    }

    /// Objects that are read before arming.
    pub(super) fn expected_objects(&mut self, path: &str, raw: &RawDevice) -> Vec<Expected> {
        let entries = raw.verify.iter().flatten().enumerate();
        entries.filter_map(|(place, raw)| self.expected_object(&element(path, place), raw)).collect()
    }

    fn expected_object(&mut self, path: &str, raw: &RawVerify) -> Option<Expected> {
        for (key, there) in [("register", raw.register.is_some()), ("word_order", raw.word_order.is_some())] {
            if there {
                let help = "remove it, and write sdo = \"6110:01\"";
                self.wrong_key(&child(path, key), format!("`{key}` belongs to a Modbus device"), help);
            }
        }
        let Some(sdo) = &raw.sdo else {
            if raw.register.is_none() {
                let help = "write `sdo`, as \"6110:01\"";
                self.missing(path, "sdo", "`sdo` is missing: what is to be read?", help);
            }
            return None;
        };
        let entry = self.entry(&child(path, "sdo"), sdo);
        let kind = raw.kind.map_or(DataType::U16, DataType::from);
        let data_type = self.object_type(&child(path, "type"), kind)?;
        let equals = self.equal(path, data_type, raw.equals)?;
        Some(Expected {
            address: Address::Object(Object { entry: entry?, data_type }),
            encoding: super::verify::plain(data_type),
            equals,
            what: raw.what.clone().unwrap_or_else(|| "as the profile expects it".to_owned()),
            remedy: raw.remedy.clone().unwrap_or_default(),
        })
    }

    /// Heartbeats that come too rarely to be missed in time are told here, where both are known.
    pub(super) fn heartbeat_produced(&mut self, path: &str, can: &CanDevice) {
        let Some(heartbeat) = can.heartbeat else { return };
        let produced = can.setup.iter().find(|setup| setup.object.entry.index == 0x1017);
        if let Some(produced) = produced {
            let every = std::time::Duration::from_millis(u64::try_from(produced.value).unwrap_or(0));
            if every.is_zero() || every * 2 > heartbeat {
                let pace =
                    if every.is_zero() { "none".to_owned() } else { format!("one every {}", shown(every)) };
                let message = format!(
                    "`heartbeat` is {}, and 1017:00 in `setup` has the node send {pace}",
                    shown(heartbeat)
                );
                let help = "have it sent at least twice in that time: a lost one is no fault";
                self.wrong(&child(path, "heartbeat"), message, help);
            }
        }
    }
}
