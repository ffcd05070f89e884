//! CAN buses, also called CAN lines. Devices send frames by themselves. The gateway requests the objects of CANopen
//! nodes.

use crate::Signal;
use crate::plan::{Field, ReadRequest, ReadTarget};
use crate::tables::bus::transport::{BusType, Transport};
use crate::tables::bus::{Bus, LineSettings, LineType, RawBus, Sync};
use crate::tables::bus_kind::{BusKind, SignalKeys, SignalsOf};
use crate::tables::device::{Device, DeviceParts, RawDevice};
use crate::tables::signal::RawSignal;
use crate::tables::{Check, KeyContext};
use emergency::Emergency;
use isotherm_core::codec::{Address, CanId};
use isotherm_core::reading::SignalId;
use node::CanDevice;

pub(crate) mod channel;
mod conflicts;
mod dbc;
pub(crate) mod emergency;
pub(crate) mod fields;
pub(crate) mod frame_writes;
mod line;
pub(crate) mod node;
mod output;
mod signal;

/// Largest length of the name of a network interface on Linux, in characters.
const LONGEST_NAME: usize = 15;
/// Default CAN identifier of the SYNC message (CANopen).
const SYNC: u32 = 0x80;
/// Description, for messages, of the tables that may have keys such as `dbc` and `pdo`.
const OWNER: &str = "a device on a CAN line";

/// Kind of bus for CAN interfaces of this computer.
pub(super) static KIND: BusKind = BusKind {
    types: &[LineType {
        word: BusType::Can,
        title: "CAN",
        keys: &["late", "interface", "sync"],
        exclusive: Some("interface"),
        answer: LineType::ANSWER,
    }],
    line: |raw, at, _| Some((Transport::Can, interface(raw, at))),
    line_without_type: |raw, at, _| {
        if raw.interface.is_some() {
            interface(raw, at);
        }
    },
    settings: |raw, at, _, _| {
        let sync = raw.sync.as_ref().and_then(|sync| {
            let every = at.key("sync").key("every").period(sync.every);
            Some(Sync { id: CanId::standard(sync.cob_id.unwrap_or(SYNC))?, every: every? })
        });
        Some(LineSettings { sync, ..LineSettings::default() })
    },
    device,
    foreign_device_keys: &[(
        &["unit", "functions", "quirks"],
        "a Modbus device",
        "remove this key; a CANopen device has a `node`, and other devices are identified by their frames",
    )],
    device_keys_elsewhere,
    verify: |raw, at, _| raw.object(at),
    signal_keys: SignalKeys { keys: &["dbc", "pdo", "sdo", "frame"], owner: OWNER, help: None },
    signal_help: |device| {
        format!(
            "`{device}` is on a CAN line: remove this key, and write dbc, pdo, sdo or frame, which state \
             where the value is"
        )
    },
    check_signal: |_, at, _| {
        let help = "remove this key: a CAN device sends its count by itself";
        at.key("counter").not_applicable(&["capture"], "a Modbus device", help);
        &[]
    },
    has_place: |raw| raw.register.is_some() || raw.sdo.is_some() || is_in_frames(raw),
    comes_by_itself: is_in_frames,
    signal: |check, raw, at, _| signal::resolve(check, raw, at),
    foreign_output_keys: output::foreign_keys,
    output: output::resolve,
    heartbeat: |_, at| {
        let help = "write the name of a Modbus device; a CANopen node has a heartbeat consumer of its own, object 1016";
        let message = "the heartbeat is written to a register, and this device has no registers";
        at.key("device").reject(message, help)
    },
    complete: frame_writes::resolve,
    check: conflicts::check,
    requests,
    device_preview: |device, _, _| match device.can.as_ref().and_then(|can| can.node) {
        Some(node) => format!("CANopen node {node}"),
        None => "sends frames by itself".to_owned(),
    },
    preview: |profile, bus| vec![("can", line::preview(profile, bus))],
    can_be_identified: |device| device.can.as_ref().is_some_and(|can| can.node.is_some()),
    written: |unit, address, _| match address {
        Address::Object(object) => vec![format!("node {unit} object {}", object.entry)],
        // The gateway sends a whole frame, with all its values.
        Address::Frame(field) => vec![format!("frame {}", field.frames.id)],
        _ => Vec::new(),
    },
    ..BusKind::POLLED
};

