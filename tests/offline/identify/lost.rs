//! Substitutes for lost sensors, and sensors without a substitute.

use std::collections::BTreeSet;

use isotherm_core::compensation::model::Outside;
use isotherm_identify::identify;
use isotherm_identify::method::Settings;
use isotherm_identify::setup::{Choice, ready};
use isotherm_identify::written::written;

use super::rig::{self, Day, Machine, Part, dataset, found};
use super::whitened::{alike, days, logs};

#[test]
fn a_probe_makes_no_sensor_irreplaceable() {
    let dataset = dataset(&alike(5)).unwrap();
    let ready = ready(&rig::profile(4), &dataset, &rig::choice()).unwrap();
    let of = |probe| identify(&ready, &Settings::default(), probe, true, &|_, _| {}).unwrap();
    let (without, with) = (of(None), of(Some(3600.0)));
    assert!(with.means.mean_range_um < without.means.mean_range_um);
    assert_eq!(with.irreplaceable, without.irreplaceable);
    assert_eq!(with.irreplaceable, ["s2"]);
}

#[test]
fn the_only_sensor_of_a_machine_is_irreplaceable() {
    let parts = [Part { sensor: 0, gain: 3.0, constant: 900.0 }];
    let machine = Machine { sensors: 1, parts: parts.to_vec(), step: 60.0, rows: 300, noise: 0.1 };
    let logs: Vec<String> = (0..3).map(|seed| machine.day(seed).log()).collect();
    assert_eq!(found(1, &logs, &Settings::default()).irreplaceable, ["s0"]);
}

#[test]
fn what_is_written_of_a_model_of_few_sensors_needs_no_other_one() {
    let settings = Settings { sensors: Some(3), ..Settings::default() };
    let found = found(4, &alike(5), &settings);
    let own: BTreeSet<&str> = found.terms.iter().map(|term| term.signal.as_str()).collect();
    assert_eq!(own.len(), 3, "{own:?}");
    let block = written(&found, "z", Outside::Agree);
    assert!(block.files.iter().any(|(name, _)| name == "z.stand-ins.json"));
    for (name, text) in block.files.iter().chain([&("the block".to_owned(), block.block.clone())]) {
        for sensor in (0..4).map(|place| format!("s{place}")) {
            let is_named = text.contains(&format!("\"{sensor}\""));
            assert!(!is_named || own.contains(sensor.as_str()), "{name} needs {sensor}: {text}");
        }
    }
    rig::pasted(&rig::profile_with(4, &block.block), &block.files);
}

/// Days in which s1 is similar to s0. In the third day, s0 is constant for 30 minutes from each of these rows on.
fn frozen(count: u64, at: &[usize]) -> Vec<Day> {
    let mut all = days(count, 23, 0.2);
    for day in &mut all {
        let wave = |row: usize| 0.02 * (row as f64 / 7.0).sin();
        day.temperatures[1] =
            day.temperatures[0].iter().enumerate().map(|(row, value)| 0.8 * value + wave(row)).collect();
    }
    for at in at {
        let stays = all[2].temperatures[0][*at];
        all[2].temperatures[0][*at..at + 30].fill(stays);
    }
    all
}

/// Two rows of a day at which the sensor changes most, at least an hour apart.
fn lively(day: &Day) -> [usize; 2] {
    let rows = &day.temperatures[0];
    let moves = |at: usize| (rows[at + 30] - rows[at]).abs();
    let mut places: Vec<usize> = (20..rows.len() - 40).collect();
    places.sort_by(|one, other| moves(*other).total_cmp(&moves(*one)));
    let second = places.iter().find(|place| place.abs_diff(places[0]) > 60).unwrap();
    [places[0], *second]
}

#[test]
fn each_stretch_in_which_a_sensor_stood_still_is_mended_and_one_that_is_kept_is_told() {
    let at = lively(&frozen(6, &[])[2]);
    let dataset = dataset(&logs(&frozen(6, &at))).unwrap();
    let ready_with = |choice: &Choice| ready(&rig::profile(4), &dataset, choice).unwrap();
    let mended = ready_with(&rig::choice()).repaired;
    let frozen: Vec<&str> =
        mended.iter().filter(|own| own.signal == "s0").map(|own| own.fault.as_str()).collect();
    assert_eq!(frozen.len(), 2, "{mended:?}");
    assert!(frozen.iter().all(|fault| fault.starts_with("frozen from ")), "{frozen:?}");
    let kept = ready_with(&Choice { keep: vec!["s0".to_owned()], ..rig::choice() });
    assert_eq!(kept.repaired, []);
    let reported =
        kept.notes.remarks.iter().filter(|remark| {
            remark.starts_with("s0 is used as requested, although it was found faulty: frozen")
        });
    assert_eq!(reported.count(), 2, "{:?}", kept.notes.remarks);
}

#[test]
fn of_fewer_than_four_runs_it_is_told_that_nothing_was_tested_for_standing_still() {
    let remarks = |count: u64| {
        let dataset = dataset(&logs(&days(count, 23, 0.2))).unwrap();
        ready(&rig::profile(4), &dataset, &rig::choice()).unwrap().notes.remarks.join("; ")
    };
    assert!(remarks(3).contains("there are fewer than four runs"), "{}", remarks(3));
    assert!(!remarks(4).contains("there are fewer than four runs"), "{}", remarks(4));
}
