//! Devices that are not set as the profile expects them: nothing is armed, nothing believed, and it is said what to do.

use std::time::Duration;

use crate::faults::law;
use crate::faults::rig::{Trace, run, speaks_rtu};

const MINUTE: Duration = Duration::from_secs(60);

/// A module whose format, detection of broken wires and type codes are read before arming.
const MODULE: &str = r#"
[machine]
name = "bench"
[bus.sensors]
type = "modbus-tcp"
address = "127.0.0.1:1502"
timeout = "100ms"
[bus.control]
type = "modbus-tcp"
address = "127.0.0.1:1503"
timeout = "100ms"
[device.module]
bus = "sensors"
unit = 1
template = "icp-das-m7019r"
expect = { type_code = 15 }
[device.cnc]
bus = "control"
unit = 1
[signal.bed]
device = "module"
channel = 2
max_age = "5s"
[axis.z]
limit = 40.0
step = 1.0
rate = 1.0
every = "2s"
on_fault = { action = "ramp", after = "5s" }
[[axis.z.model]]
name = "bed"
kind = "linear"
offset = 8.0
terms = [{ signal = "bed", gain = 2.0, reference = 21.0 }]
[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
register = "holding:104"
type = "i32"
word_order = "msw-first"
scale = 0.1
"#;

fn module(faults: &[&str]) -> Trace {
    let faults: String =
        faults.iter().map(|fault| format!("[[fault]]\ndevice = \"module\"\n{fault}\n")).collect();
    let trace = run(MODULE, &faults, 2 * MINUTE);
    law::holds(&trace);
    trace
}

fn set(register: &str, word: u16, at: &str) -> String {
    format!("kind = \"register\"\nregister = \"{register}\"\nwords = [{word}]\nat = \"{at}\"")
}

fn reported<'t>(trace: &'t Trace, kind: &str) -> Vec<&'t str> {
    trace.events.iter().filter(|event| event.kind == kind).map(|event| event.text.as_str()).collect()
}

fn writes(trace: &Trace) -> usize {
    trace.wire.iter().filter(|seen| seen.is_write()).count()
}

#[test]
fn a_module_that_is_set_as_expected_is_armed_and_its_checks_are_read_once() {
    let trace = module(&[]);
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    let reads = |register: u16, function: u8| {
        let same = |seen: &&isotherm::virtual_machine::Seen| {
            seen.function == function && seen.address.register().unwrap().offset == register
        };
        trace.wire.iter().filter(same).count()
    };
    assert_eq!(
        (reads(268, 1), reads(275, 1), reads(258, 3)),
        (1, 1, 1),
        "format, broken wires, type of channel 2"
    );
    assert_eq!(trace.reported("not-as-expected") + trace.reported("as-expected"), 0);
}

#[test]
fn a_module_in_the_wrong_format_is_not_armed_and_what_to_do_is_reported_once() {
    let trace = module(&[&set("coil:268", 0, "0s")]);
    assert_eq!(trace.states(), ["waiting"], "{}", trace.lines());
    assert_eq!(writes(&trace), 0);
    for kind in ["not-as-expected", "arm-refused"] {
        let reported = reported(&trace, kind);
        assert_eq!(reported.len(), 1, "{}", trace.lines());
        for words in
            ["coil:268 (00269) reads 0 instead of 1", "engineering units", "set coil 268 (00269) to 1"]
        {
            assert!(reported[0].contains(words), "`{words}` is not in: {}", reported[0]);
        }
    }
    assert_eq!(trace.qualities("bed", 10, 110), ["not-as-expected"], "what it sends is not believed");
    let last = &trace.samples.last().unwrap().status;
    assert_eq!((last.devices[0].state, last.axes[0].armed), ("not-as-expected", false));
    assert!(last.devices[0].fault.contains("reads 0 instead of 1"), "{}", last.devices[0].fault);
    assert!(last.axes[0].why.cause.contains("reads 0 instead of 1"), "{}", last.axes[0].why);
}

#[test]
fn every_mismatch_is_reported_at_once_and_putting_them_right_arms() {
    let wrong = [set("coil:275", 0, "0s"), set("holding:258", 14, "0s")];
    let right = [set("coil:275", 1, "60s"), set("holding:258", 15, "62s")];
    let all: Vec<&str> = wrong.iter().chain(&right).map(String::as_str).collect();
    let trace = module(&all);
    let first = reported(&trace, "not-as-expected")[0];
    for words in [
        "coil:275 (00276) reads 0 instead of 1",
        "holding:258 (40259) reads 14 instead of 15 (type code of channel 2)",
    ] {
        assert!(first.contains(words), "`{words}` is not in: {first}");
    }
    assert_eq!(trace.states_between(0, 58), ["waiting"], "{}", trace.lines());
    assert_eq!(trace.reported("as-expected"), 1, "{}", trace.lines());
    assert_eq!(trace.states_between(75, 118), ["active"], "{}", trace.lines());
}

