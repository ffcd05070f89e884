//! Learning from touches on two public data sets, in the order of time, and the limits that it must reach.
//!
//! ```text
//! cargo run --release -p isotherm-identify --example learned -- --mill runs/c*.csv --stage runs/day*.csv
//! ```
//!
//! The head of the example `held_out` describes the data sets. The first three runs are the commissioning, with an error
//! in each row. Each later run is judged on all its rows, and then learned from its hourly touches (σ 0.5 µm).

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "an example that cannot go on stops"
)]

use std::collections::VecDeque;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use isotherm_core::quantity::Moment;
use isotherm_identify::dataset::{Column, Dataset, Kind, Run, Split, every_column};
use isotherm_identify::identify;
use isotherm_identify::learning::{InUse, Learning, choice, rows};
use isotherm_identify::method::Settings;
use isotherm_identify::setup::{Choice, ready};
use isotherm_profile::Profile;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use record::{machine, mean};

mod record;

/// Number of runs of the commissioning.
const COMMISSIONED: usize = 3;
/// Smallest number of runs of a channel that counts.
const ENOUGH_RUNS: usize = 6;
/// Standard deviation of a touch, µm.
const SIGMA: f64 = 0.5;
/// Largest geometric mean of the ranges and root mean squares, as a ratio to the model that stays.
const MEAN: f64 = 0.9;
/// Largest ratio of a channel.
const WORST: f64 = 1.08;
/// Smallest and largest share of the rows within one and within two times the expected error.
const INSIDE: [(f64, f64); 2] = [(0.55, 0.88), (0.82, 0.99)];

/// Residual errors of a channel over its later runs.
#[derive(Default)]
struct Figures {
    /// Range and root mean square of each run: without compensation, with the model that stays, with the candidate of
    /// each day, and with the judged candidate.
    left: [Vec<(f64, f64)>; 4],
    /// Rows within one and within two times the expected error, and all rows.
    inside: [usize; 3],
}

fn main() -> ExitCode {
    let Some(files) = record::files("learned") else { return ExitCode::FAILURE };
    let mut ratios = Vec::new();
    for (files, sensors, channels) in
        [(&files[0], 16, ["ch1_um", "ch3_um", "ch5_um"]), (&files[1], 4, ["x_um", "y_um", "z_um"])]
    {
        if files.is_empty() {
            continue;
        }
        for channel in channels {
            let found = learned(files, sensors, channel);
            let runs = found.left[0].len() + COMMISSIONED;
            let ratio = said(channel, &found);
            if runs >= ENOUGH_RUNS {
                ratios.push(ratio);
            }
        }
    }
    if ratios.is_empty() {
        return ExitCode::SUCCESS;
    }
    let geometric = mean(ratios.iter().map(|ratio| ratio.ln())).exp();
    let worst = ratios.iter().copied().fold(f64::MIN, f64::max);
    println!(
        "geometric mean of all channels  {geometric:.2}, at most {MEAN}: {}",
        reached(geometric <= MEAN)
    );
    println!("worst channel                   {worst:.2}, at most {WORST}: {}", reached(worst <= WORST));
    ExitCode::SUCCESS
}

/// Prints the figures of a channel. Returns the ratio of the range with the judged candidate to that of the model that
/// stays.
fn said(channel: &str, found: &Figures) -> f64 {
    let of = |place: usize| {
        let runs = &found.left[place];
        (mean(runs.iter().map(|run| run.0)), mean(runs.iter().map(|run| run.1)))
    };
    let names = ["without compensation", "model that stays", "candidate of each day", "judged candidate"];
    for (place, name) in names.iter().enumerate() {
        let (range, rms) = of(place);
        println!("{channel:7} {name:22} {range:6.2} µm, RMS {rms:.2} µm");
    }
    let [one, two, all] = found.inside;
    for (times, inside, (least, most)) in [("one", one, INSIDE[0]), ("two", two, INSIDE[1])] {
        #[allow(clippy::cast_precision_loss, reason = "some thousand rows")]
        let share = inside as f64 / all.max(1) as f64;
        let is_reached = (least..=most).contains(&share);
        println!(
            "{channel:7} inside {times} times expected {share:5.2}, {least} to {most}: {}",
            reached(is_reached)
        );
    }
    of(3).0 / of(1).0
}

fn reached(is_reached: bool) -> &'static str {
    if is_reached { "reached" } else { "MISSED" }
}

