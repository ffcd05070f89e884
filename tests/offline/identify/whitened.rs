//! Method `whitened` on simulated machines with known parameters.

use std::time::Duration;

use isotherm_core::compensation::model::Outside;
use isotherm_identify::method::{Method, Settings};
use isotherm_identify::setup::{Choice, ready};
use isotherm_identify::stand_in::{Frozen, frozen};
use isotherm_identify::written::written;
use isotherm_identify::{Identified, identify};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::rig::{self, Day, Machine, Part, dataset, found};

/// Machine with four sensors. Two of them affect the error, one of them with a lag.
fn machine() -> Machine {
    let parts =
        [Part { sensor: 0, gain: 3.0, constant: 1500.0 }, Part { sensor: 2, gain: -1.5, constant: 0.0 }];
    Machine { sensors: 4, parts: parts.to_vec(), step: 60.0, rows: 420, noise: 0.1 }
}

/// Adds a random walk with this variance in µm² per hour, which no temperature explains.
fn with_walk(mut day: Day, seed: u64, per_hour: f64) -> Day {
    let mut chance = Pcg64Mcg::seed_from_u64(7_000 + seed);
    let mut normal = || (0..12).map(|_| chance.random_range(-0.5..0.5)).sum::<f64>();
    let step = (per_hour * (day.times[1] - day.times[0]) / 3600.0).sqrt();
    let mut walk = 0.0;
    for error in &mut day.error {
        walk += step * normal();
        *error += walk;
    }
    day
}

pub(crate) fn days(count: u64, seed: u64, per_hour: f64) -> Vec<Day> {
    (0..count).map(|day| with_walk(machine().day(100 * seed + day), 100 * seed + day, per_hour)).collect()
}

pub(crate) fn logs(days: &[Day]) -> Vec<String> {
    days.iter().map(Day::log).collect()
}