#[test]
fn a_module_that_comes_back_set_otherwise_is_not_believed_and_the_axis_takes_its_fault_action() {
    let silent = "kind = \"silent\"\nat = \"60s\"\nfor_time = \"3s\"";
    let trace = module(&[silent, &set("coil:268", 0, "61s")]);
    assert_eq!(trace.states_between(30, 59), ["active"], "{}", trace.lines());
    assert_eq!(trace.reported("not-as-expected"), 1, "{}", trace.lines());
    assert_eq!(trace.states_between(65, 118), ["holding", "ramping", "zeroed"], "{}", trace.lines());
    assert_eq!(trace.qualities("bed", 75, 118), ["not-as-expected"], "{}", trace.lines());
}

#[test]
fn a_check_that_the_device_cannot_answer_is_reported_with_its_remedy() {
    let trace = module(&["kind = \"exception\"\ncode = 2\nfor = 1"]);
    let first = reported(&trace, "not-as-expected")[0];
    for words in ["cannot be read: exception 2 (illegal data address)", "set coil 267"] {
        assert!(first.contains(words), "`{words}` is not in: {first}");
    }
    assert_eq!(trace.states(), ["waiting", "active"], "looked at again, and well: {}", trace.lines());
}

/// Profile with the module, a control with a type code, and a heartbeat; a fault holds the offset.
fn cell() -> String {
    // A busy computer must not lose an answer more than a test says.
    MODULE
        .replace("100ms", "900ms")
        .replace("action = \"ramp\", after = \"5s\"", "action = \"hold\"")
        .replace(
            "[device.cnc]\nbus = \"control\"\nunit = 1\n",
            "[device.cnc]\nbus = \"control\"\nunit = 1\n\
         verify = [{ register = \"holding:200\", equals = 7, what = \"type code\" }]\n\
         [heartbeat]\ndevice = \"cnc\"\nregister = \"holding:120\"\nevery = \"1s\"\n",
        )
}

/// A fault of this device, once.
fn fault(device: &str, what: &str) -> String {
    format!("[[fault]]\ndevice = \"{device}\"\n{what}\n")
}

/// Ways in which a device is away; the tests exchange it 60.4 s after the start.
const WAYS: [&str; 5] = [
    "kind = \"refuse\"\nat = \"60s\"\nfor_time = \"3s\"",
    "kind = \"refuse\"\nat = \"60s\"\nfor_time = \"900ms\"",
    "kind = \"silent\"\nat = \"60s\"\nfor_time = \"3s\"",
    "kind = \"half-open\"\nat = \"60s\"\nfor_time = \"3s\"",
    "kind = \"close\"\nat = \"60500ms\"\nfor = 1",
];

fn checks(trace: &Trace, function: u8, register: u16) -> usize {
    let is_check = |seen: &&isotherm::virtual_machine::Seen| {
        seen.function == function && seen.address.register().is_some_and(|at| at.offset == register)
    };
    trace.wire.iter().filter(is_check).count()
}

/// Writes after so many seconds.
fn writes_from(trace: &Trace, second: u64) -> usize {
    let from = trace.begin.after(Duration::from_secs(second));
    trace.wire.iter().filter(|seen| seen.is_write() && seen.at >= from).count()
}

#[test]
fn readings_of_a_module_that_was_exchanged_while_it_was_away_move_nothing() {
    for way in WAYS {
        let faults = [
            fault("module", way),
            fault("module", &set("coil:268", 0, "60400ms")),
            fault("module", "kind = \"value\"\nsignal = \"bed\"\nvalue = 60.0\nat = \"60400ms\""),
        ];
        let trace = run(&cell(), &faults.concat(), 2 * MINUTE);
        law::holds(&trace);
        let offsets = |from: Duration, to: Duration| {
            let within = move |at| at >= trace.begin.after(from) && at < trace.begin.after(to);
            trace.writes("cnc_z").into_iter().filter(move |(at, _)| within(*at)).map(|(_, value)| value)
        };
        let before = offsets(Duration::ZERO, MINUTE).next_back().unwrap();
        let after: Vec<f64> = offsets(MINUTE, 2 * MINUTE - Duration::from_secs(1)).collect();
        assert!(after.iter().all(|value| (value - before).abs() < 2.0), "{way}: {before}, then {after:?}");
        assert_eq!(trace.reported("not-as-expected"), 1, "{way}: {}", trace.lines());
        assert_eq!(trace.qualities("bed", 75, 118), ["not-as-expected"], "{way}: {}", trace.lines());
    }
}

