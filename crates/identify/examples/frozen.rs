//! Simulates frozen sensors on two public data sets. The example runs the compensation step of the gateway over the
//! logs. It prints the false alarms, the time to detection, and the growth of the error range. The model, its stand-ins
//! (estimates that replace a sensor) and its envelope (valid range of the inputs) are identified from the other runs.
//!
//! ```text
//! cargo run --release -p isotherm-identify --example frozen -- --mill runs/c*.csv --stage runs/day*.csv
//! ```
//!
//! The head of the example `held_out` describes the data sets. The exit status is 1 if a result is outside its limit.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "an example may panic if it cannot continue"
)]

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use isotherm_core::compensation::model::Outside;
use isotherm_core::compensation::{Compensation, Control, Permit, Remembered, Snapshot};
use isotherm_core::reading::{Reading, Reason};
use isotherm_identify::dataset::{Dataset, Run, Split, every_column};
use isotherm_identify::identify;
use isotherm_identify::method::Settings;
use isotherm_identify::setup::{Choice, ready};
use isotherm_identify::written::written;
use isotherm_profile::Profile;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use record::{machine, mean};

mod record;

/// Maximum accepted growth of the error range when one sensor freezes, in percent. The growth is the mean over all
/// sensors and error channels of a data set.
const GROWTH: f64 = 8.0;
/// Maximum accepted median of the time from the freeze of a sensor to its detection, min.
const FOUND: f64 = 240.0;
/// Number of simulated freezes of each sensor in each run. Each freeze begins at another random row.
const TIMES: usize = 2;