fn by(method: Method) -> Settings {
    Settings { method, ..Settings::default() }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn where_what_is_left_walks_whitened_rows_leave_less_than_minute_rows_do() {
    let left = |method: Method| {
        let each = (0..6).map(|seed| found(4, &logs(&days(5, seed, 4.0)), &by(method)).means.mean_rmse_um);
        mean(&each.collect::<Vec<f64>>())
    };
    let (whitened, ridge, sparse) = (left(Method::Whitened), left(Method::RidgeLag), left(Method::SparseLag));
    assert!(whitened < 0.95 * ridge && whitened < 0.95 * sparse, "{whitened} {ridge} {sparse}");
}

#[test]
fn one_run_is_learnt_from_with_seven_tenths_and_told_what_that_is_worth() {
    let day = logs(&days(1, 3, 0.0));
    let alone = found(4, &day, &Settings::default());
    // Two logs with the same rows are refused.
    let mut repeated = dataset(&day).unwrap();
    repeated.runs.push(repeated.runs[0].clone());
    let both = ready(&rig::profile(4), &repeated, &rig::choice()).unwrap();
    let twice = identify(&both, &Settings::default(), None, true, &|_, _| {}).unwrap();
    for (one, both) in alone.terms.iter().zip(&twice.terms) {
        // The same run twice has the same products. Therefore the ridge differs only by the factor for one run.
        assert!((one.gain - 0.7 * both.gain).abs() < 1e-9, "{one:?} {both:?}");
    }
    let says_nothing = |found: &Identified| found.terms.iter().all(|term| term.se.is_none());
    assert!(says_nothing(&alone) && says_nothing(&twice), "too few runs for a standard error");
    assert!(alone.runs.is_empty() && alone.expected.is_none() && alone.means.mean_range_um.is_nan());
    let reported =
        |found: &Identified, word: &str| found.notes.remarks.iter().any(|remark| remark.contains(word));
    assert!(reported(&alone, "no run could be held out"), "{:?}", alone.notes.remarks);
    assert!(reported(&alone, "One in four such models made a later run worse"));
    assert!(reported(&twice, "Record a third day"));
    assert!(!reported(&found(4, &logs(&days(3, 3, 0.0)), &Settings::default()), "Record"));
}

#[test]
fn the_block_names_its_halves_its_stand_ins_and_what_to_expect_and_a_profile_takes_them() {
    let found = found(4, &logs(&days(4, 11, 1.0)), &Settings::default());
    let block = written(&found, "z", Outside::Agree);
    let files: Vec<&str> = block.files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(files[..3], ["z.halves.json", "z.stand-ins.json", "z.envelope.json"], "{files:?}");
    for key in
        ["halves = \"z.halves.json\"", "stand_ins = \"z.stand-ins.json\"", "expected = { since_datum = ["]
    {
        assert!(block.block.contains(key), "{}", block.block);
    }
    rig::pasted(&rig::profile_with(4, &block.block), &block.files);
    for (name, content) in &block.files {
        let key = name.split('.').rev().nth(1).unwrap_or_default().replace('-', "_");
        let seal = format!("sha256.{key} = \"{}\"", isotherm_profile::sha256(content.as_bytes()));
        assert!(block.block.contains(&seal), "{seal} is not in\n{}", block.block);
    }
}

#[test]
fn what_follows_its_halves_outside_is_the_model_that_has_some_and_any_other_says_that_it_warns() {
    let outside = |count: u64, wanted: Outside| -> Vec<String> {
        let block = written(&found(4, &logs(&days(count, 11, 1.0)), &Settings::default()), "z", wanted);
        rig::pasted(&rig::profile_with(4, &block.block), &block.files);
        let lines = block.block.lines().filter_map(|line| line.strip_prefix("outside = "));
        lines.map(str::to_owned).collect()
    };
    assert!(outside(1, Outside::Agree).iter().all(|word| word == "\"warn\""));
    let four = outside(4, Outside::Agree);
    assert_eq!(four[0], "\"agree\"");
    assert!(four[1..].iter().all(|word| word == "\"warn\""), "{four:?}");
    assert!(outside(4, Outside::Hold).iter().all(|word| word == "\"hold\""));
}

#[test]
fn a_model_without_an_envelope_has_no_halves_and_lags_without_none_have_both() {
    let lags = [6, 25].map(|minutes| Some(Duration::from_mins(minutes))).to_vec();
    let mut found = found(4, &logs(&days(4, 11, 1.0)), &Settings { lags, ..Settings::default() });
    let late = written(&found, "z", Outside::Agree);
    assert!(late.block.contains("envelope = ") && late.block.contains("halves = "), "{}", late.block);
    rig::pasted(&rig::profile_with(4, &late.block), &late.files);
    found.region = None;
    let bare = written(&found, "z", Outside::Agree);
    assert!(bare.files.iter().all(|(name, _)| name != "z.halves.json"), "{}", bare.block);
    rig::pasted(&rig::profile_with(4, &bare.block), &bare.files);
}

#[test]
fn where_no_term_comes_to_half_a_count_that_is_told_and_no_model_is_written() {
    let coarse = rig::profile_with(4, rig::NO_MODEL).replace("scale = 0.001", "scale = 200.0");
    let profile = rig::parsed(std::path::Path::new("bench.toml"), &coarse);
    let dataset = dataset(&logs(&days(3, 11, 1.0))).unwrap();
    let ready = ready(&profile, &dataset, &rig::choice()).unwrap();
    let found = identify(&ready, &Settings::default(), None, true, &|_, _| {}).unwrap();
    assert_eq!(found.terms, []);
    let reported = found.notes.remarks.join("; ");
    assert!(reported.contains("Cz is smaller than half a count of the register"), "{reported}");
    let block = written(&found, "z", Outside::Agree);
    assert!(block.files.is_empty() && block.block.lines().all(|line| line.starts_with('#')), "{block:?}");
}

#[test]
fn what_to_expect_is_not_known_from_models_of_one_run() {
    assert_eq!(found(4, &logs(&days(2, 13, 4.0)), &Settings::default()).expected, None);
}

#[test]
fn what_to_expect_grows_as_the_walk_does_and_holds_two_rows_of_three() {
    let found = found(4, &logs(&days(12, 13, 4.0)), &Settings::default());
    let [a, b] = found.expected.unwrap().since_datum;
    assert!((2.0..9.0).contains(&(a + b)), "4 µm² after an hour, and what the model adds: {a} {b}");
    let inside: Vec<f64> = found.runs.iter().map(|run| run.expected_um.unwrap().inside_1).collect();
    assert!((0.5..0.85).contains(&mean(&inside)), "{inside:?}");
    let inside: Vec<f64> = found.runs.iter().map(|run| run.expected_um.unwrap().inside_2).collect();
    assert!(mean(&inside) > 0.85, "{inside:?}");
    assert!((2.0..8.0).contains(&found.probe_q.unwrap()), "{:?}", found.probe_q);
}

#[test]
fn few_sensors_are_those_that_count() {
    let settings = Settings { sensors: Some(2), ..Settings::default() };
    let found = found(4, &logs(&days(5, 17, 0.2)), &settings);
    let mut sensors: Vec<&str> = found.terms.iter().map(|term| term.signal.as_str()).collect();
    sensors.sort_unstable();
    sensors.dedup();
    assert_eq!(sensors, ["s0", "s2"]);
    let ranges: Vec<f64> = found.by_sensors.iter().map(|row| row.means.mean_range_um).collect();
    assert_eq!(ranges.len(), 5, "none to four");
    assert!(ranges[2] < ranges[1] && ranges[1] < ranges[0], "{ranges:?}");
}

/// Days in which s1 and s3 measure the same source as s0, and s2 another one.
pub(crate) fn alike(count: u64) -> Vec<String> {
    let mut all = days(count, 19, 0.2);
    for (place, day) in all.iter_mut().enumerate() {
        let mut chance = Pcg64Mcg::seed_from_u64(place as u64);
        day.temperatures[1] =
            day.temperatures[0].iter().map(|value| 0.8 * value + chance.random_range(-0.01..0.01)).collect();
        day.temperatures[3] =
            day.temperatures[0].iter().map(|value| 1.1 * value + chance.random_range(-0.01..0.01)).collect();
    }
    logs(&all)
}

#[test]
fn a_sensor_that_others_resemble_is_stood_in_for_and_one_of_which_none_tells_is_named() {
    let found = found(4, &alike(5), &Settings::default());
    let of = |signal: &str| found.stand_ins.iter().find(|own| own.signal == signal).unwrap();
    assert!(
        of("s0").stands_in && of("s0").means.mean_range_um < 1.2 * found.means.mean_range_um,
        "{:?}",
        of("s0")
    );
    assert!(found.irreplaceable.contains(&"s2".to_owned()), "{:?}", found.irreplaceable);
    assert!(!found.irreplaceable.contains(&"s0".to_owned()), "{:?}", found.irreplaceable);
    assert!(
        found.fallbacks.iter().all(|fallback| found
            .stand_ins
            .iter()
            .any(|own| own.signal == fallback.without && !own.stands_in))
    );
}

#[test]
fn a_frozen_sensor_is_noticed_and_costs_little_where_others_resemble_it_and_a_good_one_gives_no_alarm() {
    let logs = alike(6);
    let dataset = dataset(&logs).unwrap();
    let ready = ready(&rig::profile(4), &dataset, &rig::choice()).unwrap();
    let found = identify(&ready, &Settings::default(), None, false, &|_, _| {}).unwrap();
    let all: Vec<Frozen> = (0..3).flat_map(|seed| frozen(&ready, &found.held_out, seed)).collect();
    // Beyond a range no stand-in follows its sensor.
    let own: Vec<&Frozen> = all.iter().filter(|one| one.signal == "s0" && one.inside).collect();
    assert!(own.len() >= 4, "{} of {}", own.len(), all.len());
    let growth =
        |of: fn(&Frozen) -> f64| mean(&own.iter().map(|one| of(one) / one.range.1).collect::<Vec<f64>>());
    let (reported, unreported) = (growth(|one| one.range.0), growth(|one| one.range_unnoticed));
    assert!(reported < 1.05 && unreported > 1.2, "{reported} {unreported}");
    assert!(!all.iter().any(|one| one.false_alarm));
}

#[test]
fn the_other_methods_need_a_second_run() {
    let dataset = dataset(&logs(&days(1, 3, 0.0))).unwrap();
    let ready =
        ready(&rig::profile(4), &dataset, &Choice { resample: Duration::from_secs(60), ..Choice::default() })
            .unwrap();
    let why = identify(&ready, &by(Method::Ols), None, false, &|_, _| {}).unwrap_err();
    assert!(why.contains("there is only one run, day0") && why.contains("Record another day"), "{why}");
}

#[test]
fn a_sensor_that_froze_for_forty_minutes_of_one_training_run_is_found_and_mended() {
    let mut all = days(6, 23, 0.2);
    let mut chance = Pcg64Mcg::seed_from_u64(5);
    for day in &mut all {
        day.temperatures[1] =
            day.temperatures[0].iter().map(|value| 0.8 * value + chance.random_range(-0.01..0.01)).collect();
    }
    let rows = &mut all[2].temperatures[0];
    let moved = (20..rows.len() - 40).max_by(|one, other| {
        let moves = |at: &usize| (rows[at + 40] - rows[*at]).abs();
        moves(one).total_cmp(&moves(other))
    });
    let at = moved.unwrap();
    assert!((rows[at + 40] - rows[at]).abs() > 1.0, "it moves while it is frozen");
    let stays = rows[at];
    rows[at..at + 40].fill(stays);
    let found = found(4, &logs(&all), &Settings::default());
    let repaired: Vec<(&str, &str)> =
        found.repaired.iter().map(|mended| (mended.signal.as_str(), mended.run.as_str())).collect();
    assert_eq!(repaired, [("s0", "day2")], "{:?} {:?}", found.repaired, found.notes.excluded);
    assert!(found.repaired[0].fault.starts_with("frozen from "), "{:?}", found.repaired);
}
