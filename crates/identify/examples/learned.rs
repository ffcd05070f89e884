//! Test of learning from touches (measurements with a probe) on two public data sets, in the order of time.
//!
//! ```text
//! cargo run --release -p isotherm-identify --example learned -- --mill runs/c*.csv --stage runs/day*.csv
//! ```
//!
//! The head of the example `held_out` describes the data sets. The first three runs are the commissioning: their errors
//! are known in each row. Each later run first tests the model on all rows of the run. Then the model learns from the
//! hourly touches of that run (σ 0.5 µm). The results are means over several random seeds for the measurement errors of
//! the touches. The example fails if a result is outside its limit.
//!
//! The limits apply only to error channels with at least six runs. The candidate is the model from all runs
//! so far. On the fourth day, it still equals the model of the commissioning. A different candidate is first
//! tested on the fifth day, and can be used from the sixth day on.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "an example may panic if it cannot continue"
)]

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use isotherm_core::compensation::ErrorScale;
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

/// Number of runs that are used for the commissioning.
const COMMISSIONED: usize = 3;
/// Minimum number of runs of an error channel to which the limits apply.
const ENOUGH_RUNS: usize = 6;
/// Standard deviation of the measurement error of a touch (measurement with a probe), µm.
const SIGMA: f64 = 0.5;
/// Maximum geometric mean over all channels of the ratio of the residual error to that of the unchanged model. This
/// limit applies to the range and to the root mean square.
const MEAN: f64 = 0.9;
/// Maximum ratio of the residual error of any single channel to that of the unchanged model.
const WORST: f64 = 1.08;
/// Smallest and largest accepted share of the log rows whose residual error is within the expected error, and
/// within twice the expected error. The expected error is a predicted standard deviation.
const INSIDE: [(f64, f64); 2] = [(0.55, 0.88), (0.82, 0.99)];

/// Number of random seeds for the measurement errors of the touches.
const SEEDS: u64 = 5;
/// Models whose residual errors are printed, in this order.
const MODELS: [&str; 5] = [
    "without compensation",
    "model that stays",
    "candidate of each day",
    "judged candidate",
    "full sensor every day",
];
/// Index in [`MODELS`] of the unchanged model of the commissioning. `JUDGED` below is the index of the tested
/// candidate.
const STAYS: usize = 1;
const JUDGED: usize = 3;

/// Residual errors of an error channel over the runs after the commissioning.
#[derive(Default)]
struct Figures {
    /// Range and root mean square of the residual error of each run, µm, with each of the [`MODELS`].
    left: [Vec<(f64, f64)>; 5],
    /// Number of rows whose residual is within the expected error, number of rows within twice the expected error, and
    /// number of all rows.
    inside: [usize; 3],
}

/// Results of the error channels that have limits.
#[derive(Default)]
struct Limited {
    /// For each channel: range and root mean square of the residual error with the tested candidate, divided by those
    /// with the unchanged model.
    ratios: Vec<[f64; 2]>,
    /// For each channel: whether the shares of rows within the expected error are within the limits [`INSIDE`].
    bars: Vec<bool>,
    /// Number of rows of all channels whose residual is within the expected error, number of rows within twice the
    /// expected error, and number of all rows.
    inside: [usize; 3],
}

