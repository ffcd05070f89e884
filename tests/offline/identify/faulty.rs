use isotherm_identify::Learned;
use isotherm_identify::faults::Repaired;
use isotherm_identify::method::{Method, Settings};

use super::rig::{Day, Machine, Part, dataset, found, profile};
use isotherm_identify::setup::ready;

fn machine() -> Machine {
    let parts =
        [Part { sensor: 0, gain: 3.0, constant: 1500.0 }, Part { sensor: 1, gain: -2.0, constant: 0.0 }];
    Machine { sensors: 5, parts: parts.to_vec(), step: 60.0, rows: 600, noise: 0.3 }
}

fn days() -> Vec<Day> {
    (20..25).map(|seed| machine().day(seed)).collect()
}

/// Returns the sensors that are left out of every run, with the reason.
fn reasons(days: &[Day]) -> Vec<(String, String)> {
    let logs: Vec<String> = days.iter().map(Day::log).collect();
    let dataset = dataset(&logs).unwrap();
    let ready = ready(&profile(5), &dataset, &super::rig::choice()).unwrap();
    ready.notes.excluded.into_iter().map(|faulty| (faulty.signal, faulty.reason)).collect()
}

/// Returns the repairs: sensor, run, fault, and repair.
fn mended(days: &[Day]) -> Vec<Repaired> {
    let logs: Vec<String> = days.iter().map(Day::log).collect();
    let dataset = dataset(&logs).unwrap();
    ready(&profile(5), &dataset, &super::rig::choice()).unwrap().repaired
}

#[test]
fn a_good_day_has_no_faulty_sensor() {
    assert_eq!(reasons(&days()), []);
}

#[test]
fn a_jump_that_stays_is_named_with_its_time() {
    let mut days = days();
    days[2].temperatures[3][125..].iter_mut().for_each(|value| *value += 28.0);
    let found = mended(&days);
    assert_eq!(found.len(), 1);
    assert_eq!((found[0].signal.as_str(), found[0].run.as_str()), ("s3", "day2"));
    assert!(
        found[0].fault.starts_with("jumps by +28.0 °C at 2:05 h, faster than a casting can change"),
        "{}",
        found[0].fault
    );
    assert!(found[0].done.starts_with("a correction of -28.0"), "{}", found[0].done);
    assert_eq!(reasons(&days), []);
}

#[test]
fn a_frozen_sensor_that_no_other_resembles_is_named_with_its_times_and_masked_and_stays_in() {
    let mut days = days();
    let held = days[1].temperatures[0][100];
    days[1].temperatures[0][100..400].fill(held);
    assert_eq!(reasons(&days), []);
    let found = mended(&days);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!((found[0].signal.as_str(), found[0].run.as_str()), ("s0", "day1"));
    assert!(found[0].fault.starts_with("frozen from 1:40 h to 6:39 h"), "{found:?}");
    assert!(found[0].done.contains("masked"), "each goes its own way: {found:?}");
}

#[test]
fn spikes_are_counted() {
    let mut days = days();
    for row in [50, 200, 410] {
        days[4].temperatures[2][row] += 3.0;
    }
    let found = mended(&days);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].fault.contains("first at 0:50 h, 3 times, probably from a bad contact"), "{found:?}");
    assert!(found[0].run == "day4" && found[0].done.contains("linear interpolation"), "{found:?}");
}

#[test]
fn a_constant_and_a_missing_sensor_are_left_out() {
    let mut days = days();
    for day in &mut days {
        day.temperatures[4].fill(21.0);
    }
    days[0].temperatures[2][100..300].fill(f64::NAN);
    let found = reasons(&days);
    assert_eq!(found[0], ("s2".to_owned(), "missing in 33 % of the rows in day0".to_owned()));
    assert_eq!(found[1], ("s4".to_owned(), "constant: this sensor gives no information".to_owned()));
}

