//! Writes, omitted writes, and the reaction of an axis to an unexpected register value.

use std::time::Duration;

use isotherm::observe::status::{Answer, Command};
use isotherm::virtual_machine::SeenRequest;

use crate::faults::law;
use crate::faults::rig::{
    BENCH, LATHE, Sample, Stage, Trace, World, bench, block_on, patient, run, somebody,
};

const MINUTE: Duration = Duration::from_secs(60);
const SECOND: Duration = Duration::from_secs(1);

fn cnc(keys: &str) -> String {
    format!("[[fault]]\ndevice = \"cnc\"\n{keys}\n")
}

fn values(trace: &Trace, output: &str, from: f64, to: f64) -> Vec<f64> {
    let writes = trace.writes(output).into_iter().map(|(at, value)| (trace.seconds(at), value));
    writes.filter(|(at, _)| (from..=to).contains(at)).map(|(_, value)| value).collect()
}

#[test]
fn a_dry_run_writes_nothing_at_all_not_even_the_heartbeat() {
    let trace = block_on(async {
        let mut world = World::new(BENCH, "").await;
        world.gateway().options(|options| options.dry_run = true).run(2 * MINUTE).await
    });
    law::holds(&trace);
    assert_eq!(trace.wire.iter().filter(|seen| seen.is_write()).count(), 0);
    assert_eq!(trace.states(), ["waiting", "active"], "it shows what it would do\n{}", trace.lines());
    let axis = &trace.between(60, 115).last().unwrap().status.axes[0];
    let left = (axis.raw_um.unwrap() - axis.cz_um).abs();
    assert!(left < 1.0 && axis.cz_um.abs() > 2.0, "it follows its model: {axis:?}");
    let polls = trace.wire.len();
    assert!(polls < 1200, "{polls} requests in two minutes");
}

#[test]
fn where_a_person_arms_nothing_is_written_before() {
    let text = BENCH.replace("arm  = \"auto\"", "arm  = \"manual\"");
    let trace = block_on(async {
        let mut world = World::new(&text, "").await;
        let trial = world.gateway().command(MINUTE, Command::Arm).command(2 * MINUTE, Command::Disarm);
        trial.run(3 * MINUTE).await
    });
    law::holds(&trace);
    let writes = |from: f64, to: f64| {
        let writes = trace.wire.iter().filter(|seen| seen.is_write());
        writes.filter(|seen| (from..=to).contains(&trace.seconds(seen.at))).count()
    };
    assert_eq!(writes(0.0, 59.9), 0);
    assert!(writes(60.0, 120.0) > 60);
    assert_eq!(values(&trace, "cnc_z", 121.0, 200.0).len(), 0, "off means off");
    assert!(trace.beats().len() > 100, "once armed, the heartbeat says that the gateway lives");
    assert_eq!(trace.states(), ["off", "active", "off"], "{}", trace.lines());
    let polls = trace.wire.iter().filter(|seen| !seen.is_write()).count();
    assert!(polls < 1500, "{polls} reads in three minutes: an axis that is off keeps the bus busy");
}

#[test]
fn an_open_interlock_keeps_the_register_and_the_axis_waits_however_long_it_takes() {
    let open = cnc("kind = \"value\"\nsignal = \"cnc_on\"\nvalue = 0\nat = \"60s\"\nfor_time = \"120s\"");
    let trace = bench(&open, 5 * MINUTE);
    law::holds(&trace);
    assert_eq!(values(&trace, "cnc_z", 62.0, 179.0).len(), 0);
    assert_eq!(trace.states_between(50, 300), ["active", "holding", "active"], "{}", trace.lines());
    assert_eq!((trace.reported("interlocked"), trace.reported("released")), (1, 1), "{}", trace.lines());
    let polls = trace.wire.iter().filter(|seen| !seen.is_write()).count();
    assert!(polls < 1800, "{polls} reads in five minutes");
}

#[test]
fn an_interlock_that_closes_lets_a_steady_axis_go_on_also_without_a_refresh() {
    let text = BENCH.replace("refresh = \"10s\"\n", "").replace("deadband = 0.1", "deadband = 5.0");
    let open = cnc("kind = \"value\"\nsignal = \"cnc_on\"\nvalue = 0\nat = \"60s\"\nfor_time = \"20s\"");
    let trace = run(&text, &open, 2 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.states_between(50, 120), ["active", "holding", "active"], "{}", trace.lines());
}

