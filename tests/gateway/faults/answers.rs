//! Devices that answer wrongly, late, or not at all.

use std::time::Duration;

use crate::faults::law;
use crate::faults::rig::{BENCH, Trace, World, bench, block_on};

const MINUTE: Duration = Duration::from_secs(60);

/// Checks everything that a fault of the thermocouples must not affect.
pub(crate) fn others_went_on(trace: &Trace) {
    law::holds(trace);
    for signal in ["scale_z", "cnc_on"] {
        assert_eq!(trace.qualities(signal, 5, 300), ["good"], "{signal}\n{}", trace.lines());
    }
    assert_eq!(trace.states_between(285, 300), ["active"], "{}", trace.lines());
    let shown = trace.writes("readout_z");
    assert!(shown.len() > 270, "the readout was written {} times in five minutes", shown.len());
    assert_eq!(trace.reported("task-failed") + trace.reported("disarmed") + trace.reported("interlocked"), 0);
}

pub(crate) fn one_line_each_way(trace: &Trace, dies: &str, returns: &str) {
    assert_eq!((trace.reported(dies), trace.reported(returns)), (1, 1), "{}", trace.lines());
    let silent = ["link-down", "link-up", "device-lost", "device-back", "signal-bad", "signal-good"];
    for kind in silent.into_iter().filter(|kind| *kind != dies && *kind != returns) {
        assert_eq!(trace.reported(kind), 0, "{kind}\n{}", trace.lines());
    }
}

fn thermocouples(keys: &str) -> Trace {
    bench(&format!("[[fault]]\ndevice = \"thermocouples\"\nat = \"60s\"\n{keys}\n"), 5 * MINUTE)
}

