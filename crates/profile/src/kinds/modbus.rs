//! Modbus: registers, coils and discrete inputs of devices (units), over TCP or a serial line.

use crate::document::Section;
use crate::tables::bus::Bus;
use crate::tables::bus::transport::Transport;
use crate::tables::bus_kind::{BusKind, SignalKeys};
use crate::tables::device::{DeviceParts, RawDevice};
use crate::tables::heartbeat::RawHeartbeat;
use crate::tables::register;
use crate::tables::{Check, KeyContext};
use crate::{BusId, Profile};
use isotherm_core::codec::{Address, Register};

pub(crate) mod channel;
pub(crate) mod frames;
pub(crate) mod functions;
mod gateway;
mod line;
mod line_time;
mod output;
pub(crate) mod quirks;
pub(crate) mod requests;
mod scale_from;
pub(crate) mod serial;
mod signal;

/// Kind of bus for Modbus: Modbus TCP, and RTU or ASCII frames on a serial port or over TCP.
pub(super) static KIND: BusKind = BusKind {
    types: &line::TYPES,
    line: line::resolve,
    line_without_type: |raw, at, is_known| {
        if raw.address.is_some() && !is_known {
            line::address(raw, at);
        }
    },
    settings: line::settings,
    device,
    verify: |raw, at, functions| raw.register(at, functions),
    signal_keys: SignalKeys {
        keys: &["register", "word_order", "byte_swap", "merge", "scale_from", "decimals_from"],
        owner: "a Modbus device",
        help: None,
    },
    signal_help: |device| format!("`{device}` is on a Modbus line: write register = \"input:0\""),
    check_signal: |raw, at, _| {
        let help = "use \"u16\" or \"i16\", or one bit, as \"input:50.3\"";
        register::not_smaller_than_a_register(&at.key("type"), raw.kind, help);
        &[]
    },
    has_place: |raw| raw.register.is_some(),
    signal: |_, raw, at, device| signal::resolve(raw, at, device),
    has_registers: true,
    foreign_output_keys: output::foreign_keys,
    output: |check, raw, at, _, device| {
        output::resolve(raw, at, device.and_then(|device| check.devices.get(device)))
    },
    heartbeat,
    check: |check| {
        line_time::check(check);
        scale_from::check(check);
    },
    requests: requests::of,
    device_preview: |device, every, summary| format!("unit {}, every {every}: {summary}", device.unit),
    preview,
    written,
    ..BusKind::POLLED
};

/// Returns the Modbus unit identifier of a device. Reports an error if the line does not allow this identifier, or does
/// not allow the quirk `gateway`.
fn device(_: &Check<'_>, raw: &RawDevice, at: &KeyContext<'_>, line: Option<&Bus>) -> DeviceParts {
    // Lines with RTU or ASCII frames.
    let over_rtu = line.is_some_and(|line| line.transport != Transport::Tcp);
    if over_rtu {
        at.key("quirks").not_applicable(&["gateway"], quirks::OF_TCP, quirks::WAITS);
    }
    let at = at.key("unit");
    let help = "write the unit identifier of the device, 0 to 255; the only device at an IP \
                address often has 1 or 255";
    at.missing("`unit` is missing", help);
    if let Some(unit) = raw.unit.filter(|unit| over_rtu && !(1..=247).contains(unit)) {
        let message = if unit == 0 {
            "unit 0 addresses all devices of a serial line at once, and none of them answers".to_owned()
        } else {
            format!("unit {unit} is not possible on a serial line: 248 to 255 are reserved")
        };
        at.invalid(message, "write the address set at the device, 1 to 247");
    }
    DeviceParts { unit: raw.unit, ..DeviceParts::default() }
}

fn heartbeat(raw: &RawHeartbeat, at: &KeyContext<'_>) -> Option<Address> {
    let help = "remove this key, and write register = \"holding:100\"";
    at.not_applicable(&["node", "type"], "an OPC UA server", help);
    let place = at.key("register");
    let help = "write a holding register, as \"holding:100\"";
    place.missing("`register` is missing: in which register does the heartbeat count?", help);
    register::holding(&place, raw.register.as_ref()).map(Address::from)
}

fn preview(profile: &Profile, bus: BusId) -> Vec<(&'static str, Section)> {
    let serial = profile.bus(bus).transport.serial();
    let serial = serial.map(|serial| ("serial", line_time::preview(profile, bus, serial)));
    serial.into_iter().chain(gateway::preview(profile, bus).map(|gateway| ("gateway", gateway))).collect()
}

fn written(unit: u8, address: &Address, count: u16) -> Vec<String> {
    let Some(Register { table, offset }) = address.register() else { return Vec::new() };
    let offsets = (0..count).map(|place| offset.saturating_add(place));
    offsets.map(|offset| format!("unit {unit} {}:{offset}", table.name())).collect()
}
