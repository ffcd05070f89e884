//! RTU lines: settings, ports, units, and whether the polls fit into the time of the line.

use super::*;
use isotherm_profile::{Parity, Serial, Transport};

const TCP: &str = "type = \"modbus-tcp\"\naddress = \"127.0.0.1:1502\"";
const PORT: &str = "port = \"/dev/serial/by-id/usb-FTDI_FT232R-if00-port0\"";

/// Returns the grinder on a serial line with these keys.
fn on(keys: &str) -> String {
    assert!(GRINDER.contains(TCP));
    GRINDER.replacen(TCP, &format!("type = \"modbus-rtu\"\n{keys}"), 1)
}

#[track_caller]
fn is_refused(keys: &str, key: &str, at: &str, words: &[&str]) {
    let error = only_error(&on(keys), key, at);
    for word in words {
        assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
    }
}

#[track_caller]
fn only_warning(text: &str) -> ProfileError {
    let loaded = parse(text).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(loaded.warnings.len(), 1, "{:?}", loaded.warnings);
    loaded.warnings[0].clone()
}

#[test]
fn a_serial_line_has_its_port_and_its_settings_eight_bits_no_parity_one_stop_bit_by_itself() {
    let serial = |keys: &str| {
        let loaded = parse(&on(keys)).unwrap_or_else(|errors| panic!("{errors}"));
        assert_eq!(loaded.warnings, []);
        let bus = loaded.profile.buses[0].clone();
        assert_eq!(bus.address, "/dev/serial/by-id/usb-FTDI_FT232R-if00-port0");
        bus.transport
    };
    let plain = Serial { baud: 19_200, parity: Parity::None, stop_bits: 1 };
    assert_eq!(serial(&format!("{PORT}\nbaud = 19200")), Transport::Serial(plain));
    let spelled_out = serial(&format!("{PORT}\nbaud = 38400\nparity = \"even\"\nstop_bits = 2"));
    assert_eq!(spelled_out, Transport::Serial(Serial { baud: 38_400, parity: Parity::Even, stop_bits: 2 }));
    let over_tcp = with("type = \"modbus-tcp\"", "type = \"modbus-rtu-over-tcp\"").unwrap().profile;
    assert_eq!(over_tcp.buses[0].transport, Transport::RtuOverTcp);
}

#[test]
fn an_ascii_line_has_the_settings_of_the_specification_and_its_times() {
    let line = |keys: &str| GRINDER.replacen(TCP, &format!("type = \"modbus-ascii\"\n{keys}"), 1);
    let profile = |keys: &str| parse(&line(keys)).unwrap_or_else(|errors| panic!("{errors}")).profile;
    let usual = profile(&format!("{PORT}\nbaud = 38400"));
    let serial = Serial { baud: 38_400, parity: Parity::Even, stop_bits: 1 };
    assert_eq!(usual.buses[0].transport, Transport::ModbusAscii { serial, data_bits: 7 });
    assert_eq!(usual.buses[0].late, 2 * usual.buses[0].timeout, "no network delays a write");
    let text = isotherm_profile::preview::Preview::of(&usual).to_string();
    for said in ["Modbus ASCII at /dev/serial", "38400 baud 7E1: 0.72 ms a byte"] {
        assert!(text.contains(said), "`{said}` is not in:\n{text}");
    }
    let other = profile(&format!("{PORT}\nbaud = 38400\nparity = \"none\"\ndata_bits = 8"));
    assert_eq!(other.buses[0].transport.port_settings().as_deref(), Some("38400 baud 8N1"));
    let over_tcp = profile("address = \"127.0.0.1:4001\"");
    assert_eq!(over_tcp.buses[0].transport, Transport::ModbusAsciiOverTcp);
    assert_eq!(over_tcp.buses[0].late.as_secs(), 30);
    let both = line("address = \"127.0.0.1:4001\"\nbaud = 9600");
    let error = only_error(&both, "bus.cell.baud", "baud");
    assert!(error.to_string().contains("at the serial server"), "{error}");
    let error =
        only_error(&on(&format!("{PORT}\nbaud = 19200\ndata_bits = 7")), "bus.cell.data_bits", "data_bits");
    assert!(error.to_string().contains("modbus-ascii"), "{error}");
}