fn main() -> ExitCode {
    let Some(files) = record::files("learned") else { return ExitCode::FAILURE };
    let mill = ["ch1_um", "ch2_um", "ch3_um", "ch4_um", "ch5_um"];
    let stage = ["x_um", "y_um", "z_um"];
    let mut all_reached = true;
    for (name, files, sensors, channels, without) in [
        ("machining centre", &files[0], 16, &mill[..], &["spindle_rpm"][..]),
        ("machining centre with spindle speed", &files[0], 16, &mill[..], &[][..]),
        ("positioning machine", &files[1], 4, &stage[..], &["spindle_rpm"][..]),
    ] {
        if files.is_empty() {
            continue;
        }
        println!("{name}");
        let mut limited = Limited::default();
        for channel in channels {
            let record = Record { files, sensors, channel, without };
            let mut found = Figures::default();
            (0..SEEDS).for_each(|seed| record.learned(seed, &mut found));
            let alone: Vec<(f64, f64)> = (0..SEEDS).flat_map(|seed| record.alone(seed)).collect();
            let none = mean(alone.iter().map(|run| run.0.powi(2))).sqrt();
            let left = mean(alone.iter().map(|run| run.1.powi(2))).sqrt();
            println!(
                "{channel:7} from touches only       RMS {left:.2} µm, without compensation {none:.2} µm"
            );
            said(channel, &found, files.len() >= ENOUGH_RUNS, &mut limited);
        }
        all_reached &= limited.are_reached();
    }
    if all_reached { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

impl Limited {
    /// Prints the results of all channels with their limits. Returns whether all results are within their limits.
    fn are_reached(&self) -> bool {
        if self.ratios.is_empty() {
            return true;
        }
        let mut is_reached = self.bars.iter().all(|is_reached| *is_reached);
        is_reached &= are_inside("all", self.inside, true);
        for (place, name) in ["range", "RMS"].iter().enumerate() {
            let ratios = || self.ratios.iter().map(|ratio| ratio[place]);
            let (geometric, worst) = (mean(ratios().map(f64::ln)).exp(), ratios().fold(f64::MIN, f64::max));
            println!(
                "{name:5} ratio to the unchanged model: geometric mean {geometric:.2}, at most {MEAN}: {}",
                reached(geometric <= MEAN)
            );
            println!(
                "{name:5} ratio to the unchanged model: worst channel {worst:.2}, at most {WORST}: {}",
                reached(worst <= WORST)
            );
            is_reached &= geometric <= MEAN && worst <= WORST;
        }
        is_reached
    }
}

/// Prints the results of one channel. If `is_limited`, also adds them to `limited`.
fn said(channel: &str, found: &Figures, is_limited: bool, limited: &mut Limited) {
    let of = |place: usize| {
        let runs = &found.left[place];
        [mean(runs.iter().map(|run| run.0)), mean(runs.iter().map(|run| run.1))]
    };
    let stays = of(STAYS);
    for (place, name) in MODELS.iter().enumerate() {
        let [range, rms] = of(place);
        let (of_range, of_rms) = (range / stays[0], rms / stays[1]);
        println!("{channel:7} {name:22} {range:6.2} µm, RMS {rms:5.2} µm   {of_range:.2} / {of_rms:.2}");
    }
    let bar = are_inside(channel, found.inside, is_limited);
    if is_limited {
        let judged = of(JUDGED);
        limited.ratios.push([judged[0] / stays[0], judged[1] / stays[1]]);
        limited.bars.push(bar);
        limited.inside.iter_mut().zip(found.inside).for_each(|(all, own)| *all += own);
    }
}

/// Prints the shares of the rows whose residual is within the expected error, and within twice the expected error.
/// Returns whether both shares are within their limits.
fn are_inside(name: &str, [one, two, all]: [usize; 3], is_limited: bool) -> bool {
    let mut are_reached = true;
    for (times, inside, (least, most)) in [("one", one, INSIDE[0]), ("two", two, INSIDE[1])] {
        #[allow(clippy::cast_precision_loss, reason = "some thousand rows")]
        let share = inside as f64 / all.max(1) as f64;
        let is_reached = (least..=most).contains(&share);
        are_reached &= is_reached;
        let limit = if is_limited { reached(is_reached) } else { "no limit" };
        println!("{name:7} inside {times} times expected {share:5.3}, allowed {least} to {most}: {limit}");
    }
    are_reached
}

fn reached(is_reached: bool) -> &'static str {
    if is_reached { "reached" } else { "MISSED" }
}

/// One error channel of a public data set.
struct Record<'a> {
    files: &'a [PathBuf],
    /// Number of temperature sensors in the data set.
    sensors: usize,
    channel: &'a str,
    /// Names of the signals that are excluded from the model.
    without: &'a [&'a str],
}

