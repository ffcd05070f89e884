//! A control that was switched off and on: its boot counter has changed, or the machine's `on` signal has risen.

use std::time::Duration;

use crate::faults::law;
use crate::faults::rig::{BENCH, Trace, World, block_on, run};

const MINUTE: Duration = Duration::from_secs(60);

fn counted() -> String {
    let refresh = "refresh = \"10s\"";
    BENCH.replace(refresh, &format!("{refresh}\nrestart = {{ boot_counter = \"holding:98\" }}"))
}

fn cnc(keys: &str) -> String {
    format!("[[fault]]\ndevice = \"cnc\"\n{keys}\n")
}

fn writes_after(trace: &Trace, seconds: f64) -> Vec<f64> {
    let after = trace.writes("cnc_z").into_iter();
    let running = after.filter(|(at, _)| trace.seconds(*at) >= seconds && *at <= trace.stopped.0);
    running.map(|(_, value)| value).collect()
}

/// Checks that the axis is never switched off, and resumes in steps from `from` µm.
fn walks_in_from(trace: &Trace, seconds: f64, from: f64) {
    law::holds(trace);
    assert_eq!(trace.reported("foreign-change") + trace.reported("disarmed"), 0, "{}", trace.lines());
    assert_eq!(trace.states_between(10, 59), ["active"], "{}", trace.lines());
    assert_eq!(trace.states_between(90, 180), ["active"], "{}", trace.lines());
    let after = writes_after(trace, seconds);
    assert!((after[0] - from).abs() <= 1.0 + 1e-6, "{after:?}");
    assert!(after.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 1.0 + 1e-6), "{after:?}");
    assert!(after.last().unwrap() > &5.0, "{after:?}");
}

#[test]
fn a_boot_counter_that_changes_tells_of_a_restart_and_the_axis_walks_in_from_zero() {
    let trace = run(&counted(), &cnc("kind = \"restart\"\nat = \"60500ms\""), 3 * MINUTE);
    walks_in_from(&trace, 60.5, 0.0);
    let reported: Vec<_> = trace.events.iter().filter(|event| event.kind == "cnc-booted").collect();
    assert_eq!(reported.len(), 1, "{}", trace.lines());
    assert!(reported[0].text.contains("the boot counter went from 1 to 2"), "{}", reported[0].text);
}

#[test]
fn a_restarted_cnc_that_kept_another_value_is_gone_on_from_and_not_called_foreign() {
    let faults = cnc("kind = \"restart\"\nat = \"60500ms\"")
        + &cnc("kind = \"register\"\nregister = \"holding:104\"\nwords = [0, 30]\nat = \"60500ms\"");
    let trace = run(&counted(), &faults, 3 * MINUTE);
    walks_in_from(&trace, 60.5, 3.0);
    assert_eq!((trace.reported("cnc-booted"), trace.reported("cnc-restarted")), (1, 0), "{}", trace.lines());
    let foreign = run(BENCH, &faults, 3 * MINUTE);
    assert_eq!(
        foreign.reported("foreign-change"),
        1,
        "without the counter it is somebody else's\n{}",
        foreign.lines()
    );
}

#[test]
fn a_restarted_cnc_that_holds_more_than_the_limit_is_left_alone() {
    let faults = cnc("kind = \"restart\"\nat = \"60500ms\"")
        + &cnc("kind = \"register\"\nregister = \"holding:104\"\nwords = [0, 900]\nat = \"60500ms\"");
    let trace = run(&counted(), &faults, 2 * MINUTE);
    law::holds(&trace);
    assert_eq!((trace.reported("cnc-booted"), trace.reported("disarmed")), (1, 1), "{}", trace.lines());
    assert_eq!(writes_after(&trace, 61.0).len(), 0);
}

#[test]
fn a_boot_counter_that_cannot_be_read_is_no_restart() {
    let trace =
        run(&counted(), &cnc("kind = \"exception\"\ncode = 4\nat = \"60s\"\nfor_time = \"20s\""), 3 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.reported("cnc-booted") + trace.reported("cnc-restarted"), 0, "{}", trace.lines());
    let refused = "kind = \"refuse\"\nat = \"60s\"\nfor_time = \"20s\"";
    let trace = run(&counted(), &cnc(refused), 3 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.reported("cnc-booted") + trace.reported("cnc-restarted"), 0, "{}", trace.lines());
}

#[test]
fn a_cnc_that_comes_back_with_another_count_after_a_power_cut_was_restarted() {
    let faults =
        cnc("kind = \"refuse\"\nat = \"60s\"\nfor_time = \"20s\"") + &cnc("kind = \"restart\"\nat = \"70s\"");
    let trace = run(&counted(), &faults, 3 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.reported("cnc-booted"), 1, "{}", trace.lines());
    assert!(writes_after(&trace, 80.0)[0] <= 1.0, "{:?}", writes_after(&trace, 80.0));
    assert_eq!(trace.states_between(150, 180), ["active"], "{}", trace.lines());
}

fn switched() -> String {
    BENCH.replace("arm  = \"auto\"", "arm  = \"auto\"\non   = \"cnc_on\"")
}

fn off_and_on(register: &str) -> String {
    cnc("kind = \"value\"\nsignal = \"cnc_on\"\nvalue = 0\nat = \"60s\"\nfor_time = \"20s\"")
        + &cnc(&format!("kind = \"register\"\nregister = \"holding:104\"\nwords = {register}\nat = \"70s\""))
}

#[test]
fn a_machine_that_is_switched_on_again_is_gone_on_with_from_what_its_register_holds() {
    for (register, from) in [("[0, 0]", 0.0), ("[0, 30]", 3.0)] {
        let trace = run(&switched(), &off_and_on(register), 3 * MINUTE);
        walks_in_from(&trace, 80.0, from);
    }
    let trace = run(BENCH, &off_and_on("[0, 30]"), 3 * MINUTE);
    assert_eq!(
        trace.reported("foreign-change"),
        1,
        "without the edge it is somebody else's\n{}",
        trace.lines()
    );
}

#[test]
fn an_axis_that_a_person_armed_stays_armed_over_a_restart_of_the_machine() {
    use isotherm::observe::status::Command;
    let text = switched().replace("arm  = \"auto\"", "arm  = \"manual\"");
    let trace = block_on(async {
        let mut world = World::new(&text, &off_and_on("[0, 30]")).await;
        world.gateway().command(Duration::from_secs(5), Command::Arm).run(3 * MINUTE).await
    });
    walks_in_from(&trace, 80.0, 3.0);
    assert_eq!(trace.reported("armed"), 1, "{}", trace.lines());
}
