//! Spindle speed as an input.

use isotherm::cli::replay::replay;
use isotherm_core::compensation::model::Outside;
use isotherm_identify::method::{Method, Settings};
use isotherm_identify::setup::{Choice, ready};
use isotherm_identify::written::written;
use isotherm_identify::{Identified, identify};
use isotherm_profile::Profile;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::rig::{self, Day, dataset};
use super::whitened;

/// Day in which the square of the speed warms a part that no sensor measures.
#[derive(Clone)]
pub(crate) struct Turning {
    pub(crate) day: Day,
    pub(crate) rpm: Vec<f64>,
}

pub(crate) fn days(count: u64) -> Vec<Turning> {
    let turning = |(mut day, seed): (Day, u64)| {
        let mut chance = Pcg64Mcg::seed_from_u64(seed);
        let speeds: Vec<f64> = (0..6).map(|_| f64::from(chance.random_range(0..6)) * 1000.0).collect();
        let rows = day.times.len();
        let rpm: Vec<f64> = (0..rows).map(|row| if row < 5 { 0.0 } else { speeds[row * 6 / rows] }).collect();
        let mut warm = 0.0;
        for (error, speed) in day.error.iter_mut().zip(&rpm) {
            warm += (1.0 - (-60.0_f64 / 1500.0).exp()) * (1e-6 * speed * speed - warm);
            *error += warm;
        }
        Turning { day, rpm }
    };
    whitened::days(count, 9, 0.2).into_iter().zip(0..).map(turning).collect()
}

/// Log without the speed in some rows.
pub(crate) fn log(day: &Turning, is_missing: impl Fn(usize) -> bool) -> String {
    let plain = day.day.log();
    let mut lines = plain.lines();
    let mut text = format!("{},rpm\n", lines.next().unwrap());
    for (row, (line, speed)) in lines.zip(&day.rpm).enumerate() {
        let speed = if is_missing(row) { String::new() } else { speed.to_string() };
        text += &format!("{line},{speed}\n");
    }
    text
}

fn logs(count: u64) -> Vec<String> {
    days(count).iter().map(|day| log(day, |_| false)).collect()
}

pub(crate) fn profile_with(model: &str) -> String {
    let speed = "[signal.rpm]\ndevice = \"m\"\nregister = \"input:90\"\ntype = \"u16\"\nunit = \"rpm\"\nmax_age = \"5s\"\n";
    rig::profile_with(4, model).replacen("[axis.z]", &format!("{speed}[axis.z]"), 1)
}

fn profile() -> Profile {
    rig::parsed(std::path::Path::new("bench.toml"), &profile_with(rig::NO_MODEL))
}

fn chosen(logs: &[String], choice: &Choice, settings: &Settings) -> Identified {
    let (profile, dataset) = (profile(), dataset(logs).unwrap());
    let ready = ready(&profile, &dataset, choice).unwrap();
    identify(&ready, settings, None, true, &|_, _| {}).unwrap()
}

/// Identifies with the speed as an input.
pub(crate) fn by(logs: &[String], settings: &Settings) -> Identified {
    chosen(logs, &Choice { speeds: true, ..rig::choice() }, settings)
}

pub(crate) fn found(logs: &[String]) -> Identified {
    by(logs, &Settings::default())
}

#[test]
fn a_speed_and_its_square_are_taken_where_the_logs_have_them_and_a_model_without_stands_in() {
    let logs = logs(5);
    let (without, with) = (chosen(&logs, &rig::choice(), &Settings::default()), found(&logs));
    assert!(
        with.means.mean_range_um < 0.3 * without.means.mean_range_um,
        "{:?} {:?}",
        with.means,
        without.means
    );
    let lost = with.fallbacks.iter().find(|fallback| fallback.without == "rpm").unwrap();
    assert!(lost.terms.iter().all(|term| term.signal != "rpm"));
    assert!((lost.means.mean_range_um - without.means.mean_range_um).abs() < 1e-9);
    let block = written(&with, "z", Outside::Agree);
    let line = block.block.lines().find(|line| line.contains("power = 2")).unwrap();
    assert!(
        line.contains("signal = \"rpm\", power = 2, gain = ") && line.contains("reference = 0.0, lag = "),
        "{line}"
    );
    rig::pasted(&profile_with(&block.block), &block.files);
}

