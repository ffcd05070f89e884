//! A sensor that freezes at a machine: found, told, taken from the others, and in the log as it was.

use std::path::Path;
use std::time::Duration;

use isotherm::cli::replay::replay;
use isotherm::observe::status::Command;
use isotherm::virtual_machine::FaultScript;
use isotherm_profile::{Profile, parse_with};

use crate::law;
use crate::rig::{Trace, World, block_on, patient};

const MINUTE: Duration = Duration::from_secs(60);

/// The wheelhead rises as the bed does; neither is exact.
const STAND_INS: &str = r#"{ "format": "isotherm-stand-ins", "version": 1, "sensors": [
  { "signal": "wheelhead", "threshold": 0.3, "stands_in": true, "terms": [{ "signal": "bed", "lag_s": 0, "gain": 1.2 }] } ] }"#;

fn profile(stand_ins: &str) -> Profile {
    let model = "[[axis.z.model]]
name = \"rises\"
kind = \"linear\"
stand_ins = \"s.json\"
terms = [
  { signal = \"bed\", gain = 2.0, reference = \"start\" },
  { signal = \"wheelhead\", gain = -1.0, reference = \"start\", lag = \"10min\" },
]
";
    let bench = patient();
    let (before, rest) = bench.split_once("[[axis.z.model]]").unwrap();
    let (_, after) = rest.split_once("[output.").unwrap();
    let text = format!("{before}{model}\n[output.{after}");
    let files = [("s.json", stand_ins.as_bytes())];
    let loaded = parse_with(Path::new("bench.toml"), &text, &files, &[], &[]);
    loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// The wheelhead reads the same from the twentieth minute on; what else fails, and what is commanded in which minute.
fn a_frozen_wheelhead(directory: &Path, more: &str, commands: &[(u32, Command)]) -> Trace {
    let faults = "
        [[fault]]
        device = \"thermocouples\"
        kind = \"value\"
        signal = \"wheelhead\"
        value = 23.0
        at = \"20min\"
        for_time = \"65min\"
        ";
    block_on(async {
        let profile = profile(STAND_INS);
        let faults = FaultScript::parse(&format!("{faults}{more}"), &profile).unwrap();
        let mut world = World::start(profile, faults, None).await;
        let state = Some(directory.to_owned());
        let trial = world.gateway().options(|options| options.directory = state);
        let trial =
            commands.iter().fold(trial, |trial, (minute, command)| trial.command(*minute * MINUTE, *command));
        trial.run(100 * MINUTE).await
    })
}

#[test]
fn an_axis_that_was_switched_off_by_itself_believes_its_frozen_sensor_no_more_than_before() {
    let directory = tempfile::tempdir().unwrap();
    let foreign = "
        [[fault]]
        device = \"cnc\"
        kind = \"register\"
        register = \"holding:104\"
        words = [0, 55]
        at = \"60min\"";
    let trace = a_frozen_wheelhead(directory.path(), foreign, &[(62, Command::Arm)]);
    assert_eq!((trace.reported("foreign-change"), trace.reported("disarmed")), (1, 1), "{}", trace.lines());
    for sample in trace.between(64 * 60, 80 * 60) {
        let axis = &sample.status.axes[0];
        assert_eq!((axis.state, axis.stood_in.is_some()), ("degraded", true), "{}", trace.lines());
    }
}

#[test]
fn a_frozen_sensor_is_taken_from_the_others_until_a_person_has_looked() {
    let directory = tempfile::tempdir().unwrap();
    // After an hour and a half a person looks.
    let looks = [(90, Command::Disarm), (91, Command::Arm)];
    let trace = a_frozen_wheelhead(directory.path(), "", &looks);
    law::holds(&trace);
    assert_eq!(trace.reported("frozen"), 1, "{}", trace.lines());
    // The value from which it stands comes too fast at first: lost for two seconds, and believed at once.
    assert_eq!(trace.reported("stood-in"), 1, "{}", trace.lines());
    assert_eq!(trace.reported("stand-in-over"), 2, "{}", trace.lines());
    let told = trace.events.iter().find(|event| event.kind == "frozen").unwrap();
    assert!(told.text.contains("axis z: wheelhead frozen for "), "{}", told.text);
    assert!(told.text.ends_with("taken from 1 others"), "{}", told.text);
    let frozen = trace.between(85 * 60, 89 * 60).map(|sample| &sample.status.axes[0]);
    for axis in frozen {
        let found = axis.stood_in.as_ref().unwrap();
        assert_eq!((axis.state, axis.model.as_deref()), ("degraded", Some("rises")));
        assert_eq!((found.signal.as_str(), found.frozen, found.others), ("wheelhead", true, 1));
        assert_eq!(axis.why, "wheelhead frozen, taken from 1 others");
        assert!(&found.since[11..16] > "06:19" && &found.since[11..16] < "06:22", "{}", found.since);
    }
    let after = trace.between(93 * 60, 99 * 60).map(|sample| &sample.status.axes[0]);
    after.for_each(|axis| assert_eq!((axis.state, axis.stood_in.is_none()), ("active", true)));

    let log = directory.path().join("bench-2026-01-05.csv");
    let text = std::fs::read_to_string(&log).unwrap();
    assert!(text.lines().next().unwrap().contains(",z_stood_in"), "{}", text.lines().next().unwrap());
    assert!(text.matches(",wheelhead,").count() > 500, "it stands in the rows");
    let again = |stand_ins: &str| {
        replay(&profile(stand_ins), std::fs::File::open(&log).unwrap(), "the day", None).unwrap()
    };
    let summary = again(STAND_INS);
    let reproduced = summary.axes["z"].reproduced.as_ref().unwrap();
    assert!(reproduced.first.is_none() && reproduced.rows > 1500, "{summary}");
    assert_eq!(summary.warnings, [""; 0]);
}

#[test]
fn a_log_that_goes_on_with_another_file_says_so() {
    let directory = tempfile::tempdir().unwrap();
    let run = || {
        block_on(async {
            let profile = profile(STAND_INS);
            let faults = FaultScript::parse("", &profile).unwrap();
            let mut world = World::start(profile, faults, None).await;
            let state = Some(directory.path().to_owned());
            world.gateway().options(|options| options.directory = state.clone()).run(2 * MINUTE).await;
            world.gateway().options(|options| options.directory = state).run(2 * MINUTE).await
        })
    };
    law::holds(&run());
    let log = directory.path().join("bench-2026-01-05.csv");
    let warnings = |stand_ins: &str| {
        let log = std::fs::File::open(&log).unwrap();
        replay(&profile(stand_ins), log, "the day", None).unwrap().warnings
    };
    assert_eq!(warnings(STAND_INS), [""; 0]);
    let told = warnings(&STAND_INS.replace("1.2", "1.3")).concat();
    assert!(told.contains("axis z, model rises: the log was written with other stand-ins"), "{told}");
}