/// Resolves the parts of a device that depend on CAN: its node number and its other settings. Also reads its DBC file.
fn device(check: &Check<'_>, raw: &RawDevice, at: &KeyContext<'_>, _: Option<&Bus>) -> DeviceParts {
    let can = settings(raw, at);
    node::heartbeat_produced(at, &can);
    if let Some(file) = &raw.dbc {
        dbc::read(check, &at.key("dbc"), file);
    }
    DeviceParts { unit: Some(raw.node.unwrap_or(0)), can: Some(can), ..DeviceParts::default() }
}

fn device_keys_elsewhere(raw: &RawDevice, at: &KeyContext<'_>) {
    let keys = ["dbc", "source_address", "node", "start", "heartbeat", "setup", "emergency"];
    at.not_applicable(&keys, OWNER, "remove this key, or put the device on a bus of type \"can\"");
    if raw.verify.iter().flatten().any(|verify| verify.sdo.is_some()) {
        let help = "write `register`, as \"coil:268\" or \"holding:256\"";
        at.key("verify").wrong_key("a Modbus device has no CANopen objects", help);
    }
}

fn is_in_frames(raw: &RawSignal) -> bool {
    raw.dbc.is_some() || raw.pdo.is_some() || raw.frame.is_some()
}

/// Plans one request for each CANopen object. Values in CAN frames arrive without a request.
fn requests(_: &Device, signals: &SignalsOf<'_>) -> Vec<ReadRequest> {
    let request = |(id, signal): &(SignalId, &Signal)| {
        let Address::Object(object) = &signal.address else { return None };
        let field = Field::value(*id, signal.encoding.data_type.registers());
        Some(ReadRequest { asks: ReadTarget::Object(*object), fields: vec![field] })
    };
    signals.iter().filter_map(request).collect()
}

/// Returns the network interface of a CAN line, for example "can0". Reports an error and returns `None` if the name is
/// missing or invalid.
fn interface(raw: &RawBus, at: &KeyContext<'_>) -> Option<String> {
    let at = at.key("interface");
    let help = "write the network interface, as \"can0\"; `ip link` lists the interfaces of this computer";
    at.missing("`interface` is missing: which network interface is the CAN line?", help);
    let name = raw.interface.as_ref()?;
    let is_plain = |c: char| c != '/' && !c.is_whitespace();
    if name.is_empty() || name.len() > LONGEST_NAME || !name.chars().all(is_plain) {
        let help = "write the name of the interface, as \"can0\": up to 15 characters; `ip link` lists the \
                    interfaces of this computer";
        return at.reject(format!("`{name}` cannot be the name of a network interface"), help);
    }
    Some(name.clone())
}

/// Resolves the settings of a device on a CAN line: its node number, heartbeat, `setup` and emergency codes. Reports
/// keys that need a node number or a DBC file if that is missing.
fn settings(raw: &RawDevice, at: &KeyContext<'_>) -> CanDevice {
    if at.key("node").is_left_out() {
        let of_node = ["start", "heartbeat", "setup", "emergency", "verify"];
        for key in of_node.into_iter().filter(|key| at.has(key)) {
            let help = "write node = 5, the node number set at the device, 1 to 127";
            at.key(key).invalid(format!("`{key}` needs a CANopen node"), help);
        }
    }
    if raw.source_address.is_some() && raw.dbc.is_none() {
        let help = "write dbc = \"…\" as well: a DBC file describes the parameter groups";
        at.key("source_address").wrong_key("`source_address` needs a DBC file", help);
    }
    let setup = at.key("setup");
    let setup =
        raw.setup.iter().flatten().enumerate().filter_map(|(place, raw)| raw.resolve(&setup.item(place)));
    let emergencies = raw.emergency.iter().flatten().filter_map(|raw| {
        let mask = raw.mask.unwrap_or(u16::MAX);
        Some(Emergency { code: raw.code?, mask, meaning: raw.means.clone()? })
    });
    CanDevice {
        node: raw.node,
        start: raw.start.unwrap_or(true),
        heartbeat: at.key("heartbeat").duration(raw.heartbeat),
        setup: setup.collect(),
        emergencies: emergencies.collect(),
        written: Vec::new(),
    }
}
