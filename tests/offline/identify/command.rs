//! Options of the command line: their inputs and outputs.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use super::rig;
use super::speed;
use super::whitened::{days, logs};

/// Runs `identify` on these logs. Returns its output, and whether it succeeded.
pub(crate) fn identify(home: &Path, profile: &str, logs: &[String], arguments: &[&str]) -> (String, bool) {
    let path = home.join("bench.toml");
    std::fs::write(&path, profile).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    command.env_clear().env("HOME", home).current_dir(home);
    command.args(["identify", "bench.toml"]).args(rig::logs(home, logs)).args(arguments);
    let ended = command.output().unwrap();
    let said = [ended.stdout, ended.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    (said, ended.status.success())
}

fn bench() -> String {
    rig::profile_with(4, rig::NO_MODEL)
}

#[test]
fn a_prior_is_read_for_the_axis_with_0s_as_at_once_and_another_axis_has_none() {
    let home = tempfile::tempdir().unwrap();
    // A model that leaves more than no compensation is refused. Without s0, this one would.
    let model = |axis: &str, gain: f64| {
        format!(
            "[[axis.{axis}.model]]\nname = \"old\"\nkind = \"linear\"\nterms = [\n  {{ signal = \"s2\", gain = {gain}, \
             reference = \"start\", lag = \"0s\" }},\n  {{ signal = \"s0\", gain = -3.0, reference = \"start\", lag = \
             \"1500s\" }},\n]\n"
        )
    };
    // The axes of a file are ordered by name; a has another size.
    std::fs::write(home.path().join("old.toml"), model("a", 1000.0) + &model("z", 1.5)).unwrap();
    std::fs::write(home.path().join("other.toml"), model("a", 1000.0)).unwrap();
    let logs = logs(&days(1, 3, 0.0));
    let (said, is_good) = identify(home.path(), &bench(), &logs, &["--prior", "old.toml", "--json"]);
    assert!(is_good, "{said}");
    let document: Value = serde_json::from_str(&said).unwrap();
    let terms = document["terms"].as_array().unwrap();
    let gains = terms.iter().filter(|term| term["signal"] == "s2" && term["lag_s"] == 0.0);
    let gains: Vec<f64> = gains.map(|term| term["gain"].as_f64().unwrap()).collect();
    assert!(gains.len() == 1 && (1.0..2.0).contains(&gains[0]), "one column, held to 1.5: {gains:?}");
    assert!(terms.iter().all(|term| term["se"].is_null()), "one run says nothing of errors: {terms:?}");
    assert_eq!(document["worst_range_um"], Value::Null);
    let (said, is_good) = identify(home.path(), &bench(), &logs, &["--prior", "other.toml"]);
    assert!(!is_good && said.contains("no linear model of axis z"), "{said}");
}

#[test]
fn what_was_mended_is_written_beside_what_was_recorded_and_where_nothing_was_that_is_told() {
    let home = tempfile::tempdir().unwrap();
    let mut all = days(4, 23, 0.2);
    all[1].temperatures[2][90] += 5.0;
    let recorded = all[1].temperatures[2][90];
    let (said, is_good) = identify(home.path(), &bench(), &logs(&all), &["--mended", "new/mended"]);
    assert!(is_good && said.contains("the repaired log is in new/mended/day1.mended.csv"), "{said}");
    let mut table = csv::Reader::from_path(home.path().join("new/mended/day1.mended.csv")).unwrap();
    let heads: Vec<String> = table.headers().unwrap().iter().map(str::to_owned).collect();
    assert_eq!(heads, ["time_s", "s0", "s1", "s2", "s3", "z_error_um", "s2_recorded"]);
    let row = table.records().nth(90).unwrap().unwrap();
    let cell = |place: usize| row[place].parse::<f64>().unwrap();
    assert!((cell(0) - 5400.0).abs() < 1e-9 && (cell(6) - recorded).abs() < 1e-9, "{row:?}");
    assert!((cell(3) - (recorded - 5.0)).abs() < 0.5, "bridged: {row:?}");
    assert_eq!(std::fs::read_dir(home.path().join("new/mended")).unwrap().count(), 1);
    let good = logs(&days(4, 23, 0.2));
    let (said, is_good) = identify(home.path(), &bench(), &good, &["--mended", "none"]);
    assert!(is_good && said.contains("no sensor reading was repaired"), "{said}");
    // A run of a column may be called anything.
    let shift = |log: &String| log.replace(",z_error_um\n", ",z_error_um,shift\n");
    let one = (all.iter().zip(["mon/1", "mon/2", "tue/1", "tue/2"]))
        .enumerate()
        .map(|(place, (day, name))| {
            let log = shift(&day.log());
            let lines: Vec<String> = log.lines().skip(1).map(|line| format!("{line},{name}\n")).collect();
            if place == 0 {
                log.lines().next().unwrap().to_owned() + "\n" + &lines.concat()
            } else {
                lines.concat()
            }
        })
        .collect::<String>();
    let (said, is_good) =
        identify(home.path(), &bench(), &[one], &["--run-column", "shift", "--mended", "shifts"]);
    assert!(is_good && said.contains("mon-2"), "{said}");
}

#[test]
fn the_document_has_the_words_of_the_method_and_the_page_the_curve_of_the_sensors() {
    let home = tempfile::tempdir().unwrap();
    let logs: Vec<String> = speed::days(4).iter().map(|day| speed::log(day, |_| false)).collect();
    let profile = speed::profile_with(rig::NO_MODEL);
    let (said, is_good) = identify(home.path(), &profile, &logs, &["--json", "--report", "z.html"]);
    assert!(is_good, "{said}");
    let document: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(document["method"], "whitened");
    assert_eq!(document["worse_runs"], Value::Array(Vec::new()));
    let page = std::fs::read_to_string(home.path().join("z.html")).unwrap();
    let curve = page.split_once("<h2>How many sensors</h2>").unwrap().1;
    assert!(curve.contains("<svg") && curve.contains("held-out range by the number of sensors"));
    assert!(
        page.contains("rpm²") && page.contains("Terms, µm/rpm²") && page.contains("or a speed or its square")
    );
    assert!(!page.contains("NaN"));
}

#[test]
fn terms_that_come_to_most_are_first_whatever_their_units() {
    let home = tempfile::tempdir().unwrap();
    let logs: Vec<String> = speed::days(4).iter().map(|day| speed::log(day, |_| false)).collect();
    let (said, _) = identify(home.path(), &speed::profile_with(rig::NO_MODEL), &logs, &[]);
    let terms = said.split_once("is the sum of\n").unwrap().1;
    let first: Vec<&str> = terms.lines().take(5).collect();
    assert!(first.iter().any(|line| line.contains("µm/rpm²")), "{terms}");
}
