//! Constant readings: at equilibrium, which is no fault, or frozen.
//!
//! The machine has five sensors with counts of 0.1 °C. Its days have spindle speeds in steps: a fast nose, a head and a
//! column that follow it, coolant, and the hall. Nothing is random.

use isotherm_identify::identify;
use isotherm_identify::method::Settings;
use isotherm_identify::setup::{Ready, ready};
use isotherm_profile::Profile;

use super::command;
use super::rig::{self, Day, dataset};

/// Rise of the nose at equilibrium in each spell, °C.
const LEVELS: [f64; 6] = [0.0, 9.0, 3.0, 12.0, 0.0, 6.0];
const MINUTES: usize = 480;
const HEAD: usize = 1;
const HALL: usize = 4;

/// Properties of a day.
#[derive(Clone, Copy)]
struct Plan {
    /// Number of the day. Each day has spells of other lengths.
    number: usize,
    /// Minute at which coolant comes on that is 5 °C colder, on a day without spindle speed.
    coolant: Option<usize>,
    /// Rows every 5 s instead of means of each minute.
    is_raw: bool,
}

/// Returns the temperature that the nose approaches.
fn level(plan: Plan, minute: usize) -> f64 {
    if plan.coolant.is_some() || minute < 20 {
        return 0.0;
    }
    LEVELS[((minute - 20) / (45 + 7 * plan.number) + plan.number) % 6]
}

fn day(plan: Plan) -> Day {
    // Share of the remaining difference that disappears in 5 s. The time constant is in minutes.
    let gone = |minutes: f64| 1.0 - (-5.0 / (60.0 * minutes)).exp();
    let (mut nose, mut head, mut column, mut coolant, mut bent) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let mut day = Day { times: Vec::new(), temperatures: vec![Vec::new(); 5], error: Vec::new() };
    let is_resting = plan.coolant.is_some();
    for minute in 0..MINUTES {
        let mut sums = [0.0; 5];
        let error = |bent: f64, head: f64| 1.5 * bent + 4.0 * head + 0.1 * (minute as f64).sin();
        for part in 0..12 {
            let cold = if plan.coolant.is_some_and(|from| minute >= from) { -5.0 } else { 0.0 };
            let wanted = if is_resting { cold } else { 0.15 * head };
            coolant += gone(3.0) * (wanted - coolant);
            let chilled = if is_resting { 0.5 * coolant } else { 0.0 };
            nose += gone(9.0) * (level(plan, minute) + chilled - nose);
            head += gone(50.0) * (0.4 * nose - head);
            column += gone(200.0) * (0.5 * head - column);
            bent += gone(20.0) * (nose - bent);
            let hours = (minute as f64 + f64::from(part) / 12.0) / 130.0;
            let hall = if is_resting { 0.0 } else { 0.4 * (hours + plan.number as f64).sin() };
            let counts = [nose, head, column, coolant, hall].map(|rise: f64| (10.0 * (20.0 + rise)).round());
            let readings = counts.map(|counts| counts / 10.0);
            sums.iter_mut().zip(readings).for_each(|(sum, reading)| *sum += reading);
            if plan.is_raw {
                day.times.push(60.0 * minute as f64 + 5.0 * f64::from(part));
                day.temperatures.iter_mut().zip(readings).for_each(|(sensor, reading)| sensor.push(reading));
                day.error.push(error(bent, head));
            }
        }
        if !plan.is_raw {
            day.times.push(60.0 * minute as f64);
            day.temperatures.iter_mut().zip(sums).for_each(|(sensor, sum)| sensor.push(sum / 12.0));
            day.error.push(error(bent, head));
        }
    }
    day
}

fn days(count: usize) -> Vec<Day> {
    (0..count).map(|number| day(Plan { number, coolant: None, is_raw: false })).collect()
}

/// Freezes the head from the first of these minutes to before the second.
fn freeze_head(day: &mut Day, from: usize, to: usize) {
    let stays = day.temperatures[HEAD][from];
    day.temperatures[HEAD][from..to].fill(stays);
}

/// Profile with signals in whole counts of 0.1 °C.
fn profile_text() -> String {
    let fine = "type = \"f32\"\nword_order = \"msw-first\"\nunit";
    rig::profile_with(5, rig::NO_MODEL).replace(fine, "type = \"i16\"\nscale = 0.1\nunit")
}

fn profile() -> Profile {
    rig::parsed(std::path::Path::new("bench.toml"), &profile_text())
}

fn logs(days: &[Day]) -> Vec<String> {
    days.iter().map(Day::log).collect()
}

/// Returns the findings about the sensors of these days: those of sensors left out, and those of repaired ones.
fn findings(days: &[Day]) -> (Vec<String>, Vec<String>) {
    let dataset = dataset(&logs(days)).unwrap();
    let Ready { notes, repaired, .. } = ready(&profile(), &dataset, &rig::choice()).unwrap();
    let excluded = notes.excluded.iter().map(|own| format!("{} {}", own.signal, own.reason));
    let mended =
        repaired.iter().map(|own| format!("{} {} in {}: {}", own.signal, own.fault, own.run, own.done));
    (excluded.collect(), mended.collect())
}

