//! Lines of text: their ports, requests and patterns, and keys that belong to another kind of line.

use super::*;
use isotherm_core::codec::Address;
use isotherm_profile::plan::ReadTarget;
use isotherm_profile::{DeviceId, Parity, Serial, Transport};

const TEXT: &str = r##"[machine]
name = "text"

[bus.gauges]
type = "serial-ascii"
port = "/dev/serial/by-id/usb-gauges"
baud = 9600
data_bits = 7
parity = "even"
stop_bits = 2

[device.readout]
bus = "gauges"
every = "500ms"

[device.module]
bus = "gauges"
unit = 0x1a

[signal.x]
device = "readout"
text = "X{number.4} mm"
unit = "mm"

[signal.y]
device = "readout"
text = "Y{number.4} mm"
scale = -1.0
unit = "mm"

[signal.bed]
device = "module"
text = ">{number}{any}{sum}"
request = "#{unit}{sum}\r"
unit = "degC"
bad = [{ raw = 9999, means = "above range" }]
"##;

/// Checks the only error of the profile after a replacement in its text.
#[track_caller]
fn no_text(from: &str, to: &str, key: &str, at: &str, words: &[&str]) {
    assert!(TEXT.contains(from), "{from}");
    let error = only_error(&TEXT.replacen(from, to, 1), key, at);
    for word in words {
        assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
    }
}

#[test]
fn values_with_one_request_are_one_read() {
    let loaded = parse(TEXT).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(loaded.warnings, []);
    let profile = &loaded.profile;
    let serial = Serial { baud: 9600, parity: Parity::Even, stop_bits: 2 };
    let bus = &profile.buses[0];
    assert_eq!(bus.transport, Transport::Ascii { serial, data_bits: 7 });
    assert_eq!((bus.address.as_str(), bus.timeout.as_secs()), ("/dev/serial/by-id/usb-gauges", 1));
    let device = |name: &str| profile.devices.iter().position(|device| device.name == name).unwrap();
    let readout = profile.requests(DeviceId(device("readout")));
    let ReadTarget::Texts(texts) = &readout[0].asks else { panic!("{readout:?}") };
    assert_eq!((readout.len(), texts.len(), readout[0].fields[1].at), (1, 2, 1));
    let module = profile.requests(DeviceId(device("module")));
    assert_eq!(module[0].to_string(), "send \"#1A95\\r\", receive 1 text", "0x23 + 0x31 + 0x41");
    let bed = profile.signals.iter().find(|signal| signal.name == "bed").unwrap();
    assert!(matches!(bed.address, Address::Text(_)), "{:?}", bed.address);
}

#[test]
fn check_says_what_is_sent_and_which_text_is_read() {
    let profile = parse(TEXT).unwrap().profile;
    let text = isotherm_profile::preview::Preview::of(&profile).to_string();
    for said in [
        "bus gauges: lines of text at /dev/serial/by-id/usb-gauges, timeout 1s",
        "only read; a line of text that differs from its pattern is rejected",
        "9600 baud 7E2",
        "readout: every 500ms: 1 request touching 2 texts for 2 signals",
        "receive 2 texts: x, y",
        "x: text \"X{number.4} mm\" of readout; rejected with any other text, older than",
        "y: text \"Y{number.4} mm\" of readout, times -1; rejected",
        "module: unit 26 (1A), every 1s",
    ] {
        assert!(text.contains(said), "`{said}` is not in:\n{text}");
    }
    for said in ["register", "may still arrive", "load"] {
        assert!(!text.contains(said), "`{said}` is in:\n{text}");
    }
}