#[test]
fn a_control_that_was_exchanged_while_it_was_away_gets_no_write() {
    for way in WAYS {
        let faults = [
            fault("cnc", way),
            fault("cnc", &set("holding:200", 8, "60400ms")),
            fault("cnc", "kind = \"register\"\nregister = \"holding:104\"\nwords = [0, 0]\nat = \"60400ms\""),
        ];
        let trace = run(&cell(), &faults.concat(), 2 * MINUTE);
        law::holds(&trace);
        assert!(writes_from(&trace, 40) > 10, "it was driven: {}", trace.lines());
        let after = trace.wire.iter().filter(|seen| seen.is_write());
        let late: Vec<f64> =
            after.map(|seen| trace.seconds(seen.at)).filter(|second| *second > 60.4).collect();
        // Until it is asked it is the one before, and what is sent to one that is silent goes nowhere.
        let gone = match way {
            // The beat of the next second meets the close.
            way if way.contains("close") => 61.1,
            way if way.contains("refuse") => 60.4,
            _ => 63.0,
        };
        assert!(late.iter().all(|second| *second < gone), "{way}: {late:?}");
        assert_eq!(trace.reported("not-as-expected"), 1, "{way}: {}", trace.lines());
        assert_eq!(trace.states_between(75, 118), ["off"], "{way}: {}", trace.lines());
    }
}

#[test]
fn a_device_that_was_away_and_passes_its_checks_resumes_after_one_check() {
    for way in WAYS {
        for device in ["module", "cnc"] {
            let trace = run(&cell(), &fault(device, way), 2 * MINUTE);
            law::holds(&trace);
            let read = match device {
                "module" => checks(&trace, 1, 268),
                _ => checks(&trace, 3, 200),
            };
            // On RTU a silent device is known to be away before it is back: it may be checked in vain.
            let is_silent = way.contains("silent") || way.contains("half-open");
            let in_vain = if is_silent && speaks_rtu(&trace.profile) { 2 } else { 0 };
            assert!((2..=2 + in_vain).contains(&read), "{device}, {way}: {read}: {}", trace.lines());
            assert_eq!(trace.states_between(75, 118), ["active"], "{device}, {way}: {}", trace.lines());
            assert!(writes_from(&trace, 75) > 10, "{device}, {way}");
            assert_eq!(
                trace.reported("not-as-expected") + trace.reported("disarmed"),
                0,
                "{}",
                trace.lines()
            );
        }
    }
}

#[test]
fn one_lost_and_one_wrong_answer_cost_no_check() {
    for lost in ["silent", "garbage"] {
        let lost = format!("kind = \"{lost}\"\nat = \"60s\"\nfor = 1");
        let trace = run(&cell(), &[fault("module", &lost), fault("cnc", &lost)].concat(), 2 * MINUTE);
        assert_eq!((checks(&trace, 1, 268), checks(&trace, 3, 200)), (1, 1), "{}", trace.lines());
        // Frozen for the moment in which its write has no answer.
        assert!(!trace.states_between(30, 118).contains(&"off"), "{}", trace.lines());
    }
}

#[test]
fn a_module_with_a_long_period_is_checked_after_one_lost_answer() {
    let text = cell().replace("unit = 1\ntemplate", "unit = 1\nevery = \"10s\"\ntemplate");
    let text = text.replace("max_age = \"5s\"", "max_age = \"60s\"");
    let faults = [
        fault("module", "kind = \"silent\"\nat = \"60s\"\nfor = 1"),
        fault("module", &set("coil:268", 0, "61s")),
    ];
    let trace = run(&text, &faults.concat(), 2 * MINUTE);
    if speaks_rtu(&trace.profile) {
        // It is asked again at once, on the same connection.
        assert_eq!(checks(&trace, 1, 268), 1, "{}", trace.lines());
        return;
    }
    assert_eq!(trace.reported("not-as-expected"), 1, "{}", trace.lines());
    assert_eq!(trace.qualities("bed", 90, 118), ["not-as-expected"], "{}", trace.lines());
}
