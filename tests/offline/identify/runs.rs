//! Comparison of the validated model with the model in the profile.

use isotherm::cli::replay::replay;
use isotherm_core::compensation::model::Outside;
use isotherm_identify::identify;
use isotherm_identify::method::{Method, Settings};
use isotherm_identify::setup::{Choice, ready};
use isotherm_identify::written::written;

use super::rig::{self, Machine, Part, dataset, profile_with};

fn machine(step: f64, rows: usize) -> Machine {
    let parts = [
        Part { sensor: 0, gain: 4.0, constant: 2700.0 },
        Part { sensor: 1, gain: -2.5, constant: 0.0 },
        Part { sensor: 2, gain: 1.0, constant: 400.0 },
    ];
    Machine { sensors: 3, parts: parts.to_vec(), step, rows, noise: 0.3 }
}

/// Identifies from all days but the last, loads the resulting block, and replays it over the last day. Returns the
/// largest difference to the residual of the cross-validation in µm, and the number of compared rows.
fn apart(machine: &Machine, count: u64, method: Method, resample: u64) -> (f64, usize) {
    let days: Vec<String> = (0..count).map(|day| machine.day(day).log()).collect();
    let choice = Choice { resample: std::time::Duration::from_secs(resample), ..Choice::default() };
    let settings =
        Settings { method, terms: Some(4).filter(|_| method == Method::Lag), ..Settings::default() };
    let last = days.len() - 1;
    let profile = rig::profile(3);
    let all = dataset(&days).unwrap();
    let validated = ready(&profile, &all, &choice).unwrap();
    let validated = identify(&validated, &settings, None, false, &|_, _| {}).unwrap();
    let others = dataset(&days[..last]).unwrap();
    let others = ready(&profile, &others, &choice).unwrap();
    let found = identify(&others, &settings, None, true, &|_, _| {}).unwrap();
    let block = written(&found, "z", Outside::Warn);

    let directory = tempfile::tempdir().unwrap();
    for (name, text) in &block.files {
        std::fs::write(directory.path().join(name), text).unwrap();
    }
    let pasted = directory.path().join("pasted.toml");
    std::fs::write(&pasted, profile_with(3, &block.block)).unwrap();
    let pasted = isotherm_profile::load(&pasted, &[], &[])
        .unwrap_or_else(|errors| panic!("{errors}\n{}", block.block));
    assert_eq!(pasted.profile.axes[0].settings.models.len(), 1 + found.fallbacks.len());
    let mut out = Vec::new();
    replay(&pasted.profile, days[last].as_bytes(), "last.csv", Some(&mut out)).unwrap();
    let mut table = csv::Reader::from_reader(out.as_slice());
    let header = table.headers().unwrap().clone();
    let at = |name: &str| header.iter().position(|column| column == name).unwrap();
    let (time, raw, model) = (at("time"), at("z_raw_um"), at("z_model"));
    let replayed: Vec<(f64, f64)> = table
        .records()
        .map(Result::unwrap)
        .filter(|row| !row[raw].is_empty())
        .inspect(|row| assert_eq!(&row[model], method.name()))
        .map(|row| (row[time].parse().unwrap(), row[raw].parse().unwrap()))
        .collect();
    let held = &validated.held_out[last];
    let residual = held.residual(None);
    let (mut worst, mut rows) = (0.0_f64, 0);
    for (row, second) in held.seconds.iter().enumerate() {
        // A row that is the mean of several rows has their mean time.
        let window = (resample as f64 / 2.0).max(1e-6);
        let inside: Vec<f64> =
            replayed.iter().filter(|(time, _)| (time - second).abs() < window).map(|row| row.1).collect();
        let wanted = if resample == 0 { 1.0 } else { resample as f64 / machine.step };
        if (inside.len() as f64 - wanted).abs() > 0.5 {
            continue;
        }
        let cz = inside.iter().sum::<f64>() / inside.len() as f64;
        worst = worst.max((held.error[row] + cz - residual[row]).abs());
        rows += 1;
    }
    (worst, rows)
}

#[test]
fn the_block_replayed_over_a_day_it_never_saw_leaves_what_cross_validation_left() {
    for method in [Method::SparseLag, Method::RidgeLag, Method::Stepwise, Method::Ols, Method::Lag] {
        let (worst, rows) = apart(&machine(60.0, 400), 5, method, 60);
        assert!(worst < 1e-6 && rows > 390, "{method}: {worst} µm over {rows} rows");
    }
}

#[test]
fn so_does_the_default_but_for_the_terms_that_nobody_can_tell() {
    let (worst, rows) = apart(&machine(60.0, 400), 5, Method::Whitened, 60);
    assert!(worst < 0.5 && rows > 390, "{worst} µm over {rows} rows");
}

#[test]
fn so_does_the_file_of_a_network_with_its_lagged_inputs() {
    for method in [Method::Rbf, Method::Network] {
        let (worst, rows) = apart(&machine(60.0, 240), 4, method, 60);
        assert!(worst < 1e-6 && rows > 230, "{method}: {worst} µm over {rows} rows");
    }
}

#[test]
fn so_it_does_where_rows_come_faster_than_they_are_averaged() {
    let (worst, rows) = apart(&machine(10.0, 1500), 5, Method::SparseLag, 60);
    assert!(worst < 1e-6 && rows > 200, "{worst} µm over {rows} rows");
    let (worst, rows) = apart(&machine(30.0, 600), 5, Method::RidgeLag, 0);
    assert!(worst < 1e-6 && rows > 580, "{worst} µm over {rows} rows");
}
