//! Devices that send lines of text, on a serial port or through a serial server: readouts, gauges, DCON modules.

use std::time::Duration;

use crate::document::{Section, entries};
use crate::plan::{Field, ReadRequest, ReadTarget, numbered};
use crate::tables::bus::LineType;
use crate::tables::bus::transport::BusType;
use crate::tables::bus_kind::{BusKind, SignalKeys, SignalsOf};
use crate::tables::device::{Device, DeviceParts};
use crate::tables::register::{self, plain};
use crate::tables::signal::bad::sentinels;
use crate::tables::signal::{Located, PLACES, RawSignal};
use crate::tables::{Check, KeyContext};
use crate::{BusId, Profile};
use isotherm_core::codec::{Address, DataType, Encoding, TextPattern, TextValue, with_sum, with_unit};

mod line;

/// Default timeout of a serial-ascii bus. Devices that send without a request often send twice a second.
const TIMEOUT: Duration = Duration::from_secs(1);
/// Maximum length of a request in characters. No known device needs more.
const LONGEST_REQUEST: usize = 64;
/// Placeholder in a request and in a pattern, replaced by the address of the device.
const UNIT: &str = "{unit}";

/// Kind of bus for devices that send lines of text.
pub(super) static KIND: BusKind = BusKind {
    types: &[LineType {
        word: BusType::SerialAscii,
        title: "lines of text",
        keys: &["address", "port", "baud", "parity", "stop_bits", "data_bits"],
        exclusive: Some("port"),
        answer: LineType::ANSWER,
    }],
    recognises: |raw| raw.data_bits.is_some(),
    line: |raw, at, _| line::resolve(raw, at),
    timeout: Some(TIMEOUT),
    only_read: Some(
        "readouts, gauges and DCON modules are only read: nothing is written to a serial-ascii line",
    ),
    has_load: false,
    device: |_, raw, _, _| DeviceParts { unit: Some(raw.unit.unwrap_or(0)), ..DeviceParts::default() },
    foreign_device_keys: &[(
        &["functions", "quirks", "base", "verify"],
        "a device with registers",
        "remove this key: this device sends text",
    )],
    signal_keys: SignalKeys {
        keys: &["text", "request"],
        owner: "a device that sends text",
        help: Some("remove this key, or put the device on a serial-ascii line"),
    },
    signal_help: |device| {
        format!("`{device}` sends text: write text = \"{{number}} mm\", and `request` if it needs one")
    },
    check_signal: |_, at, _| {
        let help = "remove this key: the text contains a decimal number";
        at.not_applicable(&["type", "counter"], "a value in registers", help);
        &["type", "counter"]
    },
    has_place: |raw| raw.text.is_some(),
    signal,
    requests,
    device_preview: |device, every, summary| match device.unit {
        0 => format!("every {every}: {summary}"),
        unit => format!("unit {unit} ({unit:02X}), every {every}: {summary}"),
    },
    line_preview: Some("only read; a line of text that differs from its pattern is rejected"),
    preview,
    can_be_identified: |_| false,
    ..BusKind::POLLED
};

/// Resolves the pattern and the request of a signal.
fn signal(_: &Check<'_>, raw: &RawSignal, at: &KeyContext<'_>, device: Option<&Device>) -> Option<Located> {
    let unit = device.map_or(0, |device| device.unit);
    needs_address(raw, at);
    let pattern = pattern(at, raw.text.as_ref(), unit);
    if let Some(pattern) = &pattern {
        hides_inch(raw, at, pattern);
    }
    let request = request(&at.key("request"), raw.request.as_ref(), unit);
    let scale = register::scale(&at.key("scale"), raw.scale.unwrap_or(1.0));
    let bad = sentinels(raw.bad.as_ref(), &at.key("bad"));
    let offset = raw.offset.unwrap_or(0.0);
    let encoding = Encoding { scale: scale?, offset, bad, ..plain(DataType::F64) };
    let value = TextValue { request: request?, pattern: pattern? };
    Some(Located::of(Address::Text(value), encoding, None))
}

