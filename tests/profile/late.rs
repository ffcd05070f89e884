//! Time during which a write without an answer may still arrive on a line.

use std::time::Duration;

use super::*;
use crate::can::{LATHE, lathe};
use isotherm_profile::Transport;

const TCP: &str = "type = \"modbus-tcp\"\naddress = \"127.0.0.1:1502\"";
const PORT: &str =
    "type = \"modbus-rtu\"\nport = \"/dev/serial/by-id/usb-FTDI_FT232R-if00-port0\"\nbaud = 19200";
const TIMEOUT: &str = "timeout = \"300ms\"";

/// Returns the grinder with these lines in place of those of its first bus.
fn on(line: &str, keys: &str) -> String {
    GRINDER.replacen(TCP, line, 1).replacen(TIMEOUT, keys, 1)
}

#[test]
fn a_late_write_is_expected_for_half_a_minute_and_on_a_port_of_our_own_for_two_timeouts() {
    let through_tcp = TCP.replace("modbus-tcp", "modbus-rtu-over-tcp");
    let cases = [
        (TCP, TIMEOUT, 30_000),
        (through_tcp.as_str(), TIMEOUT, 30_000),
        (PORT, TIMEOUT, 600),
        (PORT, "timeout = \"250ms\"", 500),
        // Half of the fastest poll period, twice.
        (PORT, "", 400),
        (TCP, "late = \"45s\"", 45_000),
        (PORT, "timeout = \"300ms\"\nlate = \"2s\"", 2_000),
        (PORT, "timeout = \"300ms\"\nlate = \"300ms\"", 300),
        (TCP, "timeout = \"300ms\"\nlate = \"10min\"", 600_000),
    ];
    for (line, keys, late) in cases {
        let machine =
            parse(&on(line, keys)).unwrap_or_else(|errors| panic!("{line} {keys}: {errors}")).profile;
        assert_eq!(machine.buses[0].late.as_millis(), late, "{line} {keys}");
    }
    let machine = lathe(LATHE).unwrap().profile;
    let field = machine.buses.iter().find(|bus| bus.transport.is_can()).unwrap();
    assert_eq!(field.late.as_secs(), 30);
}

#[test]
fn a_timeout_beyond_half_a_minute_is_how_long_a_late_write_is_expected_at_least() {
    let slow = Transport::Tcp.late(Duration::from_secs(40));
    assert_eq!((slow.as_secs(), Transport::Can.late(Duration::from_secs(40)).as_secs()), (40, 40));
}

#[test]
fn what_no_late_write_can_be_is_refused_with_what_to_write() {
    let cases = [
        (
            TCP,
            "\"299ms\"",
            vec![
                "299ms is shorter than `timeout`, which is 300ms",
                "write 300ms or more",
                "remove `late` (default 30s)",
            ],
        ),
        (PORT, "\"100ms\"", vec!["shorter than `timeout`, which is 300ms", "remove `late` (default 600ms)"]),
        (TCP, "\"0s\"", vec!["a duration of zero"]),
        (
            TCP,
            "\"601s\"",
            vec!["10m 1s is longer than 10m", "write 10m or less", "remove `late` (default 30s)"],
        ),
        (TCP, "\"1day\"", vec!["1 day is longer than 10m"]),
        (TCP, "\"30\"", vec!["is not a duration"]),
        (TCP, "30", vec!["a duration in quotes"]),
        (PORT, "\"soon\"", vec!["is not a duration"]),
    ];
    for (line, late, words) in cases {
        let error = only_error(&on(line, &format!("{TIMEOUT}\nlate = {late}")), "bus.cell.late", late);
        for word in words {
            assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
        }
    }
}

#[test]
fn how_long_a_late_write_is_expected_is_explained_and_in_the_schema() {
    let machine = parse(&on(PORT, TIMEOUT)).unwrap().profile;
    let explanation = isotherm_profile::preview::Preview::of(&machine);
    let reported = explanation.to_string();
    assert!(
        reported.contains("  a write without an answer may still arrive up to 600ms later\n"),
        "{reported}"
    );
    assert_eq!(serde_json::to_value(&explanation).unwrap()["buses"][0]["late"], "600ms");
    let schema = isotherm_profile::schema();
    let described = schema["$defs"]["Bus"]["properties"]["late"]["description"].as_str().unwrap();
    assert!(described.contains("30s") && described.contains("10min"), "{described}");
}