fn nothing() -> (Vec<String>, Vec<String>) {
    (Vec::new(), Vec::new())
}

#[test]
fn sensors_at_equilibrium_are_not_frozen_in_a_log_of_means_in_which_they_leave_it_by_many_counts() {
    let days = days(5);
    let nose = &days[1].temperatures[0];
    let is_still = |five: &&[f64]| five.iter().all(|value| value.to_bits() == five[0].to_bits());
    assert!(nose.windows(5).filter(is_still).count() > 10, "it stands still");
    assert!(nose.windows(2).any(|two| (two[1] - two[0]).abs() > 1.0), "and moves by ten counts in a minute");
    assert_eq!(findings(&days), nothing());
}

#[test]
fn nor_are_they_in_raw_rows_of_three_days() {
    let days: Vec<Day> = (0..3).map(|number| day(Plan { number, coolant: None, is_raw: true })).collect();
    assert_eq!(findings(&days), nothing());
}

#[test]
fn a_day_of_rest_with_coolant_at_its_end_freezes_no_sensor() {
    for minute in [300, 440] {
        let mut days = days(4);
        days.push(day(Plan { number: 9, coolant: Some(minute), is_raw: false }));
        assert_eq!(findings(&days), nothing(), "coolant at minute {minute}");
    }
}

#[test]
fn a_hall_that_is_calm_for_hours_is_not_frozen_as_no_other_sensor_says_much_of_it() {
    let mut days = days(5);
    let calm = days[3].temperatures[HALL][100];
    days[3].temperatures[HALL][100..].fill(calm);
    assert_eq!(findings(&days), nothing());
}

#[test]
fn a_sensor_that_is_dead_to_the_end_is_named_and_its_rows_are_masked() {
    let mut days = days(5);
    freeze_head(&mut days[2], 300, MINUTES);
    let (excluded, mended) = findings(&days);
    assert_eq!(excluded, Vec::<String>::new());
    let [mended] = mended.as_slice() else { panic!("{mended:?}") };
    assert!(mended.starts_with("s1 frozen from 4:58 h to the end while"), "{mended}");
    assert!(mended.contains("in day2: these rows were masked"), "{mended}");
}

#[test]
fn a_sensor_that_thaws_is_named_once_though_it_jumps_then() {
    let mut days = days(5);
    freeze_head(&mut days[2], 40, 140);
    let thaw = days[2].temperatures[HEAD][140] - days[2].temperatures[HEAD][139];
    assert!(thaw > 3.0, "a casting does not do that: {thaw}");
    let (excluded, mended) = findings(&days);
    assert_eq!(excluded, Vec::<String>::new());
    let [mended] = mended.as_slice() else { panic!("{mended:?}") };
    assert!(mended.starts_with("s1 frozen from 0:40 h to 2:19 h while"), "{mended}");
}

#[test]
fn a_masked_sensor_costs_the_other_days_little_and_is_not_judged_by_its_masked_rows() {
    let clean = days(5);
    let mut spoilt = clean.clone();
    freeze_head(&mut spoilt[2], 300, MINUTES);
    let found = |days: &[Day]| {
        let dataset = dataset(&logs(days)).unwrap();
        let ready = ready(&profile(), &dataset, &rig::choice()).unwrap();
        identify(&ready, &Settings::default(), None, false, &|_, _| {}).unwrap()
    };
    let (clean, spoilt) = (found(&clean), found(&spoilt));
    let rows = |run: usize| spoilt.held_out[run].seconds.len();
    assert_eq!((rows(1), rows(2)), (MINUTES, 299), "the first row with the number is true");
    for run in [0, 1, 3, 4] {
        let (left, before) = (spoilt.runs[run].rmse_um, clean.runs[run].rmse_um);
        assert!(left < 1.5 * before + 0.1, "day{run}: {left} µm, clean {before} µm");
    }
}

#[test]
fn a_sensor_that_is_frozen_for_more_than_a_quarter_of_the_time_is_left_out_and_what_that_costs_is_said() {
    let mut days = days(5);
    for run in [0, 2] {
        freeze_head(&mut days[run], 0, MINUTES);
    }
    let (excluded, mended) = findings(&days);
    assert_eq!(mended, Vec::<String>::new());
    assert_eq!(excluded.len(), 2, "{excluded:?}");
    let words = "frozen for 40 % of the time of all runs in total";
    assert!(excluded.iter().all(|reason| reason.contains(words)), "{excluded:?}");
    let dataset = dataset(&logs(&days)).unwrap();
    let ready = ready(&profile(), &dataset, &rig::choice()).unwrap();
    let [omission] = ready.notes.omissions.as_slice() else { panic!("{:?}", ready.notes.omissions) };
    assert!(omission.signal == "s1" && omission.with_um > 0.0 && omission.without_um > 0.0, "{omission:?}");
    let home = tempfile::tempdir().unwrap();
    let (said, is_good) = command::identify(home.path(), &profile_text(), &logs(&days), &[]);
    assert!(is_good, "{said}");
    assert!(said.contains("s1: error of held-out runs"), "{said}");
}