fn main() -> ExitCode {
    let Some([mill, stage]) = record::files("frozen") else { return ExitCode::FAILURE };
    let mut is_reached = true;
    for (name, files, sensors, errors) in
        [("mill", mill, 16, ["ch1_um", "ch3_um", "ch5_um"]), ("stage", stage, 4, ["x_um", "y_um", "z_um"])]
    {
        if !files.is_empty() {
            is_reached &= record(name, &files, &record::names(sensors), &errors);
        }
    }
    if is_reached { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Result of one simulated freeze of a sensor.
struct Case {
    /// Minutes from the freeze until the sensor was suspected to be frozen; `None` if it was never suspected.
    found: Option<f64>,
    /// Whether a stand-in (an estimate from other sensors) replaced the sensor.
    replaced: bool,
    /// Error range with the frozen sensor, divided by the error range without the freeze.
    growth: f64,
}

/// Simulates the freezes on one data set, and prints the results. Returns whether all results are within their limits.
fn record(name: &str, files: &[PathBuf], names: &[String], errors: &[&str]) -> bool {
    let dataset = Dataset::read(files, &Split::default(), &|_| None, &every_column).unwrap();
    let hours: f64 = dataset.runs.iter().map(hours).sum();
    let (mut alarms, mut growths, mut found) = (0, Vec::new(), Vec::new());
    for error in errors {
        let mut chance = Pcg64::seed_from_u64(1);
        let mut cases = Vec::new();
        for place in 0..dataset.runs.len() {
            let profile = learned(&dataset, place, names, error);
            let run = &dataset.runs[place];
            let column = |name: &String| dataset.column(name).unwrap();
            let columns: Vec<usize> = names.iter().map(column).collect();
            let error = run.values[dataset.column(error).unwrap()].to_vec();
            let seen = |run: &Run| seen(&profile, run, (names, &columns), &error);
            let whole = seen(run);
            alarms += whole.suspected.len();
            for (sensor, column) in columns.iter().copied().enumerate() {
                for _ in 0..TIMES {
                    let rows = run.times.len();
                    let at = chance.random_range(rows / 20..rows * 9 / 10);
                    let mut frozen = run.clone();
                    let stays = run.values[column].at(at);
                    frozen.values[column].change(|values| values[at..].fill(stays));
                    let with = seen(&frozen);
                    let own = with.suspected.iter().find(|(suspected, _)| *suspected == sensor);
                    let after = |row: usize| run.times[row].since(run.times[at]).as_secs_f64() / 60.0;
                    let growth = with.range / whole.range;
                    let replaced = with.replaced.contains(&sensor);
                    cases.push(Case { found: own.map(|(_, row)| after(*row)), replaced, growth });
                }
            }
        }
        let growth = 100.0 * (mean(cases.iter().map(|case| case.growth)) - 1.0);
        println!("{name} {error}: the error range grows by {growth:.1} %");
        let groups = [("not found", false, false), ("found only", true, false), ("replaced", true, true)];
        for (words, is_found, replaced) in groups {
            let of =
                cases.iter().filter(|case| case.found.is_some() == is_found && case.replaced == replaced);
            let growths: Vec<f64> = of.map(|case| 100.0 * (case.growth - 1.0)).collect();
            if !growths.is_empty() {
                let (share, most) = (growths.len(), growths.iter().copied().fold(0.0, f64::max));
                let growth = mean(growths.into_iter());
                println!(
                    "  {words}: {share} of {} freezes, growth of the error range {growth:.1} % (mean), \
                     {most:.0} % (maximum)",
                    cases.len()
                );
            }
        }
        growths.push(growth);
        found.extend(cases.iter().map(|case| case.found.unwrap_or(f64::INFINITY)));
    }
    found.sort_by(f64::total_cmp);
    let (growth, median) = (mean(growths.into_iter()), found[found.len() / 2]);
    let share = mean(found.iter().map(|minutes| f64::from(u8::from(minutes.is_finite()))));
    let reached = |is_reached: bool| if is_reached { "reached" } else { "MISSED" };
    let limits = [alarms == 0, growth <= GROWTH, median <= FOUND];
    println!(
        "{name}: {alarms} false alarms in {hours:.0} h of {} error channels, at most 0 are allowed: {}",
        errors.len(),
        reached(limits[0])
    );
    println!(
        "{name}: the error range grows by {growth:.1} %, at most {GROWTH} % is allowed: {}",
        reached(limits[1])
    );
    println!(
        "{name}: {:.0} % of the freezes are detected; median time {median:.0} min, at most {FOUND} min is \
         allowed: {}",
        100.0 * share,
        reached(limits[2])
    );
    limits.into_iter().all(|is_reached| is_reached)
}

fn hours(run: &Run) -> f64 {
    let (first, last) = (run.times.first().copied().unwrap_or_default(), run.times.last().copied());
    last.map_or(0.0, |last| last.since(first).as_secs_f64() / 3600.0)
}

/// Returns the profile with the model that is identified from all runs except the run `without`.
fn learned(dataset: &Dataset, without: usize, names: &[String], error: &str) -> Profile {
    let mut others = dataset.clone();
    others.runs.remove(without);
    let choice = Choice {
        axis: Some("z".to_owned()),
        error: Some(error.to_owned()),
        // No fault is repaired: the figures are those of the record as it is.
        keep: names.to_vec(),
        resample: Duration::from_secs(60),
        ..Choice::default()
    };
    let profile = machine(names);
    let ready = ready(&profile, &others, &choice).unwrap();
    let found = identify(&ready, &Settings::default(), None, true, &|_, _| {}).unwrap();
    let block = written(&found, "z", Outside::Agree);
    let directory = tempfile::tempdir().unwrap();
    for (name, content) in &block.files {
        std::fs::write(directory.path().join(name), content).unwrap();
    }
    let path = directory.path().join("record.toml");
    std::fs::write(&path, record::text(names, &block.block)).unwrap();
    isotherm_profile::load(&path, &[], &[]).unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Result of the compensation step for the axis in one run.
struct Seen {
    /// Sensors that were suspected to be frozen, each with the log row in which it was first suspected.
    suspected: Vec<(usize, usize)>,
    /// Indices of the sensors that a stand-in (an estimate from the other sensors) replaced.
    replaced: Vec<usize>,
    /// Range of the residual error, µm. The Cz (compensation value) that the model requests is added without the limits
    /// of the axis.
    range: f64,
}

/// Runs the gateway's compensation step over the rows of a run. `names` contains the names of the sensors, and
/// `columns` the indices of their log columns. `error` is the measured error in each row, µm.
fn seen(profile: &Profile, run: &Run, (names, columns): (&[String], &[usize]), error: &[f64]) -> Seen {
    let place = |name: &String| names.iter().position(|known| known == name);
    let sensors: Vec<Option<usize>> = profile.signals.iter().map(|signal| place(&signal.name)).collect();
    let axes = vec![profile.axes[0].settings.clone()];
    let mut compensation = Compensation::new(profile.machine.clone(), axes, Remembered::default());
    let control = Control { permit: Permit::Armed, ..Control::default() };
    let mut replaced = Vec::new();
    let (mut suspected, mut least, mut most): (Vec<(usize, usize)>, f64, f64) =
        (Vec::new(), f64::INFINITY, f64::NEG_INFINITY);
    for (row, now) in run.times.iter().copied().enumerate() {
        let value =
            |sensor: usize| Some(run.values[columns[sensor]].at(row)).filter(|value| value.is_finite());
        let reading = |sensor: &Option<usize>| match sensor.and_then(value) {
            Some(value) => Reading::good(value, now),
            None => Reading::bad(now, Reason::NotInLog),
        };
        let readings: Vec<Reading> = sensors.iter().map(reading).collect();
        compensation.step(&Snapshot::new(now, &readings), &[control]);
        for found in compensation.rejected(0) {
            let Some(sensor) = sensors[found.signal.0] else { continue };
            if found.others.is_some() && !replaced.contains(&sensor) {
                replaced.push(sensor);
            }
            if !suspected.iter().any(|(known, _)| *known == sensor) {
                suspected.push((sensor, row));
            }
        }
        let target = compensation.decision(0).and_then(|decision| decision.raw);
        let left = error[row] + target.map_or(0.0, |target| target.get());
        if left.is_finite() {
            (least, most) = (least.min(left), most.max(left));
        }
    }
    Seen { suspected, replaced, range: most - least }
}