impl Record<'_> {
    fn machine(&self) -> (Profile, Choice) {
        let names = record::names(self.sensors);
        let profile = machine(&names);
        let without: Vec<String> = self.without.iter().map(|name| (*name).to_owned()).collect();
        let choice = Choice { keep: names, ..choice(&profile, "z", &without) };
        (profile, choice)
    }

    /// Reads the runs. Changes their times, so that each run is one day after the previous run. Also returns the index
    /// of the column with the error.
    fn dataset(&self) -> (Dataset, usize) {
        let mut dataset = Dataset::read(self.files, &Split::default(), &|_| None, &every_column).unwrap();
        let error = dataset.column(self.channel).unwrap();
        "z_error_um".clone_into(&mut dataset.columns[error].name);
        for (run, days) in dataset.runs.iter_mut().zip(1..) {
            run.times.iter_mut().for_each(|time| *time = time.after(Duration::from_hours(24) * days));
        }
        (dataset, error)
    }

    /// Returns a model without terms, for comparison. Its Cz (compensation value) is always zero.
    fn nothing(&self) -> InUse {
        InUse::of(&machine_without_model(&record::names(self.sensors)), "z").unwrap()
    }

    /// Learns a model of the channel from touches alone, without a commissioning. Returns two root mean squares for
    /// each run after the first, µm: the error without compensation, and the residual error with the candidate of that
    /// day. Both are calculated at the touches.
    fn alone(&self, seed: u64) -> Vec<(f64, f64)> {
        let ((profile, choice), (mut dataset, error)) = (self.machine(), self.dataset());
        let nothing = self.nothing();
        let (mut learning, _) = Learning::restore("z", Vec::new(), None);
        let mut chance = Pcg64Mcg::seed_from_u64(53 + seed);
        let mut judged = Vec::new();
        for run in std::mem::take(&mut dataset.runs) {
            let single = Dataset { runs: vec![run], ..dataset.clone() };
            let touches = touched(&single, error, &errors(&mut chance));
            let end = Some(Moment::from_nanos(u64::MAX));
            let taken = learning.take(&profile, touches, (&choice, Some(&nothing)), end).unwrap();
            judged.extend(taken.iter().filter_map(|run| run.judged));
        }
        judged.iter().map(|run| (run.in_use_um, run.candidate_um)).collect()
    }

    /// Learns a model of the channel run by run, in the order of time.
    fn learned(&self, seed: u64, found: &mut Figures) {
        let (profile, choice) = self.machine();
        let (mut dataset, error) = self.dataset();
        let later = dataset.runs.split_off(COMMISSIONED);
        let growth = growth(&profile, &dataset, &choice);
        let (mut learning, _) = Learning::restore("z", Vec::new(), None);
        let end = Some(Moment::from_nanos(u64::MAX));
        learning.take(&profile, dataset.clone(), (&choice, None), end).unwrap();
        let mut full = learning.clone();
        let nothing = self.nothing();
        let stays = nothing.replaced_by(&learning.candidate().unwrap());
        let mut in_use = stays.clone();
        learning.compare_with(Some(&in_use));
        let mut chance = Pcg64Mcg::seed_from_u64(53 + seed);
        let mut scale = ErrorScale::new();
        for run in later {
            let single = Dataset { runs: vec![run], ..dataset.clone() };
            let candidate = in_use.replaced_by(&learning.candidate().unwrap());
            let of_full = in_use.replaced_by(&full.candidate().unwrap());
            let of = |model: &InUse| rows(&profile, &single, &choice, model).unwrap();
            found.left[0].push(spread(&of(&nothing).error));
            for (place, model) in [(STAYS, &stays), (2, &candidate), (JUDGED, &in_use), (4, &of_full)] {
                found.left[place].push(spread(&of(model).left()));
            }
            let errors = errors(&mut chance);
            bar(&of(&in_use), (growth, &errors), &mut scale, &mut found.inside);
            full.take(&profile, single.clone(), (&choice, None), end).unwrap();
            let touches = touched(&single, error, &errors);
            let taken = learning.take(&profile, touches, (&choice, Some(&in_use)), end).unwrap();
            taken
                .iter()
                .filter_map(|run| run.skipped.as_ref())
                .for_each(|why| println!("{:7} left out: {why}", self.channel));
            if learning.judgement().is_better() {
                in_use = in_use.replaced_by(&learning.candidate().unwrap());
                learning.adopted(&in_use);
            }
        }
    }
}

