//! Logs in which the error is measured less often than the temperatures, and single cells are missing.

use isotherm_identify::method::Settings;
use isotherm_identify::setup::ready;
use isotherm_identify::stand_in::frozen;
use isotherm_identify::{Identified, identify};

use super::rig::{self, Day, Machine, Part, dataset, found};
use super::speed;

/// Days with a row every ten seconds. s3 is similar to s0.
fn days() -> Vec<Day> {
    let parts =
        [Part { sensor: 0, gain: 3.0, constant: 1500.0 }, Part { sensor: 2, gain: -1.5, constant: 0.0 }];
    let machine = Machine { sensors: 4, parts: parts.to_vec(), step: 10.0, rows: 1800, noise: 0.0 };
    let mut days: Vec<Day> = (40..44).map(|seed| machine.day(seed)).collect();
    for day in &mut days {
        let wave = |row: usize| 0.05 * (row as f64 / 90.0).sin();
        day.temperatures[3] =
            day.temperatures[0].iter().enumerate().map(|(row, value)| 0.8 * value + wave(row)).collect();
    }
    days
}

fn once_a_minute(mut days: Vec<Day>) -> Vec<Day> {
    for day in &mut days {
        let rows = day.error.iter_mut().enumerate();
        rows.filter(|(row, _)| row % 6 != 3).for_each(|(_, error)| *error = f64::NAN);
    }
    days
}

fn logs(days: &[Day]) -> Vec<String> {
    days.iter().map(Day::log).collect()
}

/// Checks that the loss of each sensor has the same effect in both results.
#[track_caller]
fn alike(one: &Identified, other: &Identified) {
    assert_eq!((one.stand_ins.len(), other.stand_ins.len()), (4, 4));
    for (one, other) in one.stand_ins.iter().zip(&other.stand_ins) {
        let (range, again) = (one.means.mean_range_um, other.means.mean_range_um);
        let signal = &one.signal;
        assert!(range > 0.05 && (range - again).abs() < 0.15 * range, "{signal}: {range} µm and {again} µm");
    }
}

#[test]
fn an_error_that_is_measured_once_a_minute_judges_what_stands_in_as_one_in_every_row_does() {
    let (dense, seldom) = (logs(&days()), logs(&once_a_minute(days())));
    let settings = Settings::default();
    alike(&found(4, &dense, &settings), &found(4, &seldom, &settings));
    let costs = |logs: &[String]| -> Vec<f64> {
        let dataset = dataset(logs).unwrap();
        let ready = ready(&rig::profile(4), &dataset, &rig::choice()).unwrap();
        let found = identify(&ready, &settings, None, false, &|_, _| {}).unwrap();
        frozen(&ready, &found.held_out, 1).iter().map(|one| one.range_unnoticed).collect()
    };
    for (dense, seldom) in costs(&dense).iter().zip(costs(&seldom)) {
        assert!((dense - seldom).abs() < 0.15 * dense, "frozen: {dense} µm and {seldom} µm");
    }
}

#[test]
fn missing_cells_of_error_and_speed_do_not_shift_what_stands_in_against_what_was_held_out() {
    let days = speed::days(5);
    let whole: Vec<String> = days.iter().map(|day| speed::log(day, |_| false)).collect();
    let holes: Vec<String> = (days.iter().cloned())
        .map(|mut day| {
            (100..130).for_each(|row| day.day.error[row] = f64::NAN);
            speed::log(&day, |row| row % 50 == 7)
        })
        .collect();
    alike(&speed::found(&whole), &speed::found(&holes));
}
