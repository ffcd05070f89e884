//! Coverage of the stated standard errors, in 200 campaigns with known gains.

use isotherm_identify::method::{Method, Settings};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::rig::{Machine, Part, found};

/// Days with a correlated disturbance. `size` is its standard deviation in µm, `memory` its correlation time in rows.
fn campaign(days: u64, seed: u64, size: f64, memory: f64) -> Vec<String> {
    let parts = [Part { sensor: 0, gain: 3.0, constant: 0.0 }, Part { sensor: 2, gain: -1.5, constant: 0.0 }];
    let machine = Machine { sensors: 3, parts: parts.to_vec(), step: 60.0, rows: 480, noise: 0.1 };
    let day = |place: u64| {
        let mut day = machine.day(50_000 + 100 * seed + place);
        let mut chance = Pcg64Mcg::seed_from_u64(90_000 + 100 * seed + place);
        let mut normal = || (0..12).map(|_| chance.random_range(-0.5..0.5)).sum::<f64>();
        let kept = (-1.0 / memory).exp();
        let mut wander = size * normal();
        for error in &mut day.error {
            *error += wander;
            wander = kept * wander + size * (1.0 - kept * kept).sqrt() * normal();
        }
        day.log()
    };
    (0..days).map(day).collect()
}

/// Results of 200 campaigns for each gain. The first figure counts the true values within the stated 95 % interval. The
/// second is the ratio of the median stated error to the scatter of the gains.
fn inside(days: u64, size: f64, memory: f64) -> ([usize; 3], [f64; 3]) {
    let mut inside = [0; 3];
    let mut found_of: [Vec<(f64, f64)>; 3] = Default::default();
    let settings = Settings { method: Method::Ols, ..Settings::default() };
    for seed in 0..200 {
        let found = found(3, &campaign(days, seed, size, memory), &settings);
        for (place, (name, truth)) in [("s0", -3.0), ("s1", 0.0), ("s2", 1.5)].into_iter().enumerate() {
            let term = found.terms.iter().find(|term| term.signal == name).unwrap();
            inside[place] += usize::from((term.gain - truth).abs() <= 1.96 * term.se.unwrap());
            found_of[place].push((term.gain - truth, term.se.unwrap()));
        }
    }
    let wide = found_of.map(|mut found| {
        let scatter = (found.iter().map(|(off, _)| off * off).sum::<f64>() / 200.0).sqrt();
        found.sort_by(|one, other| one.1.total_cmp(&other.1));
        found[100].1 / scatter
    });
    (inside, wide)
}

/// Checks that 95 % of all gains are inside. For a single gain, the limit allows for the chance of 200 draws
/// (one-sided, 95 %). The errors must not be wider than Student's factor for so few days.
#[track_caller]
fn holds((inside, wide): ([usize; 3], [f64; 3]), widest: f64) {
    assert!(inside.iter().sum::<usize>() >= 570, "{inside:?} of 200 each");
    assert!(inside.iter().all(|count| *count >= 185), "{inside:?} of 200 each");
    assert!(wide.iter().all(|wide| *wide < widest), "{wide:?} times as wide as the scatter");
}

#[test]
fn a_disturbance_of_half_an_hour_is_in_the_stated_errors() {
    holds(inside(4, 1.0, 30.0), 2.0);
}

#[test]
fn a_disturbance_of_two_hours_is_in_the_stated_errors() {
    holds(inside(4, 1.0, 120.0), 2.0);
}

#[test]
fn two_days_state_how_little_two_days_know() {
    holds(inside(2, 1.0, 30.0), 4.0);
}
