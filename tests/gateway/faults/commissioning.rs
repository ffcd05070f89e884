//! Devices that are not set as the profile expects. Nothing is armed, no reading is used, and the report says what to
//! do.

use std::cell::RefCell;
use std::time::Duration;

use isotherm::observe::status::Answer;

use crate::faults::law;
use crate::faults::rig::{Stage, Trace, World, block_on, profile, run, somebody, speaks_rtu};

const MINUTE: Duration = Duration::from_secs(60);

/// Module whose format, detection of broken wires and type codes are read before arming.
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
max_rate = "none"
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
fn a_module_that_is_set_as_expected_is_armed_and_its_checks_are_read_once_a_minute() {
    let trace = module(&[]);
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    let reads = |register: u16, function: u8| {
        let same = |seen: &&isotherm::virtual_machine::SeenRequest| {
            seen.function == function && seen.address.register().unwrap().offset == register
        };
        trace.wire.iter().filter(same).count()
    };
    let reads = [reads(268, 1), reads(275, 1), reads(258, 3)];
    assert!(
        reads.iter().all(|reads| (2..=3).contains(reads)),
        "format, broken wires, type of channel 2: {reads:?}"
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
    assert_eq!(trace.qualities("bed", 10, 110), ["not-as-expected"], "its values are rejected");
    let last = &trace.samples.last().unwrap().status;
    assert_eq!((last.devices[0].state, last.axes[0].arming.armed), ("not-as-expected", false));
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
    let silent = "kind = \"silent\"\nat = \"45s\"\nfor_time = \"3s\"";
    let trace = module(&[silent, &set("coil:268", 0, "46s")]);
    assert_eq!(trace.states_between(30, 44), ["active"], "{}", trace.lines());
    assert_eq!(trace.reported("not-as-expected"), 1, "{}", trace.lines());
    assert_eq!(trace.states_between(50, 118), ["holding", "ramping", "zeroed"], "{}", trace.lines());
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

/// Profile with the module, a control with a type code, and a heartbeat. A fault freezes the offset.
fn cell() -> String {
    // A busy computer must not lose more answers than the test intends.
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

/// Fault script with one fault of this device.
fn fault(device: &str, what: &str) -> String {
    format!("[[fault]]\ndevice = \"{device}\"\n{what}\n")
}

/// Start of the absence of a device. It is between two rounds of checks, and a unit on RTU is known to be prompt by
/// then.
const AWAY: Duration = Duration::from_secs(75);
/// Faults that make a device absent. The tests exchange the device 75.4 s after the start.
const WAYS: [&str; 5] = [
    "kind = \"refuse\"\nat = \"75s\"\nfor_time = \"3s\"",
    "kind = \"refuse\"\nat = \"75s\"\nfor_time = \"900ms\"",
    "kind = \"silent\"\nat = \"75s\"\nfor_time = \"3s\"",
    "kind = \"half-open\"\nat = \"75s\"\nfor_time = \"3s\"",
    "kind = \"close\"\nat = \"75500ms\"\nfor = 1",
];

fn checks(trace: &Trace, function: u8, register: u16) -> usize {
    let is_check = |seen: &&isotherm::virtual_machine::SeenRequest| {
        seen.function == function && seen.address.register().is_some_and(|at| at.offset == register)
    };
    trace.wire.iter().filter(is_check).count()
}

/// Number of writes from this second on.
fn writes_from(trace: &Trace, second: u64) -> usize {
    let from = trace.begin.after(Duration::from_secs(second));
    trace.wire.iter().filter(|seen| seen.is_write() && seen.at >= from).count()
}

#[test]
fn readings_of_a_module_that_was_exchanged_while_it_was_away_move_nothing() {
    for way in WAYS {
        let faults = [
            fault("module", way),
            fault("module", &set("coil:268", 0, "75400ms")),
            fault("module", "kind = \"value\"\nsignal = \"bed\"\nvalue = 60.0\nat = \"75400ms\""),
        ];
        let trace = run(&cell(), &faults.concat(), 2 * MINUTE);
        law::holds(&trace);
        let offsets = |from: Duration, to: Duration| {
            let within = move |at| at >= trace.begin.after(from) && at < trace.begin.after(to);
            trace.writes("cnc_z").into_iter().filter(move |(at, _)| within(*at)).map(|(_, value)| value)
        };
        let before = offsets(Duration::ZERO, AWAY).next_back().unwrap();
        let after: Vec<f64> = offsets(AWAY, 2 * MINUTE - Duration::from_secs(1)).collect();
        assert!(after.iter().all(|value| (value - before).abs() < 2.0), "{way}: {before}, then {after:?}");
        assert_eq!(trace.reported("not-as-expected"), 1, "{way}: {}", trace.lines());
        assert_eq!(trace.qualities("bed", 90, 118), ["not-as-expected"], "{way}: {}", trace.lines());
    }
}

#[test]
fn a_control_that_was_exchanged_while_it_was_away_gets_no_write() {
    for way in WAYS {
        let faults = [
            fault("cnc", way),
            fault("cnc", &set("holding:200", 8, "75400ms")),
            fault("cnc", "kind = \"register\"\nregister = \"holding:104\"\nwords = [0, 0]\nat = \"75400ms\""),
        ];
        let trace = run(&cell(), &faults.concat(), 2 * MINUTE);
        law::holds(&trace);
        assert!(writes_from(&trace, 50) > 10, "it was driven: {}", trace.lines());
        let after = trace.wire.iter().filter(|seen| seen.is_write());
        let late: Vec<f64> =
            after.map(|seen| trace.seconds(seen.at)).filter(|second| *second > 75.4).collect();
        // Until the new device is asked, the gateway takes it for the old one. Writes to a silent device have no
        // effect.
        let gone = match way {
            // The heartbeat of the next second finds the closed connection.
            way if way.contains("close") => 76.1,
            way if way.contains("refuse") => 75.4,
            _ => 78.0,
        };
        assert!(late.iter().all(|second| *second < gone), "{way}: {late:?}");
        assert_eq!(trace.reported("not-as-expected"), 1, "{way}: {}", trace.lines());
        assert_eq!(trace.states_between(90, 118), ["off"], "{way}: {}", trace.lines());
    }
}

#[test]
fn a_device_that_was_away_and_passes_its_checks_resumes_after_one_check() {
    // Three checks in two minutes: at the start, when the device is back, and a minute later.
    for way in WAYS {
        for device in ["module", "cnc"] {
            let trace = run(&cell(), &fault(device, way), 2 * MINUTE);
            law::holds(&trace);
            let read = match device {
                "module" => checks(&trace, 1, 268),
                _ => checks(&trace, 3, 200),
            };
            // On RTU the gateway may detect a silent device before it is back, and check it in vain.
            let is_silent = way.contains("silent") || way.contains("half-open");
            let in_vain = if is_silent && speaks_rtu(&trace.profile) { 2 } else { 0 };
            assert!((3..=3 + in_vain).contains(&read), "{device}, {way}: {read}: {}", trace.lines());
            assert_eq!(trace.states_between(90, 118), ["active"], "{device}, {way}: {}", trace.lines());
            assert!(writes_from(&trace, 90) > 10, "{device}, {way}");
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
        let lost = format!("kind = \"{lost}\"\nat = \"45s\"\nfor = 1");
        let span = MINUTE - Duration::from_secs(5);
        let trace = run(&cell(), &[fault("module", &lost), fault("cnc", &lost)].concat(), span);
        assert_eq!((checks(&trace, 1, 268), checks(&trace, 3, 200)), (1, 1), "{}", trace.lines());
        // The axis is frozen only for the moment in which its write has no answer.
        assert!(!trace.states_between(30, 53).contains(&"off"), "{}", trace.lines());
    }
}

#[test]
fn a_module_with_a_long_period_is_checked_after_one_lost_answer() {
    let text = cell().replace("unit = 1\ntemplate", "unit = 1\nevery = \"10s\"\ntemplate");
    let text = text.replace("max_age = \"5s\"", "max_age = \"60s\"");
    let text = text.replace("template = \"icp-das-m7019r\"\nexpect = { type_code = 15 }", OWN_CHECK);
    let text =
        text.replace("channel = 2", "register = \"input:2\"\ntype = \"i16\"\nscale = 0.1\nunit = \"degC\"");
    let faults = [
        fault("module", "kind = \"silent\"\nat = \"60s\"\nfor = 1"),
        fault("module", &set("coil:268", 0, "61s")),
    ];
    let trace = run(&text, &faults.concat(), 2 * MINUTE);
    if speaks_rtu(&trace.profile) {
        // The device is asked again at once, on the same connection.
        assert_eq!(checks(&trace, 1, 268), 1, "{}", trace.lines());
        return;
    }
    assert_eq!(trace.reported("not-as-expected"), 1, "{}", trace.lines());
    assert_eq!(trace.qualities("bed", 90, 118), ["not-as-expected"], "{}", trace.lines());
}

/// Check that is hardly ever read while the gateway runs.
const OWN_CHECK: &str = "verify = [{ register = \"coil:268\", equals = 1, every = \"1h\" }]";

/// Panel meter with a decimal point that is set by its keys. With this gain, one digit is 0.4 µm.
fn panel() -> String {
    let verify = "verify = [{ register = \"holding:90\", equals = 1, what = \"decimal point\", remedy = \"set it to 1\" }]";
    cell()
        .replace("template = \"icp-das-m7019r\"\nexpect = { type_code = 15 }", verify)
        .replace("channel = 2", "register = \"input:2\"\ntype = \"i16\"\nscale = 0.1\nunit = \"degC\"")
        .replace("rate = 1.0", "rate = 0.1")
}

#[test]
fn a_decimal_point_changed_at_the_panel_is_found_within_a_minute_and_cz_goes_back() {
    let faults = [
        fault("module", &set("holding:90", 0, "75s")),
        fault("module", "kind = \"value\"\nsignal = \"bed\"\nvalue = 2.0\nat = \"75s\"\nfor_time = \"225s\""),
        fault("module", &set("holding:90", 1, "300s")),
    ];
    let trace = run(&panel(), &faults.concat(), 6 * MINUTE);
    law::holds(&trace);
    let held = |second: u64| {
        let until = trace.begin.after(Duration::from_secs(second));
        trace
            .writes("cnc_z")
            .into_iter()
            .filter(|(at, _)| *at < until)
            .map(|(_, value)| value)
            .next_back()
            .unwrap()
    };
    let before = held(74);
    let moved = (75..300).map(|second| (held(second) - before).abs()).fold(0.0, f64::max);
    // The check comes after 47 s, at two minutes. The axis moves 0.1 µm/s.
    assert!((1.0..=6.0).contains(&moved), "{moved} um: {}", trace.lines());
    assert!((held(299) - before).abs() <= 0.5, "{before}, then {}: {}", held(299), trace.lines());
    let found = reported(&trace, "not-as-expected");
    assert_eq!(found.len(), 1, "{}", trace.lines());
    for words in [
        "the settings of the device were changed",
        "holding:90 (40091) reads 0 instead of 1",
        "decimal point",
        "set it to 1",
    ] {
        assert!(found[0].contains(words), "`{words}` is not in: {}", found[0]);
    }
    assert_eq!(trace.qualities("bed", 125, 299), ["not-as-expected"], "{}", trace.lines());
    assert_eq!(trace.states_between(125, 299), ["holding"], "{}", trace.lines());
    assert_eq!(trace.states_between(310, 355), ["active"], "set right: {}", trace.lines());
}

/// Module that nothing identifies.
fn unidentified(rate: &str) -> String {
    cell()
        .replace("template = \"icp-das-m7019r\"\nexpect = { type_code = 15 }", "")
        .replace("channel = 2", "register = \"input:2\"\ntype = \"i16\"\nscale = 0.1\nunit = \"degC\"")
        .replace("max_rate = \"none\"", rate)
}

#[test]
fn a_module_without_checks_that_comes_back_in_whole_degrees_moves_nothing() {
    let is_rtu = speaks_rtu(&profile(MODULE));
    for way in WAYS {
        // On RTU a unit that is not known to be prompt is asked once in 3.6 s. A shorter silence is one lost answer.
        let way =
            if is_rtu { way.replace("for_time = \"3s\"", "for_time = \"12s\"") } else { way.to_owned() };
        let way = way.as_str();
        let faults = [
            fault("module", way),
            fault("module", "kind = \"value\"\nsignal = \"bed\"\nvalue = 2.0\nat = \"75400ms\""),
        ];
        let trace = run(&unidentified("max_rate = 0.5"), &faults.concat(), 2 * MINUTE);
        law::holds(&trace);
        let after = trace.begin.after(AWAY);
        let (early, late): (Vec<_>, Vec<_>) =
            trace.writes("cnc_z").into_iter().partition(|(at, _)| *at < after);
        let before = early.last().unwrap().1;
        assert!(late.iter().all(|(_, value)| (value - before).abs() < 0.7), "{way}: {before}, then {late:?}");
        // Waiting does not make the value plausible, although the rate would allow 30 degrees in one minute.
        assert_eq!(trace.qualities("bed", 95, 118), ["jumped"], "{way}: {}", trace.lines());
    }
}

/// The cell with checks that are only read after breaks, or without checks.
fn checked_seldom(is_checked: bool, quirks: &str) -> String {
    let (module, cnc) = match is_checked {
        true => (
            OWN_CHECK,
            "verify = [{ register = \"holding:200\", equals = 7, what = \"type code\", every = \"1h\" }]\n",
        ),
        false => ("", ""),
    };
    cell()
        .replace("900ms", "300ms")
        .replace("verify = [{ register = \"holding:200\", equals = 7, what = \"type code\" }]\n", cnc)
        .replace("template = \"icp-das-m7019r\"\nexpect = { type_code = 15 }", &format!("{module}\n{quirks}"))
        .replace("channel = 2", "register = \"input:2\"\ntype = \"i16\"\nscale = 0.1\nunit = \"degC\"")
}

/// Faults that lose one answer in twenty of a device, sometimes two in a row.
fn one_in_twenty(device: &str) -> String {
    let mut random = 0x5eed_u64;
    let mut is_lost = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33).is_multiple_of(20)
    };
    let lost = (10..1300).filter(|_| is_lost());
    lost.map(|after| fault(device, &format!("kind = \"silent\"\nafter = {after}\nfor = 1"))).collect()
}

#[test]
fn lost_answers_and_short_connections_cost_at_most_two_exchanges_more_in_a_hundred() {
    let span = 10 * MINUTE;
    for (faults, quirks) in [
        ([one_in_twenty("module"), one_in_twenty("cnc")].concat(), ""),
        (String::new(), "quirks = { close_after_each = true }"),
    ] {
        let exchanges = |is_checked| {
            let trace = run(&checked_seldom(is_checked, quirks), &faults, span);
            law::holds(&trace);
            let states = trace.states_between(30, 590);
            assert!(states.iter().all(|state| matches!(*state, "active" | "holding")), "{}", trace.lines());
            assert!(trace.states_between(550, 590).contains(&"active"), "{}", trace.lines());
            (trace.wire.len(), speaks_rtu(&trace.profile))
        };
        let ((without, _), (with, is_rtu)) = (exchanges(false), exchanges(true));
        println!("{quirks}: {without} exchanges without checks, {with} with");
        // On RTU a unit waits after a lost answer. Two lost answers in a row are therefore silent for two poll periods
        // more often.
        let most = if is_rtu { 103 } else { 102 };
        assert!(with * 100 <= without * most, "{with} of {without}");
    }
}

#[test]
fn a_person_who_has_looked_at_a_device_confirms_it() {
    let faults = [
        fault("module", WAYS[0]),
        fault("module", "kind = \"value\"\nsignal = \"bed\"\nvalue = 2.0\nat = \"75400ms\""),
    ];
    let said = RefCell::new(Vec::new());
    let trace = block_on(async {
        let mut world = World::new(&unidentified("max_rate = 0.5"), &faults.concat()).await;
        let confirm = |stage: &Stage<'_>| {
            let devices = ["lathe", "cnc", "module"];
            said.borrow_mut().extend(devices.map(|device| stage.source.confirm(device, &somebody())));
        };
        world.gateway().at(Duration::from_secs(95), confirm).run(2 * MINUTE).await
    });
    law::holds(&trace);
    let done = |text: &str| Ok(Answer::Done(text.to_owned()));
    assert_eq!(
        *said.borrow(),
        [
            Err("there is no device lathe; there are module, cnc".to_owned()),
            done("cnc: nothing to confirm: no signal jumped while the device was silent"),
            done("module: confirmed; the next values of bed are accepted"),
        ]
    );
    assert_eq!(trace.qualities("bed", 85, 94), ["jumped"], "{}", trace.lines());
    assert_eq!(trace.qualities("bed", 98, 118), ["good"], "{}", trace.lines());
    assert_eq!(reported(&trace, "command").len(), 2, "{}", trace.lines());
    assert_eq!(reported(&trace, "command-refused").len(), 1, "{}", trace.lines());
}

/// The cell with a module that is polled so rarely that a fault after 55 s affects its check.
fn seldom_polled() -> String {
    cell()
        .replace("unit = 1\ntemplate", "unit = 1\nevery = \"50s\"\ntemplate")
        .replace("max_age = \"5s\"", "max_age = \"120s\"")
}

#[test]
fn a_check_that_is_refused_once_while_the_gateway_runs_stops_nothing() {
    for code in [2, 4, 6, 10, 11] {
        let refused = fault("module", &format!("kind = \"exception\"\ncode = {code}\nat = \"55s\"\nfor = 1"));
        let trace = run(&seldom_polled(), &refused, 3 * MINUTE);
        law::holds(&trace);
        assert_eq!(trace.reported("not-as-expected"), 0, "{code}: {}", trace.lines());
        assert_eq!(trace.states_between(30, 175), ["active"], "{code}: {}", trace.lines());
        assert!(checks(&trace, 1, 268) >= 2, "{code}: {}", trace.lines());
    }
}

#[test]
fn a_module_that_refuses_everything_for_a_while_is_not_taken_for_a_changed_one() {
    for code in [2, 4, 5, 6, 10, 11, 200] {
        let refused = fault(
            "module",
            &format!("kind = \"exception\"\ncode = {code}\nat = \"55s\"\nfor_time = \"20s\""),
        );
        let trace = run(&cell(), &refused, 2 * MINUTE);
        law::holds(&trace);
        assert_eq!(trace.reported("not-as-expected"), 0, "{code}: {}", trace.lines());
        assert_eq!(trace.states_between(62, 74), ["holding"], "{code}: {}", trace.lines());
        let at = |second| trace.begin.after(Duration::from_secs(second));
        let held: Vec<f64> = trace
            .writes("cnc_z")
            .into_iter()
            .filter(|(moment, _)| *moment >= at(62) && *moment < at(74))
            .map(|(_, value)| value)
            .collect();
        assert!(held.windows(2).all(|two| (two[0] - two[1]).abs() < 0.01), "{code}: {held:?}");
        assert!(trace.states_between(90, 118).contains(&"active"), "{code}: {}", trace.lines());
    }
}

#[test]
fn a_check_that_a_confirmed_control_refuses_again_and_again_is_reported() {
    // Nothing else is polled from it that could be refused as well.
    let refused = fault("cnc", "kind = \"exception\"\ncode = 2\nat = \"55s\"");
    let trace = run(&cell(), &refused, 3 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.reported("not-as-expected"), 1, "{}", trace.lines());
    let first = reported(&trace, "not-as-expected")[0];
    assert!(first.contains("cannot be read: exception 2"), "{first}");
}

#[test]
fn a_connection_that_is_lost_right_after_a_check_costs_no_more_than_one_beat() {
    let trace = run(&cell(), &fault("cnc", "kind = \"close\"\nat = \"61s\"\nfor = 1"), 2 * MINUTE);
    law::holds(&trace);
    let is_beat = |seen: &&isotherm::virtual_machine::SeenRequest| {
        seen.is_write() && seen.address.register().is_some_and(|at| at.offset == 120)
    };
    let beats: Vec<f64> = trace.wire.iter().filter(is_beat).map(|seen| trace.seconds(seen.at)).collect();
    let gap = beats.windows(2).map(|two| two[1] - two[0]).filter(|gap| *gap < 50.0).fold(0.0, f64::max);
    // On RTU the unit backs off for the time of a late answer.
    let most = if speaks_rtu(&trace.profile) { 6.0 } else { 2.5 };
    assert!(gap <= most, "{gap} s without a beat: {}", trace.lines());
    assert_eq!(trace.reported("disarmed"), 0, "{}", trace.lines());
}
