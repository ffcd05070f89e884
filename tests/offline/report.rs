//! Reports of `identify`, `select` and `report`, as files for a customer: complete, correct, and legible in a browser.
//!
//! The last test needs chromium and python3; `tests/run page` installs both. Without them, it fails with a message.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::support::process;

use process::{file, isotherm};

const PROFILE: &str = r#"
[machine]
name = "plant"
description = "Bearing & oil <test>"
settle = "3min"

[bus.cell]
type = "modbus-tcp"
address = "127.0.0.1:1"
timeout = "300ms"

[device.module]
bus = "cell"
unit = 1
every = "1s"

[device.cnc]
bus = "cell"
unit = 2
every = "1s"

[signal.bearing]
device = "module"
register = "input:0"
type = "i16"
scale = 0.1
unit = "degC"
range = [-10.0, 80.0]
max_age = "5s"

[signal.oil]
device = "module"
register = "input:1"
type = "i16"
scale = 0.1
unit = "degC"
range = [-10.0, 80.0]
max_age = "5s"

[signal.ambient]
device = "module"
register = "input:2"
type = "i16"
scale = 0.1
unit = "degC"
range = [-10.0, 80.0]
max_age = "5s"

[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
deadband = 0.1
every = "10s"
on_fault = { action = "ramp", after = "60s" }

[[axis.z.model]]
name = "bearing"
kind = "linear"
terms = [ { signal = "bearing", gain = -4.0, reference = 20.0 } ]

[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
register = "holding:104"
type = "i32"
word_order = "msw-first"
scale = 0.1
verify = "read-back"
"#;

/// Day of a simulated machine. The bearing deforms it with a lag of 25 minutes, the oil immediately.
fn day(number: u32) -> String {
    let mut text = "time,bearing,oil,ambient,spindle_rpm,z_error_um\n".to_owned();
    let (mut bearing, mut bent, mut oil) = (0.0_f64, 0.0, 0.0);
    for minute in 0..300_u32 {
        let runs = (minute / (60 + 10 * number)).is_multiple_of(2);
        let pump = if (minute / (35 + 7 * number)) % 2 == 1 { 6.0 } else { 0.0 };
        bearing += (if runs { 8.0 + f64::from(number) } else { 0.0 } - bearing) / 15.0;
        bent += (bearing - bent) / 25.0;
        oil += (pump - oil) / 20.0;
        // A wave that no sensor measures causes a residual error.
        let unseen = 0.4 * (f64::from(minute) / 9.0 + f64::from(number)).sin();
        let ambient = 20.0 + (f64::from(minute) / 80.0 + f64::from(number)).sin();
        let rpm = if runs { 3000 } else { 0 };
        writeln!(
            text,
            "2026-11-{:02}T{:02}:{:02}:00Z,{:.4},{:.4},{ambient:.4},{rpm},{:.4}",
            10 + number,
            6 + minute / 60,
            minute % 60,
            20.0 + bearing,
            // A reading is never quite constant.
            20.0 + oil + 0.02 * f64::from(minute).sin(),
            3.0 * bent - 2.0 * oil + unseen
        )
        .unwrap();
    }
    text
}

fn days(home: &Path) -> Vec<PathBuf> {
    (1..=4).map(|number| file(home, &format!("day-{number}.csv"), &day(number))).collect()
}

/// Page and JSON of one call.
fn made(home: &Path, before: &[&str], after: &[&str]) -> (String, Value) {
    let page = home.join("report.html");
    let mut command = isotherm(home);
    command.args(before).args(days(home)).args(after).arg("--report").arg(&page).arg("--json");
    let ended = command.output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    (std::fs::read_to_string(page).unwrap(), serde_json::from_slice(&ended.stdout).unwrap())
}

fn identified(home: &Path) -> (String, Value) {
    let profile = file(home, "plant.toml", PROFILE);
    made(home, &["identify", profile.to_str().unwrap()], &["--axis", "z"])
}

fn selected(home: &Path) -> (String, Value) {
    made(home, &["select"], &["--error", "z_error_um"])
}

fn drifted(home: &Path) -> (String, Value) {
    made(home, &["report"], &["--profile", file(home, "plant.toml", PROFILE).to_str().unwrap()])
}

/// Cells of the rows of the first table after this heading, without tags.
fn rows(page: &str, heading: &str) -> Vec<Vec<String>> {
    let after = page.split_once(&format!("<h2>{heading}</h2>")).unwrap_or_else(|| panic!("no {heading}")).1;
    let body = after.split_once("<tbody>").unwrap().1.split_once("</tbody>").unwrap().0;
    let cells = |row: &str| {
        let ends = row.split("</t").filter_map(|part| part.rsplit_once('>')).map(|(_, text)| text.to_owned());
        ends.filter(|text| !text.is_empty()).collect()
    };
    body.split("<tr").skip(1).map(cells).collect()
}

/// Formats a figure like the report.
fn shown(value: &Value) -> String {
    format!("{:.2}", value.as_f64().unwrap()).replace('-', "−")
}

#[track_caller]
fn is_whole(page: &str) {
    for outside in ["http:", "https:", "src=", "href=", "url(", "@import", "<script", "<link"] {
        assert!(!page.contains(outside), "{outside} in the page");
    }
    assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>"));
    assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
    assert!(!page.contains("NaN") && !page.contains("could not be drawn"));
    for day in 1..=4 {
        assert!(page.contains(&format!("day-{day}")), "day-{day} is not named");
    }
}

#[test]
fn the_report_of_a_model_is_one_file_with_every_run_and_the_figures_of_the_json() {
    let home = tempfile::tempdir().unwrap();
    let (page, json) = identified(home.path());
    is_whole(&page);
    let table = rows(&page, "Cross-validation");
    for (row, run) in table.iter().zip(json["runs"].as_array().unwrap()) {
        let figures = ["range_um", "uncompensated_range_um", "rmse_um", "uncompensated_rmse_um", "p95_um"];
        assert_eq!(row[0], run["name"].as_str().unwrap());
        let reported = [&row[1], &row[2], &row[4], &row[5], &row[6]];
        assert_eq!(reported.map(String::clone), figures.map(|figure| shown(&run[figure])), "{row:?}");
    }
    let mean = table.last().unwrap();
    assert_eq!(mean[1], shown(&json["mean_range_um"]));
    assert!(page.contains(&format!("{} µm", shown(&json["worst_range_um"]))));
    // The terms, the substitutes, and the content of the logs.
    for term in json["terms"].as_array().unwrap() {
        assert!(page.contains(&format!(">{}</th>", term["signal"].as_str().unwrap())));
    }
    let lost: Vec<Vec<String>> = rows(&page, "Without one of its sensors");
    assert!(!lost.is_empty() && lost.last().unwrap()[0] == "none", "{lost:?}");
    let runs = rows(&page, "Runs");
    assert_eq!(runs[0][..4], ["day-1", "2026-11-11 06:00 UTC", "4 h 59 min", "300"]);
    assert_eq!(runs[0][4], "0, 3000");
    assert!(runs[0][5].starts_with("19.") && runs[0][5].contains(" … 2"), "{:?}", runs[0]);
    for words in [
        "Bearing &amp; oil &lt;test&gt;",
        "± 40 µm",
        "Condition number",
        "variance inflation",
        "Envelope",
        "Drift tests",
    ] {
        assert!(page.contains(words), "{words}");
    }
    // One chart for each run, and one for each sensor.
    for said in [
        "measured, predicted and residual error in day-4",
        "ambient over every run",
        "correlations of the sensors",
    ] {
        assert!(page.contains(said), "{said}");
    }
}

#[test]
fn the_report_of_the_points_has_the_figures_of_the_json() {
    let home = tempfile::tempdir().unwrap();
    let (page, json) = selected(home.path());
    is_whole(&page);
    let kept = &json["recommended"]["points"];
    assert!(kept[0] == "bearing" && kept[1] == "oil", "{kept}");
    let table = rows(&page, "How many points");
    let counts = json["by_count"].as_array().unwrap();
    assert_eq!(table.len(), counts.len() + 1);
    for (row, counted) in table.iter().zip(counts) {
        let figures = ["mean_rmse_um", "mean_range_um", "worst_range_um"];
        assert_eq!(row[0], counted["k"].to_string());
        assert_eq!(row[1..4], figures.map(|figure| shown(&counted[figure])), "{row:?}");
    }
    for (row, run) in rows(&page, "Cross-validation").iter().zip(json["runs"].as_array().unwrap()) {
        assert_eq!(row[1], shown(&run["range_um"]));
    }
    assert!(page.contains("Grey relational grade") && page.contains("partial F"));
}

#[test]
fn the_drift_report_has_every_run_and_the_figures_of_the_json() {
    let home = tempfile::tempdir().unwrap();
    let (page, json) = drifted(home.path());
    is_whole(&page);
    for run in json["runs"].as_array().unwrap() {
        let moved = &run["displacements"][0];
        let row = rows(&page, run["name"].as_str().unwrap()).remove(0);
        let figures = ["range_um", "first_hour_um", "last_hour_um", "largest_60min_um"];
        assert_eq!(row[0], "z_error_um");
        assert_eq!(row[1..5], figures.map(|figure| shown(&moved[figure])), "{row:?}");
    }
    for words in [
        "plant: drift in the terms of ISO 230-3",
        "thermal distortion by a rotating spindle",
        "Stage by stage",
        "z_error_um over day-4",
        "bearing over day-1",
    ] {
        assert!(page.contains(words), "{words}");
    }
}

#[test]
fn the_groups_asked_for_are_the_groups_reported_and_nonsense_is_refused() {
    let home = tempfile::tempdir().unwrap();
    let (_, json) = made(home.path(), &["select"], &["--error", "z_error_um", "--group", "0.5"]);
    assert_eq!(json["groups"].as_array().unwrap().len(), 1);
    assert_eq!(json["groups"][0]["correlation"], 0.5);
    let mut wrong = isotherm(home.path());
    let wrong = wrong.args(["select", "--error", "z_error_um", "--group", "9"]).args(days(home.path()));
    let ended = wrong.output().unwrap();
    assert_eq!(ended.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&ended.stderr).contains("write correlations between 0 and 1"));
}

#[test]
fn a_displacement_in_millimetres_is_refused_unless_it_is_converted() {
    let home = tempfile::tempdir().unwrap();
    let log = |name: &str| {
        (0..60).fold(format!("time,bed,{name}\n"), |log, row| {
            log + &format!("{},20.{row:02},{:.4}\n", 60 * row, f64::from(row) / 10_000.0)
        })
    };
    let report = |name: &str, asked: &[&str]| {
        let log = file(home.path(), "day.csv", &log(name));
        isotherm(home.path()).arg("report").args(asked).arg(log).output().unwrap()
    };
    let refused = report("z_mm", &["--displacement", "z_mm"]);
    assert_eq!(refused.status.code(), Some(1));
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(said.contains("z_mm is in mm according to its name or unit"), "{said}");
    let converted = report("z_um [mm]", &[]);
    let said = String::from_utf8_lossy(&converted.stdout).into_owned();
    assert!(said.contains("z_um moved by 5.90 µm"), "{said}");
}

#[test]
fn temperatures_in_kelvin_without_a_unit_are_named() {
    let home = tempfile::tempdir().unwrap();
    let rows = (0..60).map(|row| format!("{},293.{row:02},{row}\n", 60 * row)).collect::<String>();
    let log = file(home.path(), "day.csv", &format!("time,bed_k,z_um\n{rows}"));
    let ended = isotherm(home.path()).arg("report").arg(log).output().unwrap();
    let said = String::from_utf8_lossy(&ended.stdout).into_owned();
    assert!(said.contains("these values are in K (293 K = 20 °C)") && said.contains("`bed [K]`"), "{said}");
}

#[test]
fn a_report_that_cannot_be_written_says_where() {
    let home = tempfile::tempdir().unwrap();
    let mut command = isotherm(home.path());
    command
        .args(["select", "--error", "z_error_um", "--report", "/nowhere/out.html"])
        .args(days(home.path()));
    let ended = command.output().unwrap();
    assert_eq!(ended.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&ended.stderr).contains("cannot write /nowhere/out.html"));
}

