use std::time::Duration;

use isotherm_identify::method::{Method, Settings};

use super::rig::{Machine, Part, found};

fn machine(parts: &[Part], noise: f64) -> Machine {
    Machine { sensors: 4, parts: parts.to_vec(), step: 60.0, rows: 480, noise }
}

fn days(machine: &Machine, count: u64, seed: u64) -> Vec<String> {
    (0..count).map(|day| machine.day(1000 * seed + day).log()).collect()
}

fn by(method: Method) -> Settings {
    Settings { method, ..Settings::default() }
}

const AT_ONCE: [Part; 2] =
    [Part { sensor: 0, gain: 3.0, constant: 0.0 }, Part { sensor: 2, gain: -1.5, constant: 0.0 }];

#[test]
fn least_squares_gives_the_gains_that_the_days_were_made_of_with_the_sign_of_cz() {
    let found = found(4, &days(&machine(&AT_ONCE, 0.0), 3, 1), &by(Method::Ols));
    for (name, truth) in [("s0", -3.0), ("s1", 0.0), ("s2", 1.5), ("s3", 0.0)] {
        let term = found.terms.iter().find(|term| term.signal == name).unwrap();
        assert!((term.gain - truth).abs() < 1e-9, "{name}: {} is not {truth}", term.gain);
    }
    assert!(found.means.worst_range_um < 1e-6 && found.uncompensated.mean_range_um > 5.0);
}

#[test]
fn in_95_of_100_days_and_more_the_truth_lies_within_two_standard_errors() {
    let mut inside = 0;
    for seed in 0..200 {
        let found = found(4, &days(&machine(&AT_ONCE, 1.0), 4, seed), &by(Method::Ols));
        let term = |name: &str| found.terms.iter().find(|term| term.signal == name).unwrap().clone();
        let is_inside =
            |name: &str, truth: f64| (term(name).gain - truth).abs() <= 2.0 * term(name).se.unwrap();
        inside += usize::from(is_inside("s0", -3.0)) + usize::from(is_inside("s2", 1.5));
    }
    assert!(inside >= 380, "{inside} of 400");
}

#[test]
fn a_standard_error_is_no_larger_than_the_noise_makes_it() {
    // In one campaign of four days, the standard error itself is uncertain; in twenty campaigns, it is not.
    let mut stated: [Vec<f64>; 4] = Default::default();
    let mut scatter = [0.0; 4];
    for seed in 0..20 {
        let found = found(4, &days(&machine(&AT_ONCE, 1.0), 4, seed), &by(Method::Ols));
        for (place, truth) in [-3.0, 0.0, 1.5, 0.0].into_iter().enumerate() {
            let term = found.terms.iter().find(|term| term.signal == format!("s{place}")).unwrap();
            assert!(term.se.unwrap() > 0.0, "{term:?}");
            stated[place].push(term.se.unwrap());
            scatter[place] += (term.gain - truth).powi(2) / 20.0;
        }
    }
    for (mut stated, scatter) in stated.into_iter().zip(scatter) {
        stated.sort_by(f64::total_cmp);
        let scatter: f64 = scatter.sqrt();
        assert!(stated[10] < 2.5 * scatter, "{} is stated of {scatter}", stated[10]);
    }
}

#[test]
fn m4_time_constants_are_found_though_they_are_not_in_the_bank() {
    let parts =
        [Part { sensor: 1, gain: 4.0, constant: 1800.0 }, Part { sensor: 3, gain: -2.0, constant: 540.0 }];
    let found = found(4, &days(&machine(&parts, 0.05), 4, 3), &by(Method::Lag));
    for part in parts {
        let name = format!("s{}", part.sensor);
        let term = found.terms.iter().find(|term| term.signal == name).unwrap();
        // The lag begins when its reference is determined, after three minutes. The machine is still cold then.
        assert!((term.lag_s / part.constant - 1.0).abs() < 0.03, "{term:?}");
        assert!((term.gain + part.gain).abs() < 0.05, "{term:?}");
        assert!(term.se.is_some_and(|se| se > 0.0 && se < 0.1), "the fits without one day differ: {term:?}");
    }
    assert!(found.means.worst_range_um < 1.0, "{:?}", found.runs);
}

