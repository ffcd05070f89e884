//! Identifies one model of several machines of the same type, from the stored Gram products of the runs of
//! each machine. Gram products are sums of products of the model inputs with each other and with the error.
//! They do not contain single rows of the logs.
//!
//! ```text
//! cargo run -p isotherm-identify --example fleet -- keep mill-1.toml mill-1/*.csv > mill-1.products.json
//! cargo run -p isotherm-identify --example fleet -- keep mill-2.toml mill-2/*.csv > mill-2.products.json
//! cargo run -p isotherm-identify --example fleet -- learn mill-1.products.json mill-2.products.json
//! ```
//! Only the product files leave the machines, not the logs. Each profile must have exactly one axis. The measured error
//! is in the log column `<axis>_error_um`.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "an example prints its results")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use isotherm_identify::applied::Applied;
use isotherm_identify::dataset::{Dataset, Split, every_column};
use isotherm_identify::fleet::RunProducts;
use isotherm_identify::method::Settings;
use isotherm_identify::setup::{Choice, ready, units, without_cz};

fn main() -> ExitCode {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let done = match arguments.split_first() {
        Some((verb, [profile, logs @ ..])) if verb == Path::new("keep") => keep(profile, logs),
        Some((verb, files)) if verb == Path::new("learn") => learn(files),
        _ => Err("usage: fleet keep PROFILE LOG… > FILE for each machine, then fleet learn FILE…".to_owned()),
    };
    match done {
        Ok(text) => {
            print!("{text}");
            ExitCode::SUCCESS
        }
        Err(why) => {
            eprintln!("{why}");
            ExitCode::FAILURE
        }
    }
}

fn keep(profile: &Path, logs: &[PathBuf]) -> Result<String, String> {
    let profile = isotherm_profile::load(profile, &[], &[]).map_err(|errors| errors.to_string())?.profile;
    let choice = Choice { speeds: true, resample: Duration::from_mins(1), ..Choice::default() };
    let dataset = Dataset::read(logs, &Split::default(), &units(&profile), &every_column);
    let mut dataset = dataset.map_err(|why| why.to_string())?;
    // If a compensation was active during the measurement, the error contains its Cz.
    without_cz(&profile, &mut dataset, &choice, &Applied::default()).map_err(|why| why.to_string())?;
    let ready = ready(&profile, &dataset, &choice).map_err(|why| why.to_string())?;
    RunProducts::of(&ready, &profile.name, &Settings::default())?.to_json()
}

fn learn(files: &[PathBuf]) -> Result<String, String> {
    let mut fleet: Option<RunProducts> = None;
    for file in files {
        let told = |why: String| format!("{}: {why}", file.display());
        let bytes = std::fs::read(file).map_err(|why| told(why.to_string()))?;
        let products = RunProducts::from_json(&bytes).map_err(told)?;
        match &mut fleet {
            None => fleet = Some(products),
            Some(fleet) => fleet.add(&products).map_err(told)?,
        }
    }
    let model = fleet.ok_or("no file was named")?.learn();
    let shown = |left: Option<f64>| left.map_or("-".to_owned(), |left| format!("{left:.2}"));
    for run in &model.runs {
        eprintln!(
            "{} {}: RMS error {:.2} µm uncompensated, {} µm with a model from the other runs, {} µm with a \
             model from the other machines",
            run.machine,
            run.run,
            run.uncompensated_rms_um,
            shown(run.rms_um),
            shown(run.other_machines_rms_um)
        );
    }
    Ok(model.block())
}
