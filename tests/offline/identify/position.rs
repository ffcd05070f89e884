//! Errors measured at several positions, on simulated machines with known constant part and slope.

use std::path::Path;
use std::time::Duration;

use isotherm::cli::replay::replay;
use isotherm_core::compensation::model::Outside;
use isotherm_identify::Identified;
use isotherm_identify::identified::TermFound;
use isotherm_identify::identify;
use isotherm_identify::method::{Method, Settings};
use isotherm_identify::setup::{Choice, ready};
use isotherm_identify::written::written;
use isotherm_profile::Profile;

use super::rig::{self, Machine, NO_MODEL, Part, dataset, profile_with};

/// Slope in µm per mm and °C, and constant part in µm per °C. The time constant is one of the bank.
const SLOPE: [Part; 1] = [Part { sensor: 0, gain: 0.012, constant: 1500.0 }];
const LEVEL: [Part; 1] = [Part { sensor: 1, gain: -2.5, constant: 0.0 }];
/// Position at which the slope has no effect, mm.
const REFERENCE: f64 = -20.0;

fn machine(parts: &[Part], noise: f64) -> Machine {
    Machine { sensors: 3, parts: parts.to_vec(), step: 60.0, rows: 480, noise }
}

/// Days with the error level + slope · (z − reference), plus a constant error `cold` of each position, and with the
/// column z.
fn days(count: u64, noise: f64, place: impl Fn(usize) -> f64, cold: impl Fn(f64) -> f64) -> Vec<String> {
    let day = |seed: u64| {
        // The same seed gives the same temperatures. The error of this day is the slope alone, µm per mm.
        let slope = machine(&SLOPE, 0.0).day(seed).error;
        let mut day = machine(&LEVEL, noise).day(seed);
        for (row, (error, slope)) in day.error.iter_mut().zip(slope).enumerate() {
            *error += slope * (place(row) - REFERENCE) + cold(place(row));
        }
        let log = day.log();
        let mut lines = log.lines();
        let header = lines.next().unwrap();
        let rows = lines.enumerate().map(|(row, line)| format!("{line},{}\n", place(row)));
        format!("{header},scale_z\n") + &rows.collect::<String>()
    };
    (0..count).map(day).collect()
}

fn four_places(row: usize) -> f64 {
    -100.0 * (row % 4) as f64
}

fn with_scale(model: &str) -> String {
    profile_with(3, model)
        + "[signal.scale_z]\ndevice = \"m\"\nregister = \"input:20\"\ntype = \"f32\"\nword_order = \"msw-first\"\n\
           unit = \"mm\"\nmax_age = \"5s\"\n"
}

fn profile() -> Profile {
    rig::parsed(Path::new("bench.toml"), &with_scale(NO_MODEL))
}

fn choice() -> Choice {
    Choice {
        inputs: ["s0", "s1", "s2"].map(str::to_owned).to_vec(),
        position: Some(("scale_z".to_owned(), REFERENCE)),
        ..rig::choice()
    }
}

fn by_position() -> Settings {
    Settings { method: Method::Position, ..Settings::default() }
}

fn found(days: &[String], settings: &Settings) -> Result<Identified, String> {
    let dataset = dataset(days).unwrap();
    let ready = ready(&profile(), &dataset, &choice()).unwrap();
    identify(&ready, settings, None, true, &|_, _| {})
}

/// Sum of the gains of a sensor over its lags.
fn gain(terms: &[TermFound], signal: &str, slope: bool) -> f64 {
    terms.iter().filter(|term| term.signal == signal && term.slope == slope).map(|term| term.gain).sum()
}

fn assert_true(found: &Identified, what: &str) {
    let (slope, level) = (gain(&found.terms, "s0", true), gain(&found.terms, "s1", false));
    assert!((slope + 0.012).abs() < 0.0004, "{what}: slope {slope}: {:?}", found.terms);
    assert!((level - 2.5).abs() < 0.08, "{what}: level {level}: {:?}", found.terms);
}

#[test]
fn a_slope_that_lags_and_a_level_that_does_not_are_found_with_the_sign_of_cz() {
    let found = found(&days(5, 0.1, four_places, |_| 0.0), &by_position()).unwrap();
    assert_true(&found, "four places");
    let largest =
        found.terms.iter().filter(|term| term.slope).max_by(|a, b| a.gain.abs().total_cmp(&b.gain.abs()));
    let largest = largest.unwrap();
    assert_eq!((largest.signal.as_str(), largest.lag_s), ("s0", 1500.0), "{:?}", found.terms);
    assert!(largest.se.is_some_and(|se| se > 0.0 && se < 0.001), "{largest:?}");
    assert!(found.means.worst_range_um < 1.5 && found.uncompensated.mean_range_um > 15.0, "{:?}", found.runs);
}