/// Whatever is decided in the meantime, the control holds the verified value, or another one by now.
#[test]
fn an_axis_whose_control_does_not_answer_is_shown_as_unreachable_with_the_verified_value() {
    for action in ["{ action = \"hold\" }", "{ action = \"zero\" }"] {
        let text = BENCH.replace(
            BENCH.lines().find(|line| line.starts_with("on_fault")).unwrap(),
            &format!("on_fault = {action}"),
        );
        let trace = run(&text, &cnc("kind = \"silent\"\nat = \"120s\"\nfor_time = \"120s\""), 6 * MINUTE);
        law::holds(&trace);
        let shown = |from: u64, to: u64| {
            let mut shown: Vec<&str> =
                trace.between(from, to).map(|sample| sample.status.axes[0].shown.name()).collect();
            shown.dedup();
            shown
        };
        assert_eq!(shown(60, 119), ["active"], "{action}: {}", trace.lines());
        assert_eq!(shown(135, 235), ["unreachable"], "{action}: {}", trace.lines());
        assert_eq!(shown(330, 359), ["active"], "{action}: {}", trace.lines());
        let silent: Vec<_> = trace.between(135, 235).map(|sample| &sample.status.axes[0]).collect();
        let verified = silent[0].verified_um.unwrap();
        assert!(verified.abs() > 0.5, "{verified}");
        for axis in &silent {
            assert_eq!((axis.verified_um, axis.display()), (Some(verified), "unreachable"), "{action}");
        }
        assert!(silent.last().unwrap().verified_age_s > Some(100.0), "{:?}", silent.last());
    }
}

#[test]
fn a_register_changed_behind_an_open_interlock_is_a_foreign_change() {
    let faults = cnc("kind = \"value\"\nsignal = \"cnc_on\"\nvalue = 0\nat = \"60s\"\nfor_time = \"60s\"")
        + &cnc("kind = \"register\"\nregister = \"holding:104\"\nwords = [0, 900]\nat = \"90s\"");
    let trace = bench(&faults, 5 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.reported("foreign-change"), 1, "{}", trace.lines());
    assert_eq!(values(&trace, "cnc_z", 91.0, 300.0).len(), 0, "beyond the limit nothing is written");
}

#[test]
fn a_foreign_change_is_left_alone_and_the_axis_is_off_until_a_person_arms_it() {
    let faults = cnc("kind = \"register\"\nregister = \"holding:104\"\nwords = [0, 55]\nat = \"60s\"");
    let trace = block_on(async {
        let mut world = World::new(BENCH, &faults).await;
        world.gateway().command(2 * MINUTE, Command::Arm).run(4 * MINUTE).await
    });
    law::holds(&trace);
    assert_eq!((trace.reported("foreign-change"), trace.reported("disarmed")), (1, 1), "{}", trace.lines());
    assert_eq!(values(&trace, "cnc_z", 75.0, 119.0).len(), 0);
    assert_eq!(trace.states_between(80, 240), ["off", "active"], "{}", trace.lines());
    let after = values(&trace, "cnc_z", 120.0, 240.0);
    assert!((after[0] - 5.5).abs() <= 1.01 && after.last().unwrap() > &6.5, "{after:?}");
    // The alarm lasts until the axis is armed and the register is verified.
    let is_raised =
        |sample: &Sample| sample.status.alarms.iter().any(|alarm| alarm.id == "foreign write to cnc_z");
    assert!(trace.between(75, 119).all(is_raised), "{}", trace.lines());
    assert!(!trace.between(135, 239).any(is_raised), "{}", trace.lines());
    assert_eq!(trace.reported("verified"), 1, "{}", trace.lines());
}

#[test]
fn a_restarted_cnc_ramps_in_again_and_neither_register_nor_readout_jumps() {
    let trace = bench(&cnc("kind = \"restart\"\nat = \"60s\""), 3 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.reported("cnc-restarted"), 1, "{}", trace.lines());
    assert_eq!(trace.reported("foreign-change") + trace.reported("disarmed"), 0, "{}", trace.lines());
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    let after = values(&trace, "cnc_z", 61.0, 180.0);
    assert!(after[0] <= 1.0 && after.last().unwrap() > &5.0, "{after:?}");
}

