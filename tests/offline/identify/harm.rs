//! Models that leave held-out runs worse than no compensation, days that are alike, and what a written block says.

use isotherm_core::compensation::model::Outside;
use isotherm_identify::method::Settings;
use isotherm_identify::written::written;

use super::command::identify;
use super::rig::{self, Day, Machine, Part, found};
use super::{speed, whitened};

/// A day on which the only sensor pushes the error by so many µm per °C. No model holds on days of both signs.
fn day(seed: u64, gain: f64) -> Day {
    let parts = vec![Part { sensor: 0, gain, constant: 0.0 }];
    Machine { sensors: 1, parts, step: 60.0, rows: 300, noise: 0.0 }.day(seed)
}

fn contradicting(up: u64, down: u64) -> Vec<String> {
    let ups = (0..up).map(|seed| day(700 + seed, 3.0));
    let downs = (0..down).map(|seed| day(800 + seed, -3.0));
    ups.chain(downs).map(|day| day.log()).collect()
}

fn bench() -> String {
    rig::profile_with(1, rig::NO_MODEL)
}

#[test]
fn a_model_that_leaves_more_than_a_third_of_eight_runs_worse_is_not_written_unless_by_force() {
    let home = tempfile::tempdir().unwrap();
    let logs = contradicting(5, 3);
    let (said, is_good) = identify(home.path(), &bench(), &logs, &["--write", "z.toml"]);
    assert!(!is_good && said.contains("z.toml is not written: with the model, "), "{said}");
    assert!(said.contains("of 8 held-out runs are worse than without compensation"), "{said}");
    assert!(said.contains("worse than without compensation:") && said.contains("of 8 runs ("), "{said}");
    assert!(!home.path().join("z.toml").exists());
    let (said, is_good) = identify(home.path(), &bench(), &logs, &["--write", "z.toml", "--force"]);
    assert!(is_good, "{said}");
    let block = std::fs::read_to_string(home.path().join("z.toml")).unwrap();
    assert!(block.contains("of 8 held-out runs are worse than uncompensated: "), "{block}");
    let (said, is_good) = identify(home.path(), &bench(), &logs, &["--force"]);
    assert!(!is_good && said.contains("--write"), "there is nothing to force: {said}");
}

#[test]
fn a_probe_that_hides_what_a_model_does_makes_no_block_written() {
    let home = tempfile::tempdir().unwrap();
    let arguments = ["--probe", "10min", "--write", "z.toml"];
    let (said, is_good) = identify(home.path(), &bench(), &contradicting(5, 3), &arguments);
    assert!(
        !is_good
            && said.contains("of 8 held-out runs are worse than without compensation (without the probe)"),
        "{said}"
    );
    assert!(!home.path().join("z.toml").exists());
}

#[test]
fn with_fewer_than_six_runs_it_warns_and_is_written() {
    let home = tempfile::tempdir().unwrap();
    let (said, is_good) = identify(home.path(), &bench(), &contradicting(3, 2), &["--write", "z.toml"]);
    assert!(is_good, "{said}");
    assert!(said.contains("note: with the model, ") && said.contains("6 or more held-out runs"), "{said}");
    assert!(home.path().join("z.toml").exists());
}

#[test]
fn a_model_that_makes_no_run_worse_says_so() {
    let home = tempfile::tempdir().unwrap();
    let logs = whitened::logs(&whitened::days(6, 11, 0.1));
    let bench = rig::profile_with(4, rig::NO_MODEL);
    let (said, is_good) = identify(home.path(), &bench, &logs, &["--write", "z.toml"]);
    assert!(is_good, "{said}");
    assert!(said.contains("worse than without compensation: none of 6 runs"), "{said}");
}

#[test]
fn days_that_are_alike_are_noted_beside_a_day_that_is_not() {
    let mut days = whitened::days(5, 11, 0.1);
    for day in &mut days[..4] {
        for sensor in &mut day.temperatures {
            let cold = sensor[0];
            sensor.iter_mut().for_each(|value| *value = cold + 0.1 * (*value - cold));
        }
        day.error.iter_mut().for_each(|error| *error *= 0.1);
    }
    let reported =
        |days: &[Day]| found(4, &whitened::logs(days), &Settings::default()).notes.remarks.join("; ");
    let remarks = reported(&days);
    assert!(
        remarks.contains("the other runs cover only a small part of the values in day4: the error spans"),
        "{remarks}"
    );
    assert_eq!(remarks.matches("cover only a small part of the values").count(), 1, "{remarks}");
    let other = reported(&whitened::days(5, 11, 0.1));
    assert!(!other.contains("cover only a small part of the values"), "{other}");
}

#[test]
fn a_speed_that_the_other_days_never_came_near_is_noted() {
    let mut days = speed::days(5);
    for (place, day) in days.iter_mut().enumerate() {
        let fast = if place == 4 { 9000.0 } else { 1000.0 };
        day.rpm.iter_mut().skip(5).for_each(|rpm| *rpm = fast);
    }
    let logs: Vec<String> = days.iter().map(|day| speed::log(day, |_| false)).collect();
    let remarks = speed::found(&logs).notes.remarks.join("; ");
    let line = "rpm spans 9000.0 rpm in this run and 1000.0 rpm in all other runs together";
    assert!(
        remarks.contains("cover only a small part of the values in day4: ") && remarks.contains(line),
        "{remarks}"
    );
}

#[test]
fn the_block_says_what_a_zero_needs() {
    let found = found(4, &whitened::logs(&whitened::days(4, 11, 1.0)), &Settings::default());
    let block = written(&found, "z", Outside::Agree);
    let line = "If you use `isotherm zero`, write datum = \"zero\" under [axis.z]";
    assert!(block.block.lines().any(|own| own.starts_with("# ") && own.contains(line)), "{}", block.block);
}
