//! Last check before a value is sent: the control must read the intended value, and within the limit. A scale that is
//! changed after the checks of the profile is simulated by changing the profile after it was read.

use std::path::Path;
use std::time::Duration;

use isotherm::observe::status::Command;
use isotherm_core::codec::Scale;
use isotherm_profile::{Profile, parse};

use crate::faults::rig::{BENCH, Trace, World, block_on, run};

const MINUTE: Duration = Duration::from_secs(60);
const CONFIRMED: Duration = Duration::from_secs(3);
const BLOCK: &str = include_str!("plc.toml");
const LINE: &str = include_str!("line.toml");

/// Runs the profile with a layer above it, and with a further change, for one minute.
fn changed(text: &str, faults: &str, change: impl FnOnce(&mut Profile)) -> Trace {
    let layer = [("machine.label".to_owned(), "bench".to_owned())];
    let loaded = parse(Path::new("bench.toml"), text, &layer, &[]);
    let mut profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    change(&mut profile);
    let state = tempfile::tempdir().unwrap();
    block_on(async {
        let mut world = World::of(profile, faults).await;
        let directory = Some(state.path().to_owned());
        let trial = world.gateway().options(|options| options.directory = directory);
        // The operator offset is confirmed, if there is one.
        let trial = if faults.is_empty() { trial } else { trial.command(CONFIRMED, Command::Arm) };
        trial.run(MINUTE).await
    })
}

/// Checks that nothing but zero is sent to this output, and that its axis is off for this reason.
#[track_caller]
fn nothing_is_sent(trace: &Trace, output: &str, why: &str) {
    let sent: Vec<f64> = trace.writes(output).into_iter().map(|(_, value)| value).collect();
    assert!(sent.iter().all(|value| value.abs() < 1e-9), "{sent:?}\n{}", trace.lines());
    let told = trace.events.iter().filter(|event| event.kind == "disarmed");
    let told: Vec<&str> = told.map(|event| event.text.as_str()).collect();
    let begin = format!("nothing is sent to output {output}");
    assert!(
        told.iter().any(|text| text.contains(&begin) && text.contains(why)),
        "{told:?}\n{}",
        trace.lines()
    );
    let last = trace.samples.last().unwrap();
    assert!(
        last.status.axes.iter().any(|axis| axis.state == "off" && axis.why.cause.contains(&begin)),
        "{}",
        trace.lines()
    );
}

#[test]
fn an_offset_that_the_control_would_read_otherwise_is_not_sent_and_its_axis_is_off() {
    for (scale, why) in [(0.001, "would read"), (-0.1, "instead of"), (0.05, "instead of")] {
        let trace = changed(BENCH, "", |profile| profile.outputs[1].encoding.scale = Scale::of(scale));
        nothing_is_sent(&trace, "cnc_z", why);
    }
    let trace = changed(BENCH, "", |profile| profile.outputs[1].encoding.bias = 4);
    assert_eq!(trace.writes("cnc_z").len(), 0, "{}", trace.lines());
    nothing_is_sent(&trace, "cnc_z", "would read");
    // The profile with the offset only.
    let (before, after) = BENCH.split_once("[output.readout_z]").unwrap();
    let offset = after.split_once("[output.cnc_z]").unwrap().1;
    let text = format!("{before}[output.cnc_z]{offset}");
    let trace = changed(&text, "", |profile| profile.axes[0].diameter = true);
    nothing_is_sent(&trace, "cnc_z", "instead of");
}

#[test]
fn a_share_of_an_operators_register_is_read_from_his_part() {
    let text = BENCH.replace("refresh = \"10s\"", "refresh = \"10s\"\nshare = \"ledger\"");
    let part = "[[fault]]\ndevice = \"cnc\"\nkind = \"register\"\nregister = \"holding:104\"\nwords = [0, 1200]\nat = \"0s\"\n";
    for (scale, why) in [(0.001, "would read"), (-0.1, "instead of")] {
        let trace = changed(&text, part, |profile| profile.outputs[1].encoding.scale = Scale::of(scale));
        assert_eq!(trace.writes("cnc_z").len(), 0, "{}", trace.lines());
        nothing_is_sent(&trace, "cnc_z", why);
    }
    let trace = changed(&text, part, |_| ());
    assert_eq!(trace.reported("disarmed"), 0, "{}", trace.lines());
    assert!(!trace.writes("cnc_z").is_empty(), "{}", trace.lines());
}

#[test]
fn a_corrected_position_that_the_control_would_read_otherwise_is_not_sent() {
    let trace = changed(BENCH, "", |profile| profile.outputs[0].encoding.scale = Scale::of(0.001));
    assert_eq!(trace.writes("readout_z").len(), 0, "{}", trace.lines());
    nothing_is_sent(&trace, "readout_z", "would read");
    let alone = BENCH.split("[output.cnc_z]").next().unwrap();
    let trace = changed(alone, "", |profile| profile.axes[0].diameter = true);
    assert!(trace.lines().contains("nothing is sent to output readout_z"), "{}", trace.lines());
}

#[test]
fn a_position_that_its_register_cannot_hold_is_not_sent() {
    let text = BENCH.replace("range = [-10.0, 500.0]\n", "").replace(
        "register = \"holding:10\"\ntype = \"i32\"\nword_order = \"msw-first\"",
        "register = \"holding:10\"\ntype = \"i16\"",
    );
    let trace = run(&text, "", MINUTE);
    assert_eq!(trace.writes("readout_z").len(), 0, "{}", trace.lines());
    nothing_is_sent(&trace, "readout_z", "beyond the limit of ±40.0 µm");
}

#[test]
fn a_set_of_which_one_value_would_be_read_otherwise_is_not_sent() {
    let trace = changed(BLOCK, "", |profile| profile.outputs[2].encoding.scale = Scale::of(0.01));
    nothing_is_sent(&trace, "plc_z", "would read");
}

#[test]
fn the_parts_of_a_line_are_read_as_what_they_come_to_at_the_reach() {
    let trace = changed(LINE, "", |profile| profile.outputs[1].encoding.scale = Scale::of(0.0001));
    nothing_is_sent(&trace, "tan_beta", "would read");
    // Without a change, everything is sent.
    let trace = changed(LINE, "", |_| ());
    assert_eq!(trace.reported("disarmed"), 0, "{}", trace.lines());
    assert!(trace.writes("tan_beta").iter().any(|(_, value)| value.abs() > 0.0), "{}", trace.lines());
}