#[test]
fn a_serial_line_without_its_port_or_its_speed_is_refused() {
    is_refused("baud = 9600", "bus.cell.port", "cell]", &["`port` is missing", "/dev/serial/by-id"]);
    is_refused(PORT, "bus.cell.baud", "cell]", &["`baud` is missing", "9600"]);
    is_refused("port = \"ttyS0\"\nbaud = 19200", "bus.cell.port", "\"ttyS0\"", &["/dev/ttyS0"]);
}

#[test]
fn settings_that_no_line_has_are_refused() {
    let line = |keys: &str| format!("{PORT}\n{keys}");
    is_refused(&line("baud = 96"), "bus.cell.baud", "96", &["300", "4000000"]);
    is_refused(&line("baud = 19200\nstop_bits = 3"), "bus.cell.stop_bits", "3", &["1", "2"]);
    is_refused(&line("baud = 19200\nparity = \"mark\""), "bus.cell.parity", "\"mark\"", &["even"]);
    let address = line("baud = 19200\naddress = \"10.0.0.1:502\"");
    is_refused(&address, "bus.cell.address", "address", &["only for a TCP line"]);
    let error =
        only_error(&GRINDER.replacen(TCP, &format!("{TCP}\nbaud = 9600"), 1), "bus.cell.baud", "baud");
    assert!(error.to_string().contains("only for a line with a serial port"), "{error}");
}

#[test]
fn a_port_that_is_numbered_in_the_order_of_plugging_is_warned_of() {
    let warning = only_warning(&on("port = \"/dev/ttyUSB0\"\nbaud = 19200"));
    assert_eq!(warning.key, "bus.cell.port");
    assert!(warning.to_string().contains("/dev/serial/by-id"), "{warning}");
}

#[test]
fn an_rtu_line_has_no_unit_for_all_and_none_that_is_reserved() {
    for (unit, words) in [("0", "addresses all devices"), ("250", "reserved")] {
        let text = on(&format!("{PORT}\nbaud = 19200")).replacen("unit = 3", &format!("unit = {unit}"), 1);
        let error = only_error(&text, "device.readout.unit", unit);
        assert!(error.to_string().contains(words), "{error}");
    }
}

#[test]
fn two_buses_on_one_serial_line_are_refused_whether_on_a_port_or_through_tcp() {
    let serial = format!("type = \"modbus-rtu\"\n{PORT}\nbaud = 19200");
    let over_tcp = "type = \"modbus-rtu-over-tcp\"\naddress = \"127.0.0.1:1502\"".to_owned();
    let ascii = format!("type = \"modbus-ascii\"\n{PORT}\nbaud = 38400");
    let ascii_over_tcp = "type = \"modbus-ascii\"\naddress = \"127.0.0.1:1502\"".to_owned();
    for (line, key) in [(serial, "port"), (over_tcp, "address"), (ascii, "port"), (ascii_over_tcp, "address")]
    {
        let second = format!("[bus.second]\n{line}\n\n[device.module]\nbus = \"second\"");
        let text = GRINDER.replacen(TCP, &line, 1).replacen("[device.module]\nbus = \"cell\"", &second, 1);
        let error = only_error(&text, &format!("bus.second.{key}"), "\"");
        assert!(error.to_string().contains(&format!("the bus `cell` already has this {key}")), "{error}");
    }
}

