//! Results in reports for people and in documents for programs.

use std::time::Duration;

use serde_json::Value;

use crate::end_to_end::plant::{OUTPUT, PROFILE, asked, day, identify};
use crate::end_to_end::process::{Running, file, isotherm, until};
use crate::support::starved::worked;

#[test]
fn a_sensor_that_hangs_in_the_hall_is_known_by_what_it_does() {
    let home = tempfile::tempdir().unwrap();
    let logs = [("one.csv", day(1)), ("two.csv", day(2)), ("three.csv", day(3))];
    let document = identify(home.path(), PROFILE, &logs, &["--json"]);
    let document: Value = serde_json::from_str(&document.out).unwrap();
    let like = document["ambient"].as_array().unwrap();
    assert_eq!(like.len(), 1, "{like:?}");
    assert_eq!(like[0]["signal"], "post");
    let reason = like[0]["reason"].as_str().unwrap();
    for words in
        ["starts of spindle_rpm", "% of its variance", "°C in 20 min", "its correlation with the error"]
    {
        assert!(reason.contains(words), "{words}: {reason}");
    }
    let reported = asked(home.path(), &["select", "--error", "z_error_um"], &logs, &[]);
    assert!(reported.out.contains("note: post behaves like the air"), "{}", reported.out);
}

#[test]
fn the_document_of_a_model_has_what_its_report_says() {
    let home = tempfile::tempdir().unwrap();
    let logs = [("one.csv", day(1)), ("two.csv", day(2)), ("three.csv", day(3))];
    let block = home.path().join("z.toml");
    let answer = identify(
        home.path(),
        &format!("{PROFILE}{OUTPUT}"),
        &logs,
        &["--method", "ols", "--json", "--write", block.to_str().unwrap()],
    );
    let document: Value = serde_json::from_str(&answer.out).unwrap_or_else(|_| panic!("{}", answer.said));
    assert_eq!(document["machine"], "plant");
    assert!(document["made"].as_str().unwrap().ends_with('Z'));
    let first = &document["logs"][0];
    assert_eq!((&first["rows"], &first["duration_s"]), (&300.into(), &17_940.0.into()));
    assert_eq!(first["speeds"][0]["max"], 3000.0);
    assert_eq!(first["ambient"]["name"], "post");
    assert!(document["condition"].as_f64().unwrap() >= 1.0);
    assert!(
        document["terms"].as_array().unwrap().iter().all(|term| term["inflation"].as_f64().unwrap() >= 1.0)
    );
    let run = &document["runs"][0];
    let cut =
        100.0 * (1.0 - run["range_um"].as_f64().unwrap() / run["uncompensated_range_um"].as_f64().unwrap());
    assert!((run["range_cut_percent"].as_f64().unwrap() - cut).abs() < 1e-9);
    assert!(document["columns"][0]["resolution"].as_f64().unwrap() > 0.0);
    assert_eq!(document["envelope"]["inputs"].as_array().unwrap().len(), 3);
    assert_eq!(document["limits"]["limit_um"], 40.0);
    assert_eq!(document["drift"][0]["test"], "spindle");
    // Each substitute has the envelope of its own inputs, and the profile with all of them is accepted.
    let stand_ins = document["fallbacks"].as_array().unwrap();
    assert_eq!(stand_ins.len(), 3);
    assert!(stand_ins.iter().all(|one| one["envelope"]["inputs"].as_array().unwrap().len() == 2));
    let pasted = format!("{PROFILE}{}\n{OUTPUT}", std::fs::read_to_string(&block).unwrap());
    let pasted = file(home.path(), "pasted.toml", &pasted);
    let checked = |pasted: &std::path::Path, settle: &str| {
        let settle = format!("machine.settle={settle}");
        let checked =
            isotherm(home.path()).arg("check").arg(pasted).args(["--set", &settle]).output().unwrap();
        assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
        String::from_utf8(checked.stderr).unwrap()
    };
    let doubt = "was identified with `settle =";
    assert!(!checked(&pasted, "3min").contains(doubt));
    assert_eq!(checked(&pasted, "30s").matches(doubt).count(), 4);
    assert_eq!(
        std::fs::read_dir(home.path())
            .unwrap()
            .filter(|entry| {
                entry.as_ref().unwrap().file_name().to_string_lossy().ends_with(".envelope.json")
            })
            .count(),
        4
    );
}