#[test]
fn the_default_finds_a_lagging_machine_that_least_squares_does_not() {
    let parts =
        [Part { sensor: 0, gain: 4.0, constant: 3000.0 }, Part { sensor: 2, gain: 2.0, constant: 720.0 }];
    let days = days(&machine(&parts, 0.2), 5, 11);
    let plain = found(4, &days, &by(Method::Ols));
    let lagged = found(4, &days, &by(Method::SparseLag));
    assert!(
        lagged.means.mean_range_um < 0.5 * plain.means.mean_range_um,
        "{} {}",
        lagged.means.mean_range_um,
        plain.means.mean_range_um
    );
    let ridge = found(4, &days, &by(Method::RidgeLag));
    assert!(ridge.means.mean_range_um < 0.5 * plain.means.mean_range_um, "{}", ridge.means.mean_range_um);
}

#[test]
fn stepwise_leaves_out_what_has_nothing_to_do_with_the_error() {
    let settings = Settings { lags: vec![None], ..by(Method::Stepwise) };
    let found = found(4, &days(&machine(&AT_ONCE, 0.3), 5, 5), &settings);
    let mut names: Vec<&str> = found.terms.iter().map(|term| term.signal.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, ["s0", "s2"]);
}

#[test]
fn m1_the_gain_of_a_difference_is_found_with_the_pair() {
    let parts = [Part { sensor: 1, gain: -2.4, constant: 0.0 }, Part { sensor: 2, gain: 2.4, constant: 0.0 }];
    let found = found(4, &days(&machine(&parts, 0.0), 3, 2), &by(Method::Difference));
    let gains: Vec<(&str, f64)> = found.terms.iter().map(|term| (term.signal.as_str(), term.gain)).collect();
    assert_eq!((gains[0].0, gains[1].0), ("s1", "s2"));
    assert!((gains[0].1 - 2.4).abs() < 1e-9 && (gains[1].1 + 2.4).abs() < 1e-9, "{gains:?}");
}

#[test]
fn m7_two_sources_are_told_apart_by_the_runs_in_which_one_waits() {
    let both = [
        Part { sensor: 0, gain: 0.632, constant: 0.0 },
        Part { sensor: 1, gain: -3.066, constant: 0.0 },
        Part { sensor: 2, gain: -1.2, constant: 0.0 },
    ];
    let (all, waits) = (machine(&both, 0.0), machine(&both[..2], 0.0));
    let names = |list: &[&str]| list.iter().map(|name| (*name).to_owned()).collect();
    let days: Vec<String> =
        (0..6).map(|day| if day < 3 { waits.day(day).log() } else { all.day(day).log() }).collect();
    let settings = Settings {
        waiting: names(&["day0", "day1", "day2"]),
        first: names(&["s0", "s1"]),
        second: names(&["s2", "s1"]),
        ..by(Method::TwoSource)
    };
    let found = found(4, &days, &settings);
    for (name, truth) in [("s0", -0.632), ("s1", 3.066), ("s2", 1.2)] {
        let term = found.terms.iter().find(|term| term.signal == name).unwrap();
        assert!((term.gain - truth).abs() < 1e-9, "{term:?}");
    }
}

#[test]
fn a_probe_takes_out_what_it_measures() {
    let machine = machine(&AT_ONCE, 0.0);
    let days = days(&machine, 2, 4);
    let found = found(4, &days, &by(Method::None));
    let held = &found.held_out[0];
    let probed = held.residual(Some(3600.0));
    let bare = held.residual(None);
    for (row, second) in held.seconds.iter().enumerate() {
        let touched =
            held.seconds.iter().position(|other| (other / 3600.0).floor() >= (second / 3600.0).floor());
        let taken = if *second < 3600.0 { 0.0 } else { bare[touched.unwrap()] };
        assert!((probed[row] - (bare[row] - taken)).abs() < 1e-12, "{second}");
    }
    assert_eq!(Duration::from_secs_f64(held.seconds[1]), Duration::from_secs(60));
}