#[test]
fn a_speed_that_one_run_lacks_is_no_input_and_no_run_loses_its_rows() {
    let mut logs = logs(4);
    logs[2] = days(4)[2].day.log();
    let found = found(&logs);
    assert!(found.terms.iter().all(|term| term.signal != "rpm"), "{:?}", found.terms);
    let reported = found.notes.remarks.join("; ");
    assert!(
        reported.contains("rpm is not an input, because it is missing in 100 % of the rows in day2"),
        "{reported}"
    );
}

#[test]
fn inputs_that_are_named_leave_a_speed_out_and_say_so() {
    let inputs = vec!["s0".to_owned(), "s2".to_owned()];
    let found = chosen(&logs(3), &Choice { speeds: true, inputs, ..rig::choice() }, &Settings::default());
    let reported = found.notes.remarks.join("; ");
    assert!(
        reported.contains("rpm is not an input, because it is not in the list after --inputs"),
        "{reported}"
    );
}

#[test]
fn a_network_takes_no_speed() {
    let inputs = vec!["s0".to_owned(), "rpm".to_owned()];
    let (profile, dataset) = (profile(), dataset(&logs(3)).unwrap());
    let ready = ready(&profile, &dataset, &Choice { inputs, ..rig::choice() }).unwrap();
    let settings = Settings { method: Method::Rbf, ..Settings::default() };
    let why = identify(&ready, &settings, None, false, &|_, _| {}).unwrap_err();
    assert!(why.contains("rbf") && why.contains("rpm is a speed"), "{why}");
}

#[test]
fn of_one_run_a_model_without_the_speed_is_written_too() {
    let found = found(&logs(1));
    assert_eq!(found.fallbacks.iter().map(|own| own.without.as_str()).collect::<Vec<_>>(), ["rpm"]);
    assert!(found.means.worst_range_um.is_nan() && found.fallbacks[0].means.worst_range_um.is_nan());
    let failed = "there is no replacement for a failed sensor";
    assert!(found.notes.remarks.iter().any(|reported| reported.contains(failed)));
    let block = written(&found, "z", Outside::Agree);
    assert!(block.block.contains("\n# Used while rpm is lost.\n"), "{}", block.block);
    rig::pasted(&profile_with(&block.block), &block.files);
}

#[test]
fn a_block_with_a_speed_replayed_over_a_day_it_never_saw_leaves_what_cross_validation_left() {
    let logs = logs(5);
    let held = found(&logs).held_out.remove(4);
    let block = written(&found(&logs[..4]), "z", Outside::Warn);
    assert!(block.block.contains("power = 2"), "{}", block.block);
    let profile = rig::pasted(&profile_with(&block.block), &block.files);
    let mut out = Vec::new();
    replay(&profile, logs[4].as_bytes(), "last.csv", Some(&mut out)).unwrap();
    let mut table = csv::Reader::from_reader(out.as_slice());
    let heads = table.headers().unwrap().clone();
    let at = |name: &str| heads.iter().position(|head| head == name).unwrap();
    let (time, raw) = (at("time"), at("z_raw_um"));
    let rows = table.records().map(Result::unwrap).filter(|row| !row[raw].is_empty());
    let cz: Vec<(f64, f64)> =
        rows.map(|row| (row[time].parse().unwrap(), row[raw].parse().unwrap())).collect();
    let mut compared = 0;
    for (second, wanted) in held.seconds.iter().zip(&held.cz) {
        let Some((_, cz)) = cz.iter().find(|(time, _)| (time - second).abs() < 1.0) else { continue };
        assert!((cz - wanted).abs() < 0.05, "after {second} s: {cz} µm, and {wanted} µm held out");
        compared += 1;
    }
    assert!(compared > 400, "{compared} rows");
}