/// Returns random measurement errors of the touches of one run, one for each hour, µm.
fn errors(chance: &mut Pcg64Mcg) -> Vec<f64> {
    // The sum of twelve uniform random numbers is nearly normal.
    let mut normal = || (0..12).map(|_| chance.random_range(-0.5..0.5)).sum::<f64>();
    (0..=24).map(|_| SIGMA * normal()).collect()
}

/// Returns the measurement error of the touch in the hour `hour` of a run, µm.
fn error_at(errors: &[f64], hour: f64) -> f64 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "hours of a day")]
    let hour = hour as usize;
    errors.get(hour).copied().unwrap_or_default()
}

/// Returns a profile with these signals and one axis without a model.
fn machine_without_model(names: &[String]) -> Profile {
    let text = record::text(names, "");
    isotherm_profile::parse(std::path::Path::new("record.toml"), &text, &[], &[]).unwrap().profile
}

/// Returns the coefficients a and b of the expected error: σ² = a·h + b, with h in hours since the datum (zero point).
/// They are estimated from the runs of the commissioning.
fn growth(profile: &Profile, dataset: &Dataset, choice: &Choice) -> [f64; 2] {
    let ready = ready(profile, dataset, choice).unwrap();
    let found = identify(&ready, &Settings::default(), None, false, &|_, _| {}).unwrap();
    found.expected.unwrap().since_datum
}

/// Replaces the errors of a run by hourly touches. `errors` contains the measurement error of the touch in each hour,
/// µm.
fn touched(single: &Dataset, error: usize, errors: &[f64]) -> Dataset {
    let mut touched = single.clone();
    touched.columns[error] = Column { name: "z_measured_um".to_owned(), kind: Kind::Displacement };
    for run in &mut touched.runs {
        touch(run, error, errors);
    }
    touched
}

fn touch(run: &mut Run, error: usize, errors: &[f64]) {
    // The first value is the datum, which the machine takes as zero.
    let zero = run.values[error].iter().find(|value| value.is_finite()).unwrap_or_default();
    let hours: Vec<f64> = run.seconds().map(|second| second / 3600.0).collect();
    let mut last = 0.0;
    run.values[error].change(|values| {
        for (value, hour) in values.iter_mut().zip(hours) {
            let is_touch = value.is_finite() && hour.floor() > last;
            if is_touch {
                last = hour.floor();
                *value += error_at(errors, last) - zero;
            } else {
                *value = f64::NAN;
            }
        }
    });
}

/// Returns the range and the root mean square of the residual errors of a run, µm.
fn spread(left: &[f64]) -> (f64, f64) {
    let range = left.iter().copied().fold(f64::MIN, f64::max) - left.iter().copied().fold(f64::MAX, f64::min);
    (range, mean(left.iter().map(|left| left * left)).sqrt())
}

/// Counts the rows of a run whose residual is within the expected error, and within twice the expected error. Each
/// hourly touch scales the expected error.
fn bar(
    run: &isotherm_identify::learning::ModelRows,
    ([a, b], errors): ([f64; 2], &[f64]),
    scale: &mut ErrorScale,
    inside: &mut [usize; 3],
) {
    let mut last = 0.0;
    for (hour, left) in run.hours.iter().zip(run.left()) {
        let variance = a * hour + b;
        for (place, times) in [(0, 1.0), (1, 4.0)] {
            inside[place] += usize::from(left * left <= times * scale.factor() * variance);
        }
        inside[2] += 1;
        if hour.floor() > last {
            last = hour.floor();
            scale.take(left + error_at(errors, last), variance, SIGMA);
        }
    }
}