#[test]
fn a_profile_without_a_model_is_identified_and_refused_by_what_would_follow_it() {
    let home = tempfile::tempdir().unwrap();
    let profile = file(home.path(), "plant.toml", &format!("{PROFILE}{OUTPUT}"));
    let verb = |arguments: &[&str]| asked(home.path(), arguments, &[], &[]);
    let path = profile.to_str().unwrap();
    let checked = verb(&["check", path]);
    assert_eq!(checked.code, Some(0), "{}", checked.said);
    assert!(
        checked.out.contains("no model yet") && checked.said.contains("`z` has no model yet"),
        "{}",
        checked.said
    );
    assert!(!checked.out.contains("only recorded"), "{}", checked.out);
    for arguments in [&["arm", path][..], &["replay", path, "day.csv"]] {
        let refused = verb(arguments);
        assert_eq!(refused.code, Some(1), "{arguments:?}: {}", refused.said);
        assert!(
            refused.said.contains("axis z has no model") && refused.said.contains("isotherm identify"),
            "{}",
            refused.said
        );
    }
}

#[test]
fn a_report_that_cannot_be_written_does_not_throw_the_result_away() {
    let home = tempfile::tempdir().unwrap();
    let logs = [("one.csv", day(1)), ("two.csv", day(2)), ("three.csv", day(3))];
    let more = ["--method", "ols", "--report", "nowhere/report.html", "--write", "z.toml"];
    let answer = identify(home.path(), PROFILE, &logs, &more);
    assert_eq!(answer.code, Some(1));
    assert!(
        answer.out.contains("Cz = −e is the sum of") && answer.out.contains("the block is in z.toml"),
        "{}",
        answer.out
    );
    assert!(answer.said.contains("cannot write nowhere/report.html"), "{}", answer.said);
    assert!(home.path().join("z.toml").exists());
    for verb in [["select", "--error", "z_error_um"].as_slice(), &["report"]] {
        let answer = asked(home.path(), verb, &logs, &["--report", "nowhere/report.html", "--json"]);
        assert_eq!(answer.code, Some(1));
        assert!(
            answer.out.starts_with('{') && answer.said.contains("cannot write nowhere/report.html"),
            "{}",
            answer.said
        );
    }
}

/// Processor time of a process so far, in ticks of 10 ms.
fn spent_by(process: u32) -> u64 {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    worked(&stat).map_or(0, |(_, ticks)| ticks)
}

#[test]
fn ctrl_c_ends_what_computes_for_long_within_a_second() {
    let home = tempfile::tempdir().unwrap();
    file(home.path(), "plant.toml", PROFILE);
    for number in 1..=3 {
        file(home.path(), &format!("{number}.csv"), &day(number));
    }
    let mut command = isotherm(home.path());
    let logs = ["1.csv", "2.csv", "3.csv"];
    command.current_dir(home.path()).args(["identify", "plant.toml"]).args(logs);
    let mut running =
        Running::start(command.args(["--method", "network", "--neurons", "51", "--resample", "0s"]));
    std::thread::sleep(Duration::from_millis(500));
    assert!(!running.has_ended(), "it takes longer than this: {:?}", running.so_far());
    let before = spent_by(running.id());
    running.signal("INT");
    // The limit is two seconds of processor time, that is one second on two processors. On a busy computer, the elapsed
    // time is longer.
    until("it ends", || {
        let spent = spent_by(running.id()).saturating_sub(before);
        if running.has_ended() {
            return Ok(());
        }
        assert!(spent < 200, "it has computed for {spent} ticks since it was interrupted");
        Err(format!("{spent} ticks"))
    });
}