#[test]
fn a_steady_value_is_refreshed_and_the_heartbeat_counts_until_the_gateway_ends() {
    let trace = bench("", 3 * MINUTE);
    let at: Vec<f64> = trace.writes("cnc_z").iter().map(|(at, _)| trace.seconds(*at)).collect();
    let gaps: Vec<f64> = at.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(gaps.iter().all(|gap| *gap <= 11.0), "{gaps:?}");
    let beats = trace.beats();
    assert!(beats.len() >= 180, "{}", beats.len());
    assert!(beats.iter().zip(1..).all(|(beat, count)| *beat == count), "{beats:?}");
    let last = trace.wire.iter().rfind(|seen| seen.wanted.len() == 1).unwrap();
    assert!(last.at <= trace.stopped.1);
}

#[test]
fn a_device_with_a_short_list_of_functions_never_sees_another_one() {
    let text = BENCH
        .replace("[device.cnc]\n", "[device.cnc]\nfunctions = [\"read-holding\", \"write-multiple\"]\n")
        .replace("when = \"cnc_on == 1\"\n", "")
        .replace(
            "[signal.cnc_on]\ndevice = \"cnc\"\nregister = \"discrete:1\"\ntype = \"bool\"\nunit = \"bool\"\nmax_age = \"5s\"\n",
            "",
        );
    let trace = run(&text, "", 2 * MINUTE);
    law::holds(&trace);
    let cnc = trace.profile.devices.iter().position(|device| device.name == "cnc").unwrap();
    let functions: std::collections::BTreeSet<u8> =
        trace.wire.iter().filter(|seen| seen.device.0 == cnc).map(|seen| seen.function).collect();
    assert_eq!(functions.into_iter().collect::<Vec<_>>(), [3, 16]);
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    assert!(trace.beats().len() > 100);
}

#[test]
fn a_cnc_that_ignores_writes_leaves_the_axis_inactive_until_a_good_one() {
    let trace = bench(&cnc("kind = \"ignored-write\"\nat = \"8s\"\nfor_time = \"20s\""), 2 * MINUTE);
    law::holds(&trace);
    assert_eq!((trace.reported("verify-failed"), trace.reported("verified")), (1, 1), "{}", trace.lines());
    assert_eq!(trace.states_between(6, 120), ["active", "holding", "active"], "{}", trace.lines());
    assert_eq!(trace.states_between(12, 27), ["holding"], "{}", trace.lines());
    let tries = values(&trace, "cnc_z", 10.0, 28.0).len();
    assert!(tries <= 20, "{tries} tries in eighteen seconds");
}

#[test]
fn an_axis_switched_off_after_a_failed_verify_can_be_armed_again() {
    let faults = cnc("kind = \"ignored-write\"\nat = \"8s\"\nfor_time = \"20s\"");
    let trace = block_on(async {
        let mut world = World::new(BENCH, &faults).await;
        let trial = world.gateway().command(20 * SECOND, Command::Disarm).command(MINUTE, Command::Arm);
        trial.run(2 * MINUTE).await
    });
    law::holds(&trace);
    assert_eq!(trace.states_between(90, 120), ["active"], "{}", trace.lines());
}

#[test]
fn a_cnc_that_is_busy_at_first_does_not_keep_its_axis_from_arming() {
    let trace = bench(&cnc("kind = \"exception\"\ncode = 6\nfor = 20"), 2 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.states_between(60, 120), ["active"], "{}", trace.lines());
    assert!(trace.reported("write-failed") <= 1, "{}", trace.lines());
}

#[test]
fn a_cnc_whose_writes_never_succeed_is_not_reported_for_ever() {
    let trace = bench(&cnc("kind = \"wrong-echo\"\nat = \"60s\""), 15 * MINUTE);
    law::holds(&trace);
    assert!(
        trace.events.len() <= 25,
        "{} lines in a quarter of an hour\n{}",
        trace.events.len(),
        trace.lines()
    );
}

#[test]
fn a_register_beyond_the_limit_refuses_to_arm_with_a_sentence() {
    let faults = cnc("kind = \"register\"\nregister = \"holding:104\"\nwords = [0, 900]");
    let trace = bench(&faults, 2 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.reported("arm-refused"), 1, "{}", trace.lines());
    assert!(trace.lines().contains("holds 90.0 µm, beyond the limit"), "{}", trace.lines());
    assert_eq!(trace.writes("cnc_z").len() + trace.writes("readout_z").len(), 0);
    assert_eq!(trace.states(), ["waiting"]);
}