#[test]
fn a_faulty_sensor_that_is_not_needed_costs_nothing() {
    let clean = days();
    let mut broken = clean.clone();
    broken[2].temperatures[3][125..].iter_mut().for_each(|value| *value += 28.0);
    let range = |days: &[Day]| {
        let logs: Vec<String> = days.iter().map(Day::log).collect();
        found(5, &logs, &Settings::default()).means.mean_range_um
    };
    let (clean, broken) = (range(&clean), range(&broken));
    assert!(broken < 1.1 * clean, "{clean} {broken}");
}

/// Days with a twin: a casting has many sensors that read nearly the same. The faulty one is used by the model.
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

fn jumps(day: &mut Day) {
    day.temperatures[0][200..].iter_mut().for_each(|value| *value += 28.0);
}

fn freezes(day: &mut Day) {
    let held = day.temperatures[0][30];
    day.temperatures[0][30..330].fill(held);
}

fn spikes(day: &mut Day) {
    [40, 90, 310, 500].iter().for_each(|row| day.temperatures[0][*row] += 3.0);
}

#[test]
fn a_faulty_sensor_that_the_model_needs_is_named_and_costs_less_than_a_tenth() {
    let clean = with_a_twin();
    let of = |days: &[Day]| {
        let logs: Vec<String> = days.iter().map(Day::log).collect();
        found(5, &logs, &Settings::default())
    };
    let good = of(&clean);
    assert_eq!(good.notes.excluded, []);
    assert!(good.terms.iter().any(|term| term.signal == "s0"), "{:?}", good.terms);
    for (word, of_day) in [("jumps", jumps as fn(&mut Day)), ("frozen", freezes), ("spikes", spikes)] {
        for run in 0..clean.len() {
            let mut broken = clean.clone();
            of_day(&mut broken[run]);
            let found = of(&broken);
            // A sensor jumps at the end of a freeze. The jump is no second fault.
            let [mended] = found.repaired.as_slice() else { panic!("{word}: {:?}", found.repaired) };
            assert_eq!((mended.signal.as_str(), mended.run.as_str()), ("s0", format!("day{run}").as_str()));
            assert!(mended.fault.starts_with(word), "{mended:?}");
            assert_eq!(found.notes.excluded, [], "{word}");
            let (cost, clean) = (found.means.mean_rmse_um, good.means.mean_rmse_um);
            println!("{word} in day{run}: {cost:.3} against {clean:.3} um");
            assert!(cost < 1.1 * clean, "{word} in day{run}: {cost} um against {clean} um");
        }
    }
}

#[test]
fn what_was_frozen_is_rebuilt_from_its_twin() {
    let clean = with_a_twin();
    let mut broken = clean.clone();
    freezes(&mut broken[2]);
    let found = mended(&broken);
    assert!(found[0].done.contains("rebuilt, mostly from s3"), "{found:?}");
}

#[test]
fn a_sensor_that_is_faulty_in_most_runs_is_left_out_of_all() {
    let mut days = with_a_twin();
    days.iter_mut().skip(2).for_each(jumps);
    assert_eq!(mended(&days), []);
    let found = reasons(&days);
    assert!(found.len() == 3 && found.iter().all(|(signal, _)| signal == "s0"), "{found:?}");
}

#[test]
fn a_mended_run_is_learnt_from_as_if_the_held_out_run_had_not_been_recorded() {
    for of_day in [jumps as fn(&mut Day), freezes] {
        let mut days = with_a_twin();
        of_day(&mut days[1]);
        let logs: Vec<String> = days.iter().map(Day::log).collect();
        let sparse = Settings { method: Method::SparseLag, ..Settings::default() };
        let all = found(5, &logs, &sparse);
        let others = found(5, &logs[..4], &sparse);
        assert_eq!((all.repaired.len(), others.repaired.len()), (1, 1));
        let Learned::Sum(held) = &all.held_out[4].learned else { panic!("a sum") };
        let Learned::Sum(learnt) = &others.learned else { panic!("a sum") };
        assert_eq!(held.len(), learnt.len());
        for ((one, gain), (other, again)) in held.iter().zip(learnt) {
            assert!(one == other && (gain - again).abs() < 1e-9, "{one:?} {gain} {other:?} {again}");
        }
    }
}
