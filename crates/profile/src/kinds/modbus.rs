//! Modbus: registers, coils and discrete inputs of units, over TCP or a serial line.

use std::time::Duration;

use crate::document::Section;
use crate::plan::ReadRequest;
use crate::tables::bus::transport::{BusType, Transport};
use crate::tables::bus::{Bus, LineSettings, LineType, RawBus};
use crate::tables::bus_kind::{ANSWER, BusKind, SignalKeys};
use crate::tables::device::verify::{Expected, RawVerify};
use crate::tables::device::{Device, DeviceParts, RawDevice};
use crate::tables::heartbeat::RawHeartbeat;
use crate::tables::output::{RawOutput, Target};
use crate::tables::register;
use crate::tables::signal::{Located, RawSignal};
use crate::tables::{Check, KeyContext};
use crate::{BusId, Profile, Signal};
use functions::Functions;
use isotherm_core::codec::{Address, Register};
use isotherm_core::reading::SignalId;

pub(crate) mod frames;
pub(crate) mod functions;
mod gateway;
mod line;
mod line_time;
mod output;
pub(crate) mod quirks;
pub(crate) mod requests;
pub(crate) mod serial;
mod signal;

/// Assumed answer time through a plain serial server. It includes two short frames at 9600 baud, because profiles do
/// not state the baud rate.
const ANSWER_THROUGH_SERVER: Duration = Duration::from_millis(30);

/// Modbus over TCP, a serial port, or RTU frames over TCP.
pub(super) struct Modbus;

impl BusKind for Modbus {
    fn types(&self) -> &'static [LineType] {
        &line::TYPES
    }

    fn line(&self, raw: &RawBus, at: &KeyContext<'_>, of: BusType) -> Option<(Transport, Option<String>)> {
        line::resolve(raw, at, of)
    }

    fn line_without_type(&self, raw: &RawBus, at: &KeyContext<'_>, is_known: bool) {
        if raw.address.is_some() && !is_known {
            line::address(raw, at);
        }
    }

    fn settings(
        &self,
        raw: &RawBus,
        at: &KeyContext<'_>,
        own: (BusType, Option<&str>),
    ) -> Option<LineSettings> {
        line::settings(raw, at, own)
    }

    fn device(
        &self,
        _check: &Check<'_>,
        raw: &RawDevice,
        at: &KeyContext<'_>,
        line: Option<&Bus>,
    ) -> DeviceParts {
        let over_rtu =
            line.is_some_and(|line| matches!(line.transport, Transport::Serial(_) | Transport::RtuOverTcp));
        if over_rtu {
            at.key("quirks").not_applicable(&["gateway"], quirks::OF_TCP, quirks::WAITS);
        }
        let at = at.key("unit");
        let help = "write the unit identifier of the device, 0 to 255; a device that is alone at its address \
                    often has 1 or 255";
        at.missing("`unit` is missing", help);
        if let Some(unit) = raw.unit.filter(|unit| over_rtu && !(1..=247).contains(unit)) {
            let message = if unit == 0 {
                "unit 0 addresses all devices of an RTU line at once, and none of them answers".to_owned()
            } else {
                format!("an RTU line has no unit {unit}: 248 to 255 are reserved")
            };
            at.invalid(message, "write the address set at the device, 1 to 247");
        }
        DeviceParts { unit: raw.unit, ..DeviceParts::default() }
    }

    fn foreign_device_keys(&self, _at: &KeyContext<'_>) {}

    fn verify(&self, raw: &RawVerify, at: &KeyContext<'_>, functions: Functions) -> Option<Expected> {
        raw.register(at, functions)
    }

    fn signal_keys(&self) -> SignalKeys {
        let keys = &["register", "word_order", "byte_swap", "merge"];
        SignalKeys { keys, owner: "a Modbus device", help: None }
    }

    fn signal_help(&self, device: &str) -> String {
        format!("`{device}` is on a Modbus line: write register = \"input:0\"")
    }

    fn check_signal(&self, raw: &RawSignal, at: &KeyContext<'_>, _device: &str) -> &'static [&'static str] {
        let help = "use \"u16\" or \"i16\", or one bit, as \"input:50.3\"";
        register::not_smaller_than_a_register(&at.key("type"), raw.kind, help);
        &[]
    }

    fn has_place(&self, raw: &RawSignal) -> bool {
        raw.register.is_some()
    }

    fn signal(
        &self,
        _check: &Check<'_>,
        raw: &RawSignal,
        at: &KeyContext<'_>,
        device: Option<&Device>,
    ) -> Option<Located> {
        signal::resolve(raw, at, device)
    }

    fn has_registers(&self) -> bool {
        true
    }

    fn foreign_output_keys(&self, raw: &RawOutput, at: &KeyContext<'_>, device: &str) {
        output::foreign_keys(raw, at, device);
    }

    fn output(
        &self,
        check: &Check<'_>,
        raw: &RawOutput,
        at: &KeyContext<'_>,
        (_, device): (&str, Option<usize>),
    ) -> Option<Target> {
        output::resolve(raw, at, device.and_then(|device| check.devices.get(device)))
    }

    fn heartbeat(&self, raw: &RawHeartbeat, at: &KeyContext<'_>) -> Option<Address> {
        let help = "remove it, and write register = \"holding:100\"";
        at.not_applicable(&["node", "type"], "an OPC UA server", help);
        let place = at.key("register");
        let help = "write a holding register, as \"holding:100\"";
        place.missing("`register` is missing: in which register does the heartbeat count?", help);
        register::holding(&place, raw.register.as_ref()).map(Address::from)
    }

    fn check(&self, check: &Check<'_>) {
        line_time::check(check);
    }

    fn requests(&self, device: &Device, signals: &[(SignalId, &Signal)]) -> Vec<ReadRequest> {
        requests::of(device, signals)
    }

    fn title(&self, bus: &Bus) -> &'static str {
        match bus.transport {
            Transport::Tcp if bus.tls.is_some() => "Modbus TCP inside TLS (Modbus/TCP Security)",
            Transport::RtuOverTcp => "RTU over TCP",
            Transport::Serial(_) => "Modbus RTU",
            _ => "Modbus TCP",
        }
    }

    fn device_preview(&self, device: &Device, every: &str, summary: &str) -> String {
        format!("unit {}, every {every}: {summary}", device.unit)
    }

    fn preview(&self, profile: &Profile, bus: BusId) -> Vec<(&'static str, Section)> {
        let serial = profile.bus(bus).transport.serial();
        let serial = serial.map(|serial| ("serial", line_time::preview(profile, bus, serial)));
        serial.into_iter().chain(gateway::preview(profile, bus).map(|gateway| ("gateway", gateway))).collect()
    }

    fn answer_time(&self, transport: Transport) -> Duration {
        if transport == Transport::RtuOverTcp { ANSWER_THROUGH_SERVER } else { ANSWER }
    }

    fn written(&self, unit: u8, address: &Address, count: u16) -> Vec<String> {
        let Some(Register { table, offset }) = address.register() else { return Vec::new() };
        let offsets = (0..count).map(|place| offset.saturating_add(place));
        offsets.map(|offset| format!("unit {unit} {}:{offset}", table.name())).collect()
    }
}