/// 40.2 µm in 32 bits is read as 40.200001. 17 counts of 0.001 µm/mm at 310 mm are 5.270000000000001 µm.
#[test]
fn a_register_exactly_at_the_limit_is_armed_from_whatever_rounding_makes_of_it() {
    let float = BENCH
        .replace(
            "type = \"i32\"\nword_order = \"msw-first\"\nscale = 0.1",
            "type = \"f32\"\nword_order = \"msw-first\"",
        )
        .replace("limit = 40.0", "limit = 40.2");
    let bits = 40.2f32.to_bits();
    let words = format!("words = [{}, {}]", bits >> 16, bits & 0xffff);
    let trace =
        run(&float, &cnc(&format!("kind = \"register\"\nregister = \"holding:104\"\n{words}")), MINUTE);
    law::holds(&trace);
    assert_eq!(
        (trace.reported("arm-refused"), trace.states()),
        (0, vec!["waiting", "active"]),
        "{}",
        trace.lines()
    );
    let line = include_str!("line.toml")
        .replace("limit = 40.0", "limit = 5.27")
        .replace("-350.0, 0.0", "-360.0, 0.0");
    let held = "kind = \"register\"\nregister = \"holding:10\"\nwords = [0, 17, 60536, 1]";
    let trace = run(&line, &cnc(held), MINUTE);
    law::holds(&trace);
    assert_eq!(
        (trace.reported("arm-refused"), trace.states()),
        (0, vec!["waiting", "active"]),
        "{}",
        trace.lines()
    );
}

#[test]
fn a_dry_run_does_not_wait_for_a_reference_position_that_it_never_writes() {
    let trace = block_on(async {
        let mut world = World::new(include_str!("line.toml"), "").await;
        world.gateway().options(|options| options.dry_run = true).run(MINUTE).await
    });
    law::holds(&trace);
    assert_eq!(trace.wire.iter().filter(|seen| seen.is_write()).count(), 0);
    assert_eq!(trace.states(), ["waiting", "active"], "it shows what it would do\n{}", trace.lines());
}

