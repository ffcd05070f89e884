//! The faults on RTU and on Modbus ASCII: all devices over TCP, or the thermocouples on a serial port.

use std::time::Duration;

use isotherm_profile::{Profile, Transport};

use crate::faults::answers::{one_line_each_way, others_went_on, was_never_believed};
use crate::faults::rig::{ASCII_PORT, BENCH, PORT, Trace, World, block_on, profile};

const MINUTE: Duration = Duration::from_secs(60);

/// Bench with a timeout that a busy computer does not exceed.
fn bench() -> Profile {
    profile(&BENCH.replace("100ms", "300ms"))
}

fn through_tcp(transport: Transport) -> Profile {
    let mut profile = bench();
    profile.buses.iter_mut().for_each(|bus| bus.transport = transport);
    profile
}

fn on_a_port(port: Transport) -> Profile {
    let mut profile = bench();
    profile.buses[0].transport = port;
    profile
}

fn thermocouples(profile: Profile, keys: &str) -> Trace {
    let fault = format!("[[fault]]\ndevice = \"thermocouples\"\nat = \"60s\"\n{keys}\n");
    block_on(async { World::of(profile, &fault).await.gateway().run(5 * MINUTE).await })
}

fn minute_of(profile: Profile, kind: &str) -> Trace {
    thermocouples(profile, &format!("kind = \"{kind}\"\nfor_time = \"60s\""))
}

/// On a busy computer a port delivers an answer late.
const WRONG: [&str; 2] = ["bad-reply", "timeout"];
const NOTHING: [&str; 3] = ["bad-reply", "timeout", "link-down"];

fn is_silent(profile: Profile) {
    let trace = minute_of(profile, "silent");
    was_never_believed(&trace, &["timeout"]);
}

fn is_late_for_a_minute(profile: Profile) {
    let trace = thermocouples(profile, "kind = \"late\"\ndelay = \"450ms\"\nfor_time = \"60s\"");
    was_never_believed(&trace, &["timeout"]);
}

/// The delay is just within the four timeouts that are allowed. On a busy computer, a port may deliver further answers
/// late, and the device then counts as lost. On a port, therefore, only one of five runs must be undisturbed.
fn is_very_late_once(profile: Profile) {
    let runs = if [PORT, ASCII_PORT].contains(&profile.buses[0].transport) { 5 } else { 1 };
    let mut seen = Vec::new();
    for _ in 0..runs {
        let trace = thermocouples(profile.clone(), "kind = \"late\"\ndelay = \"1100ms\"\nfor = 1");
        others_went_on(&trace);
        let reported = trace.reported("device-lost") + trace.reported("device-back");
        if trace.qualities("bed", 5, 300) == ["good"] && reported == 0 {
            return;
        }
        seen.push(trace.lines());
    }
    panic!("{}", seen.join("\n\n"));
}

fn answers_exceptions(profile: Profile) {
    let trace = thermocouples(profile, "kind = \"exception\"\ncode = 4\nfor_time = \"60s\"");
    others_went_on(&trace);
    assert_eq!(trace.qualities("bed", 55, 300), ["good", "exception", "good"], "{}", trace.lines());
}

fn has_a_wrong_checksum(profile: Profile) {
    was_never_believed(&minute_of(profile, "wrong-checksum"), &WRONG);
}

fn is_in_another_unit_s_name(profile: Profile) {
    was_never_believed(&minute_of(profile, "wrong-unit"), &WRONG);
}

fn is_of_another_function(profile: Profile) {
    was_never_believed(&minute_of(profile, "wrong-function"), &WRONG);
}

fn is_too_short(profile: Profile) {
    was_never_believed(&minute_of(profile, "short-read"), &WRONG);
}

fn is_too_long(profile: Profile) {
    was_never_believed(&minute_of(profile, "long-read"), &WRONG);
}

fn is_garbage(profile: Profile) {
    was_never_believed(&minute_of(profile, "garbage"), &NOTHING);
}

fn is_a_closed_line(profile: Profile) {
    was_never_believed(&minute_of(profile, "close"), &NOTHING);
}

fn comes_one_byte_at_a_time(profile: Profile) {
    let trace = minute_of(profile, "one-byte-at-a-time");
    others_went_on(&trace);
    assert_eq!(trace.qualities("bed", 5, 300), ["good"], "{}", trace.lines());
}

/// The device is silent until the line is opened again, which happens after the second miss.
fn is_half_open(profile: Profile) {
    let trace = thermocouples(profile, "kind = \"half-open\"\nfor = 1");
    others_went_on(&trace);
    assert_eq!(trace.reported("link-down"), 0, "{}", trace.lines());
    let qualities = trace.qualities("bed", 5, 300);
    assert!(matches!(qualities[..], ["good"] | ["good", "timeout", "good"]), "{qualities:?}");
    let failures = &trace.samples.last().unwrap().status.devices[0].failures;
    assert!(failures["timeout"] >= 2, "{failures:?}");
}

fn is_unplugged_and_comes_back(profile: Profile) {
    let trace = thermocouples(profile, "kind = \"refuse\"\nfor_time = \"100s\"");
    others_went_on(&trace);
    one_line_each_way(&trace, "link-down", "link-up");
    assert_eq!(trace.qualities("bed", 55, 300), ["good", "link-down", "good"], "{}", trace.lines());
    let states = trace.states_between(50, 300);
    assert_eq!(states, ["active", "holding", "ramping", "zeroed", "active"], "{}", trace.lines());
}

macro_rules! each_line {
    ($($fault:ident)*) => {
        mod an_answer_through_tcp_that {
            $(#[test] fn $fault() { super::$fault(super::through_tcp(super::Transport::RtuOverTcp)); })*
        }
        mod an_answer_on_a_port_that {
            $(#[test] fn $fault() { super::$fault(super::on_a_port(super::PORT)); })*
        }
        mod an_ascii_answer_through_tcp_that {
            $(#[test] fn $fault() { super::$fault(super::through_tcp(super::Transport::ModbusAsciiOverTcp)); })*
        }
        mod an_ascii_answer_on_a_port_that {
            $(#[test] fn $fault() { super::$fault(super::on_a_port(super::ASCII_PORT)); })*
        }
    };
}

each_line! {
    is_silent is_late_for_a_minute is_very_late_once answers_exceptions has_a_wrong_checksum
    is_in_another_unit_s_name is_of_another_function is_too_short is_too_long is_garbage is_a_closed_line
    comes_one_byte_at_a_time is_half_open is_unplugged_and_comes_back
}