#[test]
fn a_line_is_a_port_or_a_serial_server() {
    let port = "port = \"/dev/serial/by-id/usb-gauges\"\nbaud = 9600\ndata_bits = 7\nparity = \"even\"\nstop_bits = 2\n";
    let over_tcp = TEXT.replacen(port, "address = \"server:4001\"\n", 1);
    assert_eq!(parse(&over_tcp).unwrap().profile.buses[0].transport, Transport::AsciiOverTcp);
    no_text(port, "address = \"server\"\n", "bus.gauges.address", "\"server\"", &["server:4001"]);
    no_text(port, "address = \"server:0\"\n", "bus.gauges.address", "\"server:0\"", &["server:4001"]);
    let both = "address = \"server:4001\"\nbaud = 9600\n";
    no_text(port, both, "bus.gauges.baud", "baud", &["at the serial server"]);
    no_text(
        "port = \"/dev/serial/by-id/usb-gauges\"\n",
        "",
        "bus.gauges.port",
        "gauges]",
        &["or, for a serial server"],
    );
    no_text("baud = 9600\n", "", "bus.gauges.baud", "gauges]", &["what is the baud rate"]);
    no_text("data_bits = 7", "data_bits = 6", "bus.gauges.data_bits", "6", &["7", "8"]);
    no_text("data_bits = 7", "late = \"5s\"", "bus.gauges.late", "late", &["with writes"]);
    let error = only_error(&with_data_bits(), "bus.cell.data_bits", "data_bits");
    assert!(error.to_string().contains("only for a serial-ascii or modbus-ascii line"), "{error}");
}

/// The grinder with data bits on a line over TCP.
fn with_data_bits() -> String {
    GRINDER.replacen("type = \"modbus-tcp\"", "type = \"modbus-tcp\"\ndata_bits = 7", 1)
}

#[test]
fn a_wrong_text_is_reported_at_its_key() {
    let (x, at) = ("text = \"X{number.4} mm\"", "signal.x.text");
    no_text(x, "text = \"X mm\"", at, "\"X mm\"", &["has no {number}"]);
    no_text(x, "text = \"{nummer}\"", at, "\"{nummer}\"", &["`{nummer}` is unknown", "{skip 2}"]);
    no_text(x, "", at, "x]", &["which text with the value does the device send"]);
    let with_end = "text = \"X{number} mm\\r\"";
    no_text(x, with_end, at, "\"X{number} mm\\r\"", &["contains a line end", "leave out \\r and \\n"]);
    no_text(x, "register = \"input:0\"", "signal.x.register", "register", &["a Modbus device"]);
    no_text(x, &format!("{x}\ntype = \"f64\""), "signal.x.type", "type", &["a decimal number"]);
    no_text(x, &format!("{x}\nrequest = \"\""), "signal.x.request", "\"\"", &["1 to 64 characters"]);
    no_text(x, &format!("{x}\nrequest = \"°\""), "signal.x.request", "\"°\"", &["is not an ASCII character"]);
    let unknown = format!("{x}\nrequest = \"{{n}}\"");
    no_text(x, &unknown, "signal.x.request", "\"{n}\"", &["unknown word in braces", "{sum}"]);
    no_text(
        "unit = 0x1a\n",
        "",
        "signal.bed.request",
        "\"#{unit}",
        &["the address of `module`, but the profile states no `unit` for it"],
    );
    no_text("unit = 0x1a", "unit = 1\nquirks = {}", "device.module.quirks", "quirks", &["sends text"]);
}

#[test]
fn a_text_that_hides_a_switch_to_inch_is_warned_of() {
    for (text, is_hidden) in [
        ("X{number}", true),
        ("X{number 8}{any}", true),
        ("X{number.4}{any}", false),
        ("X{number} mm", false),
    ] {
        let loaded = parse(&TEXT.replacen("X{number.4} mm", text, 1)).unwrap();
        let warned: Vec<String> = loaded.warnings.iter().map(ToString::to_string).collect();
        assert_eq!(warned.len(), usize::from(is_hidden), "{text}: {warned:?}");
        assert!(warned.iter().all(|warning| warning.contains("neither decimals nor a unit")), "{warned:?}");
    }
}

#[test]
fn nothing_is_written_to_a_line_of_text() {
    let output = "\n[axis.z]\nlimit = 10.0\n[output.z]\naxis = \"z\"\ndevice = \"readout\"\n";
    let refused = parse(&format!("{TEXT}{output}")).err().unwrap().to_string();
    assert!(refused.contains("nothing is written to a serial-ascii line"), "{refused}");
}