/// Learns one channel in the order of time.
fn learned(files: &[PathBuf], sensors: usize, channel: &str) -> Figures {
    let names = record::names(sensors);
    let profile = machine(&names);
    let choice = Choice { keep: names.clone(), ..choice(&profile, "z", &["spindle_rpm".to_owned()]) };
    let mut dataset = Dataset::read(files, &Split::default(), &|_| None, &every_column).unwrap();
    let error = dataset.column(channel).unwrap();
    "z_error_um".clone_into(&mut dataset.columns[error].name);
    // The runs follow each other by a day.
    for (run, days) in dataset.runs.iter_mut().zip(1..) {
        run.times.iter_mut().for_each(|time| *time = time.after(Duration::from_hours(24) * days));
    }
    let later = dataset.runs.split_off(COMMISSIONED);
    let growth = growth(&profile, &dataset, &choice);
    let (mut learning, _) = Learning::restore("z", Vec::new(), None);
    let end = Some(Moment::from_nanos(u64::MAX));
    learning.take(&profile, dataset.clone(), (&choice, None), end).unwrap();
    let nothing = InUse::of(&machine_without_model(&names), "z").unwrap();
    let stays = nothing.replaced_by(&learning.candidate().unwrap());
    let mut in_use = stays.clone();
    learning.compare_with(Some(&in_use));
    let (mut chance, mut found) = (Pcg64Mcg::seed_from_u64(53), Figures::default());
    let mut ratios: VecDeque<f64> = VecDeque::new();
    for run in later {
        let single = Dataset { runs: vec![run], ..dataset.clone() };
        let candidate = in_use.replaced_by(&learning.candidate().unwrap());
        let of = |model: &InUse| rows(&profile, &single, &choice, model).unwrap();
        found.left[0].push(spread(&of(&nothing).error));
        for (place, model) in [(1, &stays), (2, &candidate), (3, &in_use)] {
            found.left[place].push(spread(&of(model).left()));
        }
        bar(&of(&in_use), growth, &mut ratios, &mut found.inside);
        let touches = touched(&single, error, &mut chance);
        let taken = learning.take(&profile, touches, (&choice, Some(&in_use)), end).unwrap();
        taken
            .iter()
            .filter_map(|run| run.skipped.as_ref())
            .for_each(|why| println!("{channel:7} left out: {why}"));
        if learning.judgement().is_better() {
            in_use = in_use.replaced_by(&learning.candidate().unwrap());
            learning.adopted(&in_use);
        }
    }
    found
}

/// Profile with these signals and one axis without a model.
fn machine_without_model(names: &[String]) -> Profile {
    let text = record::text(names, "");
    isotherm_profile::parse(std::path::Path::new("record.toml"), &text, &[], &[]).unwrap().profile
}

/// Returns the growth of the variance since the datum, a and b, from the runs of the commissioning.
fn growth(profile: &Profile, dataset: &Dataset, choice: &Choice) -> [f64; 2] {
    let ready = ready(profile, dataset, choice).unwrap();
    let found = identify(&ready, &Settings::default(), None, false, &|_, _| {}).unwrap();
    found.expected.unwrap().since_datum
}

/// Replaces the errors of a run by hourly touches.
fn touched(single: &Dataset, error: usize, chance: &mut Pcg64Mcg) -> Dataset {
    let mut touched = single.clone();
    touched.columns[error] = Column { name: "z_measured_um".to_owned(), kind: Kind::Displacement };
    for run in &mut touched.runs {
        touch(run, error, chance);
    }
    touched
}

fn touch(run: &mut Run, error: usize, chance: &mut Pcg64Mcg) {
    // The first value is the datum, which the machine takes as zero.
    let zero = run.values[error].iter().copied().find(|value| value.is_finite()).unwrap_or_default();
    let hours: Vec<f64> = run.seconds().map(|second| second / 3600.0).collect();
    let mut last = 0.0;
    for (value, hour) in run.values[error].iter_mut().zip(hours) {
        let is_touch = value.is_finite() && hour.floor() > last;
        if is_touch {
            last = hour.floor();
            // The sum of twelve uniform random numbers is nearly normal.
            let noise = (0..12).map(|_| chance.random_range(-0.5..0.5)).sum::<f64>();
            *value += SIGMA * noise - zero;
        } else {
            *value = f64::NAN;
        }
    }
}

/// Returns the range and the root mean square of a run.
fn spread(left: &[f64]) -> (f64, f64) {
    let range = left.iter().copied().fold(f64::MIN, f64::max) - left.iter().copied().fold(f64::MAX, f64::min);
    (range, mean(left.iter().map(|left| left * left)).sqrt())
}

/// Counts the rows of a run within one and within two times the expected error, which each hourly touch scales.
fn bar(
    run: &isotherm_identify::learning::ModelRows,
    [a, b]: [f64; 2],
    ratios: &mut VecDeque<f64>,
    inside: &mut [usize; 3],
) {
    const KEPT: usize = 24;
    const COMMISSIONING: f64 = 8.0;
    let mut last = 0.0;
    for (hour, left) in run.hours.iter().zip(run.left()) {
        let variance = a * hour + b;
        #[allow(clippy::cast_precision_loss, reason = "24 touches")]
        let touches = ratios.len() as f64;
        let scale = (COMMISSIONING + ratios.iter().sum::<f64>()) / (COMMISSIONING + touches);
        for (place, times) in [(0, 1.0), (1, 4.0)] {
            inside[place] += usize::from(left * left <= times * scale * variance);
        }
        inside[2] += 1;
        if hour.floor() > last && variance > 0.0 {
            last = hour.floor();
            if ratios.len() >= KEPT {
                ratios.pop_front();
            }
            ratios.push_back(left * left / variance);
        }
    }
}