#[test]
fn what_is_polled_and_does_not_fit_into_the_line_s_time_is_refused_and_what_hardly_fits_is_warned_of() {
    let line = |baud: u32| on(&format!("{PORT}\nbaud = {baud}"));
    let error = only_error(&line(1200), "bus.cell.baud", "1200");
    for words in ["% of the line's time at 1200 baud 8N1", "`every`"] {
        assert!(error.to_string().contains(words), "{error}");
    }
    let warning = only_warning(&line(1800));
    assert!(warning.to_string().contains("% of the line's time at 1800 baud"), "{warning}");
    assert_eq!(parse(&line(9600)).unwrap().warnings, []);
}

#[test]
fn a_serial_line_is_explained_with_its_settings_and_the_time_that_its_polls_take() {
    let machine = parse(&on(&format!("{PORT}\nbaud = 9600"))).unwrap().profile;
    let explanation = isotherm_profile::preview::Preview::of(&machine);
    let reported = explanation.to_string();
    for words in [
        "bus cell: Modbus RTU at /dev/serial/by-id/usb-FTDI_FT232R-if00-port0, timeout 300ms",
        "9600 baud 8N1: 1.04 ms a character, 4.01 ms silence before a request",
        // Two registers, then one bit: 8 + 9 and 8 + 6 bytes of 1.0417 ms, four silences of 4.01 ms, two pauses of 5
        // ms.
        "module: 31 bytes take 58 ms of every 1000 ms",
        "% of the line's time, without writes and without the answer times of the devices",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
    let document = serde_json::to_value(&explanation).unwrap();
    let serial = &document["buses"][0]["serial"];
    assert_eq!(serial["settings"], "9600 baud 8N1");
    let share =
        |poll: &serde_json::Value| poll["takes_ms"].as_f64().unwrap() / poll["every_ms"].as_f64().unwrap();
    let sum: f64 = serial["polls"].as_array().unwrap().iter().map(share).sum();
    assert!((serial["load_percent"].as_f64().unwrap() - 100.0 * sum).abs() < 1e-9, "{serial}");
}

#[test]
fn a_gateway_is_taken_for_there_if_units_share_a_connection_unless_a_quirk_says_otherwise() {
    let behind = |text: &str| -> Vec<bool> {
        let profile = parse(text).unwrap_or_else(|errors| panic!("{errors}")).profile;
        let devices = (0..profile.devices.len()).map(isotherm_profile::DeviceId);
        devices.map(|device| profile.is_behind_gateway(device)).collect()
    };
    let (bus, device) = ("max_gap = 4 }", "quirks = { max_gap = 0 }");
    assert_eq!(behind(GRINDER), [true; 4], "four units");
    let none = GRINDER.replacen(bus, "gateway = false }", 1);
    assert_eq!(behind(&none), [false; 4]);
    assert_eq!(behind(&none.replacen(device, "quirks = { gateway = true }", 1)), [false, false, true, false]);
    let shown =
        |text: &str| isotherm_profile::preview::Preview::of(&parse(text).unwrap().profile).to_string();
    assert!(shown(GRINDER).contains("to be behind a Modbus gateway to a serial line (`quirks.gateway`): "));
    assert!(!shown(&none).contains("behind a Modbus gateway"));
}

#[test]
fn a_line_of_rtu_frames_has_no_gateway_that_stamps_transactions() {
    let with_gateway = GRINDER.replacen("max_gap = 4 }", "gateway = true }", 1);
    let line = with_gateway.replacen("type = \"modbus-tcp\"", "type = \"modbus-rtu-over-tcp\"", 1);
    let error = only_error(&line, "bus.cell.quirks.gateway", "gateway");
    assert!(error.to_string().contains("only for a modbus-tcp line"), "{error}");
    let line = GRINDER.replacen("type = \"modbus-tcp\"", "type = \"modbus-rtu-over-tcp\"", 1);
    let line = line.replacen("quirks = { max_gap = 0 }", "quirks = { gateway = false }", 1);
    let error = only_error(&line, "device.counter.quirks.gateway", "gateway");
    assert!(error.to_string().contains("always waits for late answers"), "{error}");
}
