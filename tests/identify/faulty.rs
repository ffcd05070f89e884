use isotherm::identify::method::Settings;

use super::rig::{Day, Machine, Part, dataset, found, profile};
use isotherm::identify::setup::ready;

fn machine() -> Machine {
    let parts =
        [Part { sensor: 0, gain: 3.0, constant: 1500.0 }, Part { sensor: 1, gain: -2.0, constant: 0.0 }];
    Machine { sensors: 5, parts: parts.to_vec(), step: 60.0, rows: 600, noise: 0.3 }
}

fn days() -> Vec<Day> {
    (20..25).map(|seed| machine().day(seed)).collect()
}

fn reasons(days: &[Day]) -> Vec<(String, String)> {
    let logs: Vec<String> = days.iter().map(Day::log).collect();
    let dataset = dataset(&logs).unwrap();
    let ready = ready(&profile(5), &dataset, &super::rig::choice()).unwrap();
    ready.excluded.into_iter().map(|faulty| (faulty.signal, faulty.reason)).collect()
}

#[test]
fn a_good_day_has_no_faulty_sensor() {
    assert_eq!(reasons(&days()), []);
}

#[test]
fn a_jump_that_stays_is_named_with_its_time() {
    let mut days = days();
    days[2].temperatures[3][125..].iter_mut().for_each(|value| *value += 28.0);
    let found = reasons(&days);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].0, "s3");
    assert!(found[0].1.starts_with("jumps by +28.0 °C at 2:05 h and stays"), "{}", found[0].1);
    assert!(found[0].1.ends_with("in day2"), "{}", found[0].1);
}

#[test]
fn a_frozen_sensor_is_named_with_its_times() {
    let mut days = days();
    let held = days[1].temperatures[0][100];
    days[1].temperatures[0][100..400].fill(held);
    let found = reasons(&days);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(
        found[0].0 == "s0" && found[0].1.starts_with("stuck at one number from 1:40 h to 6:39 h"),
        "{found:?}"
    );
}

#[test]
fn spikes_are_counted() {
    let mut days = days();
    for row in [50, 200, 410] {
        days[4].temperatures[2][row] += 3.0;
    }
    let found = reasons(&days);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].1.contains("first at 0:50 h, 3 times: a bad contact in day4"), "{found:?}");
}

#[test]
fn a_constant_and_a_missing_sensor_are_left_out() {
    let mut days = days();
    for day in &mut days {
        day.temperatures[4].fill(21.0);
    }
    days[0].temperatures[2][100..300].fill(f64::NAN);
    let found = reasons(&days);
    assert_eq!(found[0], ("s2".to_owned(), "missing in 33 % of the rows of day0".to_owned()));
    assert_eq!(found[1], ("s4".to_owned(), "constant: it tells nothing".to_owned()));
}

#[test]
fn a_faulty_sensor_that_is_not_needed_costs_nothing() {
    let clean = days();
    let mut broken = clean.clone();
    broken[2].temperatures[3][125..].iter_mut().for_each(|value| *value += 28.0);
    let range = |days: &[Day]| {
        let logs: Vec<String> = days.iter().map(Day::log).collect();
        found(5, &logs, &Settings::default()).mean_range_um
    };
    let (clean, broken) = (range(&clean), range(&broken));
    assert!(broken < 1.1 * clean, "{clean} {broken}");
}

/// A casting has many sensors that say nearly the same; the faulty one is one that the model uses.
fn with_a_twin() -> Vec<Day> {
    let mut days = days();
    for (number, day) in days.iter_mut().enumerate() {
        let phase = number as f64;
        day.temperatures[3] = (day.temperatures[0].iter().enumerate())
            .map(|(row, value)| 20.0 + 0.9 * (value - 20.0) + 0.02 * (row as f64 / 40.0 + phase).sin())
            .collect();
    }
    days
}

#[test]
fn a_faulty_sensor_that_the_model_needs_is_named_and_costs_less_than_a_tenth() {
    let clean = with_a_twin();
    let of = |days: &[Day]| {
        let logs: Vec<String> = days.iter().map(Day::log).collect();
        found(5, &logs, &Settings::default())
    };
    let good = of(&clean);
    assert_eq!(good.excluded, []);
    assert!(good.terms.iter().any(|term| term.signal == "s0"), "{:?}", good.terms);
    let jumps = |day: &mut Day| day.temperatures[0][200..].iter_mut().for_each(|value| *value += 28.0);
    let freezes = |day: &mut Day| {
        let held = day.temperatures[0][30];
        day.temperatures[0][30..330].fill(held);
    };
    let spikes = |day: &mut Day| [40, 90, 310, 500].iter().for_each(|row| day.temperatures[0][*row] += 3.0);
    for word in ["jumps", "stuck", "spikes"] {
        let mut broken = clean.clone();
        match word {
            "jumps" => jumps(&mut broken[2]),
            "stuck" => freezes(&mut broken[2]),
            _ => spikes(&mut broken[2]),
        }
        let found = of(&broken);
        // A sensor that froze jumps when it thaws.
        assert!(found.excluded.iter().all(|faulty| faulty.signal == "s0"), "{word}: {:?}", found.excluded);
        let named = |reason: &str| reason.starts_with(word) && reason.ends_with("day2");
        assert!(found.excluded.iter().any(|faulty| named(&faulty.reason)), "{word}: {:?}", found.excluded);
        let (cost, clean) = (found.mean_rmse_um, good.mean_rmse_um);
        println!("{word}: {cost:.3} against {clean:.3} um");
        assert!(cost < 1.1 * clean, "{word}: {cost} um against {clean} um");
    }
}
