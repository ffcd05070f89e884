//! Networks and radial basis functions on a non-linear machine; a difference after the loss of one sensor.

use isotherm_core::compensation::model::Outside;
use isotherm_identify::Identified;
use isotherm_identify::method::{Method, Settings};
use isotherm_identify::written::written;

use super::rig::{Day, Machine, found, profile_with};

fn machine() -> Machine {
    Machine { sensors: 3, parts: Vec::new(), step: 60.0, rows: 300, noise: 0.1 }
}

/// Day with a joint that slips: at most 12 µm from one sensor, and a quadratic effect of another one.
fn slipping(seed: u64) -> Day {
    let mut day = machine().day(seed);
    for (row, error) in day.error.iter_mut().enumerate() {
        let rise = |sensor: usize| day.temperatures[sensor][row] - day.temperatures[sensor][0];
        *error += 12.0 * (rise(0) / 2.5).tanh() - 0.5 * rise(1) * rise(1);
    }
    day
}

fn logs(days: &[Day]) -> Vec<String> {
    days.iter().map(Day::log).collect()
}

fn by(method: Method) -> Settings {
    // Least squares has no lags.
    let lags = if method == Method::Ols { Vec::new() } else { vec![None] };
    Settings { method, lags, ..Settings::default() }
}

fn cz(found: &Identified, run: usize) -> Vec<u64> {
    found.held_out[run].cz.iter().map(|cz| cz.to_bits()).collect()
}

#[test]
fn m10_what_is_no_straight_line_is_found_better_than_by_any_linear_method() {
    let days: Vec<Day> = (0..6).map(slipping).collect();
    let left = |method| found(3, &logs(&days), &by(method)).means.mean_range_um;
    let linear = [Method::Ols, Method::RidgeLag, Method::SparseLag].map(left);
    let linear = linear.into_iter().fold(f64::MAX, f64::min);
    for method in [Method::Rbf, Method::Network] {
        let curved = left(method);
        assert!(curved < 0.6 * linear, "{method} leaves {curved:.2} µm, a linear one {linear:.2} µm");
    }
}

#[test]
fn a_run_that_is_left_out_never_enters_its_own_training_and_a_seed_gives_one_model() {
    let mut days: Vec<Day> = (0..4).map(slipping).collect();
    for method in [Method::Rbf, Method::Network] {
        let settings = Settings { neurons: 4, centres: 10, ..by(method) };
        let before = found(3, &logs(&days), &settings);
        let kept = days[2].error.clone();
        for (row, error) in days[2].error.iter_mut().enumerate() {
            *error = *error * -3.0 + row as f64 * 0.1;
        }
        let after = found(3, &logs(&days), &settings);
        days[2].error = kept;
        // The same seed and the same other days give the same numbers, to the last bit.
        assert_eq!(cz(&before, 2), cz(&after, 2), "{method}");
        assert_ne!(cz(&before, 0), cz(&after, 0), "{method}");
        let other = found(3, &logs(&days), &Settings { seed: 2, ..settings });
        assert_ne!(cz(&before, 2), cz(&other, 2), "{method}");
    }
}

#[test]
fn a_network_has_an_envelope_and_linear_stand_ins_though_it_takes_only_lagged_inputs() {
    let days: Vec<Day> = (0..3).map(slipping).collect();
    let lags = vec![Some(std::time::Duration::from_secs(600))];
    let settings = Settings { lags, centres: 8, ..by(Method::Rbf) };
    let found = found(3, &logs(&days), &settings);
    assert_eq!(found.network.as_deref(), Some("radial-basis network of 40 nodes"));
    assert_eq!(found.fallbacks.len(), 3);
    assert!(found.fallbacks.iter().all(|fallback| fallback.method == "whitened"));
    let block = written(&found, "z", Outside::Warn);
    assert!(block.block.contains("{ signal = \"s1\", lag = \"10m\" },"), "{}", block.block);
    let files: Vec<&str> = block.files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(files[..2], ["z.network.json", "z.envelope.json"]);
    assert!(files.len() == 5 && files[2..].iter().all(|name| name.contains("without-s")), "{files:?}");
}

#[test]
fn m2_each_sensor_of_a_difference_stands_in_for_the_other_with_machine_on_time() {
    // Case of the patent: B rises by 2e-5 °C/s from 23.4 °C, A with the square root of time; Kz = 2.4.
    let day = |seed: u64| {
        let mut day = Machine { sensors: 2, noise: 0.0, ..machine() }.day(seed);
        for (row, time) in day.times.iter().enumerate() {
            let (a, b) = (23.4 + (0.02 + 0.001 * seed as f64) * time.sqrt(), 23.4 + 2e-5 * time);
            (day.temperatures[0][row], day.temperatures[1][row]) = (a, b);
            day.error[row] = -2.4 * (a - b);
        }
        day
    };
    let days: Vec<Day> = (0..3).map(day).collect();
    let found = found(2, &logs(&days), &Settings { method: Method::Difference, ..Settings::default() });
    let of = |without: &str| {
        let fallback = found.fallbacks.iter().find(|fallback| fallback.without == without).unwrap();
        (fallback.alone.clone().unwrap(), fallback.means.mean_range_um)
    };
    let (first, range) = of("s1");
    assert_eq!((first.signal.as_str(), first.formula), ("s0", "Kz * (A - (b*t + c))"));
    let [(_, gain), (_, slope), (_, constant)] = first.constants;
    // Cz is relative to the mean of the first three minutes, which is part of c. The difference is at most a tenth of a
    // degree.
    assert!((gain - 2.4).abs() < 1e-6 && (slope - 2e-5).abs() < 1e-9, "{first:?}");
    assert!((constant - 23.4).abs() < 0.3 && range < 0.2, "{first:?}: {range}");
    let (second, range) = of("s0");
    assert_eq!((second.signal.as_str(), second.formula), ("s1", "Kz * (K*sqrt(t) + c - B)"));
    assert!((second.constants[1].1 - 0.021).abs() < 1e-4, "{second:?}");
    // A differs from day to day; the residual is due to its spread.
    assert!(range > 0.1 && range < 1.0, "{range}");

    let written = written(&found, "z", Outside::Warn);
    let directory = tempfile::tempdir().unwrap();
    for (name, text) in &written.files {
        std::fs::write(directory.path().join(name), text).unwrap();
    }
    let pasted = directory.path().join("pasted.toml");
    std::fs::write(&pasted, profile_with(2, &written.block)).unwrap();
    let pasted = isotherm_profile::load(&pasted, &[], &[])
        .unwrap_or_else(|errors| panic!("{errors}\n{}", written.block));
    assert_eq!(pasted.profile.axes[0].settings.models.len(), 3, "{}", written.block);
}