#[test]
fn a_step_that_is_no_multiple_of_the_count_is_never_exceeded_by_rounding() {
    let text = BENCH.replace("step = 1.0", "step = 0.25");
    let trace = run(&text, &cnc("kind = \"restart\"\nat = \"60s\""), 3 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
}

#[test]
fn an_axis_with_nothing_but_a_corrected_position_starts_from_zero() {
    let from = BENCH.find("[output.cnc_z]").unwrap();
    let to = BENCH.find("[heartbeat]").unwrap();
    let text = format!("{}{}", &BENCH[..from], &BENCH[to..]);
    let trace = run(&text, "", 2 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    assert!(trace.writes("readout_z").len() > 100);
    assert!(trace.outcome.rested, "{:?}", trace.outcome);
}

#[test]
fn a_diameter_changes_by_twice_what_the_radius_does() {
    let text = BENCH.replace("deadband = 0.1", "deadband = 0.1\ndiameter = true");
    let trace = run(&text, "", 2 * MINUTE);
    law::holds(&trace);
    let status = &trace.samples.iter().rfind(|sample| sample.at <= trace.stopped.0).unwrap().status;
    let written = values(&trace, "cnc_z", 60.0, 120.0);
    let half = written.last().unwrap() / 2.0;
    assert!((half - status.axes[0].cz_um).abs() <= 0.11, "{half} {}", status.axes[0].cz_um);
}

#[test]
fn the_readout_gets_the_position_plus_what_the_cnc_gets() {
    let trace = run(&patient(), "", 3 * MINUTE);
    law::holds(&trace);
    let scale = &trace.profile.signals[2];
    let is_offset = |seen: &&SeenRequest| {
        let at = seen.address.register().map(|register| register.offset);
        seen.is_write() && seen.device == trace.profile.outputs[1].device && at == Some(104)
    };
    let offsets: Vec<_> = trace.wire.iter().filter(is_offset).map(|seen| (seen.at, &seen.wanted)).collect();
    let (mut position, mut compared) = (None, 0);
    for seen in trace.wire.iter().filter(|seen| seen.at <= trace.stopped.0) {
        if seen.device == scale.device && !seen.is_write() {
            position = scale.encoding.decode(&seen.after).ok();
        }
        if !seen.is_write() {
            continue;
        }
        // At the same moment, the readout is written first and then the CNC.
        let offset = offsets.iter().rfind(|(at, _)| *at <= seen.at);
        let offset = offset.and_then(|(_, wanted)| trace.profile.outputs[1].encoding.decode(wanted).ok());
        if seen.device == trace.profile.outputs[0].device
            && let (Some(position), Some(offset)) = (position, offset)
        {
            let shown = trace.profile.outputs[0].encoding.decode(&seen.wanted).unwrap();
            let cz = 1000.0 * (shown - position);
            // The tolerance is one count. The CNC may be a step behind while it approaches its target.
            let settled = trace.seconds(seen.at) > 40.0;
            assert!((cz - offset).abs() <= if settled { 0.11 } else { 1.11 } + 0.2, "{cz} {offset}");
            compared += 1;
        }
    }
    assert!(compared > 100, "{compared}");
}

#[test]
fn a_person_is_answered_in_words() {
    let said = std::cell::RefCell::new(Vec::new());
    block_on(async {
        let mut world = World::new(BENCH, "").await;
        let ask = |command| {
            let said = &said;
            move |stage: &Stage<'_>| {
                said.borrow_mut().push(stage.source.command(command, None, &somebody()).unwrap())
            }
        };
        let trial = world.gateway().at(10 * SECOND, ask(Command::Disarm)).at(20 * SECOND, ask(Command::Zero));
        trial.at(30 * SECOND, ask(Command::Arm)).run(MINUTE).await
    });
    let said = said.into_inner();
    assert!(said[0].text().starts_with("z: off"), "{said:?}");
    assert!(matches!(&said[2], Answer::Done(said) if said.starts_with("z: armed")), "{said:?}");
}

#[test]
fn several_axes_and_outputs_on_several_lines_each_get_their_own() {
    let trace = run(LATHE, "", 2 * MINUTE);
    law::holds(&trace);
    let last = |output: &str| *values(&trace, output, 0.0, 120.0).last().unwrap();
    assert!((-14.0..=-10.0).contains(&last("cnc_x")), "the diameter: {}", last("cnc_x"));
    assert!((last("cnc_x") - last("spare_x")).abs() <= 0.21, "{} {}", last("cnc_x"), last("spare_x"));
    assert!((7.0..=12.0).contains(&last("cnc_z")), "{}", last("cnc_z"));
    let states = &trace.samples[100].status.axes;
    assert!(states.iter().all(|axis| axis.state == "active"), "{}", trace.lines());
    // X returns to zero, Z holds.
    assert!(trace.outcome.rested, "{:?}\n{}", trace.outcome, trace.lines());
    assert!(trace.outcome.left.contains("cnc_x holds 0.0"), "{:?}", trace.outcome);
    assert!(!trace.outcome.left.contains("cnc_z holds 0.0"), "{:?}", trace.outcome);
}

#[test]
fn an_axis_whose_second_output_dies_is_held_and_the_other_axis_goes_on() {
    let faults = "[[fault]]\ndevice = \"spare\"\nkind = \"silent\"\nat = \"60s\"\nfor_time = \"60s\"";
    let trace = run(LATHE, faults, 4 * MINUTE);
    law::holds(&trace);
    assert!(trace.samples.iter().all(|sample| sample.status.axes[1].state != "ramping"));
    let z = trace.between(20, 240).all(|sample| sample.status.axes[1].state == "active");
    assert!(z, "{}", trace.lines());
    assert_eq!(trace.states_between(230, 240), ["active"], "{}", trace.lines());
}

#[test]
fn an_output_that_can_only_be_written_is_never_jumped_after_it_was_off() {
    let short = "[device.spare]\nfunctions = [\"write-single\", \"write-multiple\"]\n";
    let mut text = LATHE.replace("[device.spare]\n", short);
    let from = text.find("[output.cnc_x]").unwrap();
    let to = text.find("[output.spare_x]").unwrap();
    text.replace_range(from..to, "");
    let faults = "[[fault]]\ndevice = \"spare\"\nkind = \"late\"\ndelay = \"150ms\"\nat = \"6s\"\nfor = 2";
    let trace = block_on(async {
        let mut world = World::new(&text, faults).await;
        let trial = world.gateway().command(MINUTE, Command::Disarm).command(90 * SECOND, Command::Arm);
        trial.run(3 * MINUTE).await
    });
    law::holds(&trace);
    let functions: std::collections::BTreeSet<u8> =
        trace.wire.iter().filter(|seen| seen.device.0 == 1).map(|seen| seen.function).collect();
    assert!(!functions.contains(&3), "{functions:?}");
    assert_eq!(trace.states_between(150, 180), ["active"], "{}", trace.lines());
}