/// Measures the reports at the width of a phone: their width, and their smallest letters.
#[test]
fn a_browser_shows_the_reports_as_wide_as_a_phone_with_legible_letters() {
    let home = tempfile::tempdir().unwrap();
    let pages = [
        ("identified", identified(home.path()).0),
        ("selected", selected(home.path()).0),
        ("drifted", drifted(home.path()).0),
    ];
    for (name, page) in pages {
        let escaped = page.replace('&', "&amp;").replace('"', "&quot;");
        let around = format!(
            r#"<!DOCTYPE html><meta charset="utf-8"><p id="said"></p>
<iframe id="phone" style="width:390px;height:800px;border:0" srcdoc="{escaped}"></iframe>
<script>
const phone = document.getElementById("phone");
phone.onload = () => {{
  const page = phone.contentDocument;
  const letters = [...page.querySelectorAll("svg text")].map(text =>
    parseFloat(text.getAttribute("font-size")) * text.getScreenCTM().a);
  const cut = [...page.querySelectorAll("svg text")].filter(text => {{
    const own = text.getBoundingClientRect(), whole = text.ownerSVGElement.getBoundingClientRect();
    return own.left < whole.left - 1 || own.right > whole.right + 1;
  }}).map(text => text.textContent);
  document.getElementById("said").textContent =
    `too wide by ${{page.documentElement.scrollWidth - page.documentElement.clientWidth}} smallest ${{Math.min(...letters).toFixed(1)}} `
    + `cut [${{cut}}] pictures ${{page.querySelectorAll("svg").length}} end`;
}};
</script>"#
        );
        let outer = file(home.path(), &format!("{name}.html"), &around);
        let look = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/look.py");
        let address = format!("file://{}", outer.display());
        let seen = Command::new("python3").arg(look).arg(address).args(["too wide by", "pictures"]).output();
        let seen = seen.unwrap_or_else(|error| panic!("no python3 ({error}): `tests/run page` installs it"));
        let said = String::from_utf8_lossy(&seen.stdout).into_owned();
        assert!(seen.status.success(), "{name}: {said}\n{}", String::from_utf8_lossy(&seen.stderr));
        assert!(said.contains("too wide by 0 "), "{name} is wider than a phone: {said}");
        let after = |word: &str| said.split_once(word).unwrap().1.trim_start();
        let smallest: f64 = after("smallest").split(' ').next().unwrap().parse().unwrap();
        assert!(smallest >= 9.5, "{name}: letters of {smallest} pixels: {said}");
        assert!(said.contains("cut []"), "{name}: letters beyond the edge of their picture: {said}");
        let pictures: u32 = after("pictures").split(' ').next().unwrap().parse().unwrap();
        assert!(pictures >= 8, "{name}: {said}");
    }
}