#[test]
fn what_is_wrong_with_a_scale_from_the_start_is_no_drift() {
    let pitch = |place: f64| 15.0 * (place / 70.0).sin();
    let found = found(&days(5, 0.1, four_places, pitch), &by_position()).unwrap();
    assert_true(&found, "with an error of pitch");
    assert!(found.means.worst_range_um < 1.5, "{:?}", found.runs);
}

#[test]
fn a_place_first_visited_when_the_machine_is_warm_counts_from_there_with_its_temperatures() {
    // The far half of the travel is reached after an hour and a half.
    let late = |row: usize| if row < 90 { -100.0 * (row % 2) as f64 } else { four_places(row) };
    let pitch = |place: f64| 0.1 * place;
    let found = found(&days(5, 0.05, late, pitch), &by_position()).unwrap();
    assert_true(&found, "late places");
    assert!(found.means.worst_range_um < 1.5, "{:?}", found.runs);
}

#[test]
fn lags_leave_a_third_and_with_two_terms_they_are_the_two_that_the_days_were_made_of() {
    let days = days(5, 0.1, four_places, |_| 0.0);
    let at_once = Settings { lags: vec![None], ..by_position() };
    let (plain, lagged) = (found(&days, &at_once).unwrap(), found(&days, &by_position()).unwrap());
    assert!(
        lagged.means.mean_range_um < 0.3 * plain.means.mean_range_um,
        "{} {}",
        lagged.means.mean_range_um,
        plain.means.mean_range_um
    );
    let two = found(&days, &Settings { terms: Some(2), ..by_position() }).unwrap();
    let chosen: Vec<(&str, bool)> = two.terms.iter().map(|term| (term.signal.as_str(), term.slope)).collect();
    assert_eq!(chosen, [("s1", false), ("s0", true)]);
    // Before the slope is selected, a lag of three minutes fits as well as none.
    assert!(two.terms[0].lag_s <= 180.0 && (two.terms[1].lag_s - 1500.0).abs() < 1e-9, "{:?}", two.terms);
    assert_true(&two, "two terms");
}

#[test]
fn the_block_with_its_slope_replayed_over_a_day_it_never_saw_leaves_what_cross_validation_left() {
    let days = days(5, 0.2, four_places, |_| 0.0);
    let validated = found(&days, &by_position()).unwrap();
    let learnt = found(&days[..4], &by_position()).unwrap();
    let block = written(&learnt, "z", Outside::Warn);
    assert!(block.block.contains("slope = { position = \"scale_z\", reference = -20.0, terms = ["));
    let directory = tempfile::tempdir().unwrap();
    for (name, text) in &block.files {
        std::fs::write(directory.path().join(name), text).unwrap();
    }
    let pasted = directory.path().join("pasted.toml");
    std::fs::write(&pasted, with_scale(&block.block)).unwrap();
    let pasted = isotherm_profile::load(&pasted, &[], &[]).unwrap_or_else(|errors| panic!("{errors}"));
    let mut out = Vec::new();
    replay(&pasted.profile, days[4].as_bytes(), "day4.csv", Some(&mut out)).unwrap();
    let mut table = csv::Reader::from_reader(out.as_slice());
    let header = table.headers().unwrap().clone();
    let at = |name: &str| header.iter().position(|column| column == name).unwrap();
    let (time, raw) = (at("time"), at("z_raw_um"));
    let replayed: Vec<(f64, f64)> = table
        .records()
        .map(Result::unwrap)
        .filter(|row| !row[raw].is_empty())
        .map(|row| (row[time].parse().unwrap(), row[raw].parse().unwrap()))
        .collect();
    let held = &validated.held_out[4];
    let residual = held.residual(None);
    let (mut worst, mut rows) = (0.0_f64, 0);
    for (row, second) in held.seconds.iter().enumerate() {
        let Some((_, cz)) = replayed.iter().find(|(time, _)| (time - second).abs() < 1e-6) else { continue };
        worst = worst.max((held.error[row] + cz - residual[row]).abs());
        rows += 1;
    }
    assert!(worst < 1e-6 && rows > 470, "{worst} µm over {rows} rows");
}

#[test]
fn what_cannot_carry_a_slope_is_reported_with_what_to_do() {
    let still = found(&days(3, 0.1, |_| -100.0, |_| 0.0), &by_position()).unwrap_err();
    assert!(still.contains("scale_z is constant"), "{still}");
    let once = found(&days(3, 0.1, |row| -(row as f64), |_| 0.0), &by_position()).unwrap_err();
    assert!(once.contains("rarely returns to an earlier position") && once.contains("repeatedly"), "{once}");
    let days = days(3, 0.1, four_places, |_| 0.0);
    let dataset = dataset(&days).unwrap();
    let nowhere = Choice { position: None, resample: Duration::from_secs(60), ..choice() };
    let ready = ready(&profile(), &dataset, &nowhere).unwrap();
    let nowhere = identify(&ready, &by_position(), None, true, &|_, _| {}).unwrap_err();
    assert!(nowhere.contains("--position scale_z"), "{nowhere}");
}