#[test]
fn without_faults_the_axis_arms_steps_up_to_its_model_and_follows_it() {
    let trace = bench("", 3 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    assert!(trace.writes("cnc_z").iter().any(|(_, value)| *value > 5.0), "{:?}", trace.writes("cnc_z"));
    assert!(trace.outcome.rested && !trace.outcome.failed, "{:?}", trace.outcome);
}

#[test]
fn a_silent_device_makes_its_axis_hold_then_ramp_to_zero_and_return() {
    let trace = thermocouples("kind = \"silent\"\nfor_time = \"100s\"");
    others_went_on(&trace);
    one_line_each_way(&trace, "device-lost", "device-back");
    assert_eq!(trace.qualities("bed", 55, 300), ["good", "timeout", "good"], "{}", trace.lines());
    let states = trace.states_between(50, 300);
    assert_eq!(states, ["active", "holding", "ramping", "zeroed", "active"], "{}", trace.lines());
}

#[test]
fn a_server_that_is_killed_and_comes_back_is_reported_once_each_way_and_nothing_jumps() {
    let trace = thermocouples("kind = \"refuse\"\nfor_time = \"100s\"");
    others_went_on(&trace);
    one_line_each_way(&trace, "link-down", "link-up");
    assert_eq!(trace.qualities("bed", 55, 300), ["good", "link-down", "good"], "{}", trace.lines());
    let states = trace.states_between(50, 300);
    assert_eq!(states, ["active", "holding", "ramping", "zeroed", "active"], "{}", trace.lines());
}

#[test]
fn a_cnc_that_is_killed_and_comes_back_is_written_again_from_what_stands_in_it() {
    let trace = bench(
        "[[fault]]\ndevice = \"cnc\"\nkind = \"refuse\"\nat = \"60s\"\nfor_time = \"100s\"",
        5 * MINUTE,
    );
    law::holds(&trace);
    one_line_each_way(&trace, "link-down", "link-up");
    assert_eq!(trace.reported("interlocked") + trace.reported("cnc-restarted"), 0, "{}", trace.lines());
    let states = trace.states_between(50, 300);
    assert_eq!(states[..3], ["active", "holding", "ramping"], "{}", trace.lines());
    assert_eq!(trace.states_between(200, 300), ["active"], "{}", trace.lines());
}

#[test]
fn a_cnc_that_loses_its_power_ramps_in_again() {
    let faults = "
        [[fault]]
        device = \"cnc\"
        kind = \"refuse\"
        at = \"60s\"
        for_time = \"100s\"
        [[fault]]
        device = \"cnc\"
        kind = \"restart\"
        at = \"100s\"";
    let trace = bench(faults, 5 * MINUTE);
    law::holds(&trace);
    assert_eq!((trace.reported("link-down"), trace.reported("link-up")), (1, 1), "{}", trace.lines());
    assert_eq!(trace.reported("cnc-restarted"), 1, "{}", trace.lines());
    let after: Vec<f64> = trace
        .writes("cnc_z")
        .into_iter()
        .filter(|(at, _)| trace.seconds(*at) > 150.0 && *at <= trace.stopped.0)
        .map(|(_, value)| value)
        .collect();
    assert!(after[0] <= 1.0 && after.last().unwrap() > &5.0, "{after:?}");
    assert_eq!(trace.states_between(250, 300), ["active"], "{}", trace.lines());
}

#[test]
fn late_replies_never_become_readings_and_those_of_before_serve_meanwhile() {
    let trace = thermocouples("kind = \"late\"\ndelay = \"170ms\"\nfor = 3");
    others_went_on(&trace);
    one_line_each_way(&trace, "device-lost", "device-back");
    let qualities = trace.qualities("bed", 55, 300);
    assert!(matches!(qualities[..], ["good"] | ["good", "timeout", "good"]), "{qualities:?}");
}

#[test]
fn one_late_reply_is_counted_and_not_reported() {
    let trace = thermocouples("kind = \"late\"\ndelay = \"170ms\"\nfor = 1");
    others_went_on(&trace);
    assert_eq!(trace.reported("device-lost") + trace.reported("device-back"), 0, "{}", trace.lines());
    let failures = &trace.samples.last().unwrap().status.devices[0].failures;
    assert!(failures["timeout"] >= 1, "{failures:?}");
    assert_eq!(trace.qualities("bed", 5, 300), ["good"]);
}

#[test]
fn a_server_that_is_one_behind_with_the_old_transaction_is_dropped_at_its_first_answer() {
    let trace = thermocouples("kind = \"one-behind-stale\"\nfor_time = \"100s\"");
    others_went_on(&trace);
    one_line_each_way(&trace, "device-lost", "device-back");
    let qualities = trace.qualities("bed", 55, 300);
    let bad = |quality: &&str| matches!(*quality, "bad-reply" | "timeout");
    assert!(qualities.iter().any(bad) && qualities.last() == Some(&"good"), "{qualities:?}");
}

/// An answer with the right transaction and the right shape cannot be distinguished from the expected one. It is never
/// older than one poll, so it stays within the `max_age` of the profile. An answer of another shape is rejected. Such a
/// device is never asked in two ways, so registers cannot be exchanged.
#[test]
fn a_server_that_is_one_behind_with_the_right_transaction_is_at_most_one_poll_old() {
    let trace = thermocouples("kind = \"one-behind\"\nfor_time = \"100s\"");
    others_went_on(&trace);
    let shapes: std::collections::HashSet<_> = trace
        .wire
        .iter()
        .filter(|seen| trace.profile.device(seen.device).name == "thermocouples")
        .map(|seen| (seen.function, seen.address.clone(), seen.count))
        .collect();
    assert_eq!(shapes.len(), 1, "{shapes:?}");
}

#[test]
fn a_cnc_that_is_one_behind_never_gets_a_jump_and_is_not_believed() {
    let faults = "[[fault]]\ndevice = \"cnc\"\nkind = \"one-behind\"\nat = \"60s\"\nfor_time = \"60s\"";
    let trace = bench(faults, 5 * MINUTE);
    law::holds(&trace);
    assert_ne!(trace.states_between(55, 125), ["active"], "{}", trace.lines());
}

#[test]
fn a_device_that_answers_exceptions_makes_its_signals_bad_by_that_name() {
    let trace = thermocouples("kind = \"exception\"\ncode = 4\nfor_time = \"60s\"");
    others_went_on(&trace);
    assert_eq!(trace.qualities("bed", 55, 300), ["good", "exception", "good"], "{}", trace.lines());
    assert_eq!((trace.reported("signal-bad"), trace.reported("signal-good")), (2, 2), "{}", trace.lines());
    assert_eq!(trace.reported("device-lost") + trace.reported("link-down"), 0, "{}", trace.lines());
}

/// A Modbus gateway answers with exception 10 or 11 for a device that does not answer it.
#[test]
fn a_device_that_its_gateway_misses_is_reported_once_and_not_for_each_signal() {
    for code in [10, 11] {
        let trace = thermocouples(&format!("kind = \"exception\"\ncode = {code}\nfor_time = \"60s\""));
        others_went_on(&trace);
        one_line_each_way(&trace, "device-lost", "device-back");
        assert_eq!(trace.qualities("bed", 55, 300), ["good", "exception", "good"], "{}", trace.lines());
    }
}

fn is_never_believed(kind: &str, quality: &[&str]) {
    was_never_believed(&thermocouples(&format!("kind = \"{kind}\"\nfor_time = \"60s\"")), quality);
}

/// Checks that the answers of the thermocouples from 60 s to 120 s of the run were rejected.
pub(crate) fn was_never_believed(trace: &Trace, quality: &[&str]) {
    others_went_on(trace);
    one_line_each_way(trace, "device-lost", "device-back");
    let qualities = trace.qualities("bed", 55, 300);
    let bad = &qualities[1..qualities.len() - 1];
    assert!(!bad.is_empty() && bad.iter().all(|bad| quality.contains(bad)), "{qualities:?}");
    assert_eq!(qualities.last(), Some(&"good"));
    assert_eq!(trace.states_between(50, 300)[..2], ["active", "holding"], "{}", trace.lines());
}

#[test]
fn an_answer_in_the_name_of_another_unit_is_never_believed() {
    is_never_believed("wrong-unit", &["bad-reply"]);
}

#[test]
fn an_answer_to_another_transaction_is_never_believed() {
    is_never_believed("wrong-transaction", &["bad-reply"]);
}

#[test]
fn an_answer_of_another_function_is_never_believed() {
    is_never_believed("wrong-function", &["bad-reply"]);
}

#[test]
fn a_read_that_brings_too_few_registers_is_never_believed() {
    is_never_believed("short-read", &["bad-reply"]);
}

#[test]
fn a_read_that_brings_too_many_registers_is_never_believed() {
    is_never_believed("long-read", &["bad-reply"]);
}

#[test]
fn bytes_that_are_no_modbus_are_never_believed() {
    is_never_believed("garbage", &["bad-reply", "timeout", "link-down"]);
}

#[test]
fn a_connection_that_is_closed_instead_of_an_answer_is_no_reading() {
    is_never_believed("close", &["link-down"]);
}

#[test]
fn a_half_open_connection_is_given_up_after_two_timeouts_and_costs_no_reading() {
    let trace = thermocouples("kind = \"half-open\"\nfor = 1");
    others_went_on(&trace);
    assert_eq!(trace.qualities("bed", 5, 300), ["good"], "{}", trace.lines());
    // The line connects again at the second miss. That is one less than is reported.
    assert_eq!((trace.reported("device-lost"), trace.reported("link-down")), (0, 0), "{}", trace.lines());
}

#[test]
fn a_wrong_echo_leaves_the_axis_inactive_until_a_good_one() {
    let faults = "[[fault]]\ndevice = \"readout\"\nkind = \"wrong-echo\"\nat = \"60s\"\nfor_time = \"60s\"";
    let trace = bench(faults, 5 * MINUTE);
    law::holds(&trace);
    one_line_each_way(&trace, "device-lost", "device-back");
    assert_eq!(trace.states_between(50, 300)[..2], ["active", "holding"], "{}", trace.lines());
    assert_eq!(trace.states_between(70, 115).iter().filter(|state| **state == "active").count(), 0);
    assert_eq!(trace.states_between(200, 300), ["active"], "{}", trace.lines());
}

#[test]
fn a_nan_is_no_value_and_the_fallback_model_stands_in() {
    let trace = thermocouples("kind = \"nan\"\nsignal = \"wheelhead\"\nfor_time = \"60s\"");
    others_went_on(&trace);
    one_line_each_way(&trace, "signal-bad", "signal-good");
    assert_eq!(trace.qualities("wheelhead", 55, 300), ["good", "not-a-number", "good"]);
    assert_eq!(trace.states_between(50, 300), ["active", "degraded", "active"], "{}", trace.lines());
}

#[test]
fn a_sentinel_is_a_broken_sensor_and_no_cold_machine() {
    let trace = thermocouples("kind = \"sentinel\"\nsignal = \"bed\"\nfor_time = \"60s\"");
    others_went_on(&trace);
    one_line_each_way(&trace, "signal-bad", "signal-good");
    assert_eq!(trace.qualities("bed", 55, 300), ["good", "sentinel", "good"]);
    let states = trace.states_between(50, 300);
    assert_eq!(states, ["active", "holding", "ramping", "zeroed", "active"], "{}", trace.lines());
}

#[test]
fn a_clock_that_jumps_an_hour_causes_no_burst_and_no_step() {
    let trace = block_on(async {
        let mut world = World::new(BENCH, "").await;
        let jump = |stage: &crate::faults::rig::Stage<'_>| stage.clock.skip(Duration::from_secs(3600));
        world.gateway().at(MINUTE, jump).run(2 * MINUTE + Duration::from_secs(3600)).await
    });
    law::holds(&trace);
    assert_eq!(trace.states_between(3600 + 70, 3600 + 120), ["active"], "{}", trace.lines());
    assert!(!trace.outcome.failed, "{}", trace.lines());
    let readings = trace
        .wire
        .iter()
        .filter(|seen| !seen.is_write() && seen.address.register().unwrap().offset == 84)
        .count();
    assert!(readings < 150, "the scale was read {readings} times in two minutes of work");
}

#[test]
fn a_device_that_comes_and_goes_writes_no_line_per_poll() {
    let faults: String = (0..60)
        .map(|place| {
            let at = 30 + 10 * place;
            format!("[[fault]]\ndevice = \"thermocouples\"\nkind = \"close\"\nat = \"{at}s\"\nfor = 4\n")
        })
        .collect();
    let trace = bench(&faults, 12 * MINUTE);
    law::holds(&trace);
    assert!(trace.reported("device-lost") >= 1, "{}", trace.lines());
    let lines = trace.reported("device-lost") + trace.reported("device-back");
    assert!(lines <= 4, "{lines} lines in ten minutes\n{}", trace.lines());
}