/// Reports an error if a request or a pattern contains the address of the device, but the profile does not state this
/// address (key `unit` of the device).
fn needs_address(raw: &RawSignal, at: &KeyContext<'_>) {
    let Some(device) = &raw.device else { return };
    let keys = [("request", &raw.request), ("text", &raw.text)];
    let named = keys.into_iter().find(|(_, text)| text.as_ref().is_some_and(|text| text.contains(UNIT)));
    if let Some((key, _)) = named
        && at.top("device").key(device).key("unit").is_left_out()
    {
        let help = format!("write the address that is set at the device, as unit = 1 at device `{device}`");
        at.key(key).invalid(
            format!("`{key}` contains the address of `{device}`, but the profile states no `unit` for it"),
            help,
        );
    }
}

/// Parses the pattern of a signal, after the address of its device has been inserted.
fn pattern(signal: &KeyContext<'_>, text: Option<&String>, unit: u8) -> Option<TextPattern> {
    let at = signal.key("text");
    let help = "write the line of text that the device sends, with {number} for the value, as \"{number} mm\"; `isotherm \
                scan` shows the text of a device";
    // The key of another kind of line has been reported.
    if !PLACES.iter().any(|key| signal.has(key)) {
        at.missing("`text` is missing: which text with the value does the device send?", help);
    }
    with_unit(text?, unit).parse().map_err(|why: String| report(&at, &why)).ok()
}

/// Warns if the gateway could not detect that a readout has been switched to inch.
fn hides_inch(raw: &RawSignal, signal: &KeyContext<'_>, pattern: &TextPattern) {
    if matches!(raw.unit.as_deref(), Some("mm" | "um")) && !pattern.distinguishes_units() {
        let message = "the gateway cannot detect a switch of the device to inch: this text states neither \
                       decimals nor a unit";
        let help = "write the decimals that the device sends, as {number.3}, or the unit after the number, as \
                    {number} mm";
        signal.key("text").warn(message, help);
    }
}

/// Completes the request of a signal: inserts the address of its device and the checksum. The result is empty if the
/// signal has no request.
fn request(at: &KeyContext<'_>, text: Option<&String>, unit: u8) -> Option<String> {
    let Some(text) = text else { return Some(String::new()) };
    let request = with_sum(&with_unit(text, unit)).map_err(|why| report(at, &why)).ok()?;
    if let Some(other) = request.chars().find(|character| !character.is_ascii()) {
        let help = "write the characters of the device's manual; control characters are \\r, \\n or \\u0002";
        return at.reject(format!("`{other}` is not an ASCII character"), help);
    }
    if request.is_empty() || request.len() > LONGEST_REQUEST {
        let help = "remove this key if the device sends its text without a request";
        return at.reject(format!("a request has 1 to {LONGEST_REQUEST} characters"), help);
    }
    Some(request)
}

fn report(at: &KeyContext<'_>, why: &str) {
    let (message, help) =
        why.split_once("; ").unwrap_or((why, "write this text as in the manual of the device"));
    at.invalid(message, help);
}

/// Plans one read for each distinct request text. All values with the same request are fields of one answer.
fn requests(_: &Device, signals: &SignalsOf<'_>) -> Vec<ReadRequest> {
    let mut groups: Vec<(&str, Vec<(Field, TextValue)>)> = Vec::new();
    for (id, signal) in signals {
        let Some(text) = signal.address.text() else { continue };
        let field = Field::value(*id, signal.encoding.data_type.registers());
        let part = (field, text.clone());
        match groups.iter_mut().find(|(request, _)| *request == text.request) {
            Some((_, parts)) => parts.push(part),
            None => groups.push((text.request.as_str(), vec![part])),
        }
    }
    let read = |(_, parts): (&str, Vec<(Field, TextValue)>)| {
        let (fields, texts) = numbered(parts);
        ReadRequest { asks: ReadTarget::Texts(texts), fields }
    };
    groups.into_iter().map(read).collect()
}

/// Returns the preview of the settings of the serial port. Empty if the devices are connected through a
/// serial server.
fn preview(profile: &Profile, bus: BusId) -> Vec<(&'static str, Section)> {
    let described = |settings: String| {
        let mut section = Section::default();
        section.line(format!("  {settings}"));
        entries!(section, settings);
        ("serial", section)
    };
    profile.bus(bus).transport.port_settings().map(described).into_iter().collect()
}
