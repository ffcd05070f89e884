//! `isotherm report`: what logs say about drift, in the terms of ISO 230-3.

use std::path::PathBuf;
use std::time::Duration;

use super::{Failure, load_with, print_json};
use crate::identify::dataset::{Dataset, Split};
use crate::identify::drift::{Test, drift};

mod told;

/// Drift of logs in the terms of ISO 230-3: how far each displacement went, when, and what the machine did meanwhile.
///
/// It describes a log; the durations and limits of the standard are yours to keep. A log is CSV: a column `time`
/// (seconds, or RFC 3339), `time_s` or `time_min`, displacements in columns that end with `_um`, temperatures, and what
/// turned or moved: speeds (`_rpm`), positions (`_mm`), angles (`_deg`).
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm report night.csv\n  isotherm report warm-up.csv --test spindle --displacement z_error_um\n  isotherm report day7.csv --profile surface-grinder --json"
)]
pub(super) struct Arguments {
    /// The logs; each run is told for itself
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,
    /// What the logs are taken for, instead of what their columns say
    #[arg(long, value_enum)]
    test: Option<Test>,
    /// The displacements, µm, instead of every column that ends with _um
    #[arg(long, value_name = "COLUMN", value_delimiter = ',')]
    displacement: Vec<String>,
    /// The machine's profile, which knows the units of its signals
    #[arg(long, value_name = "PROFILE")]
    profile: Option<PathBuf>,
    /// A new run begins where this column changes
    #[arg(long, value_name = "COLUMN")]
    run_column: Option<String>,
    /// A new run begins after so long without a row
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    gap: Option<Duration>,
    /// One JSON document
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let profile = match &arguments.profile {
        Some(path) => Some(load_with(path, &[], arguments.json)?),
        None => None,
    };
    let unit = |name: &str| {
        let signals = profile.iter().flat_map(|profile| &profile.signals);
        signals.clone().find(|signal| signal.name == name).map(|signal| signal.unit.0)
    };
    let split = Split { column: arguments.run_column.clone(), gap: arguments.gap };
    let dataset = Dataset::read(&arguments.logs, &split, &unit).map_err(anyhow::Error::from)?;
    let drifts =
        drift(&dataset, &arguments.displacement, arguments.test, &unit).map_err(anyhow::Error::from)?;
    if arguments.json {
        return print_json(&serde_json::json!({ "runs": drifts }));
    }
    for (place, drift) in drifts.iter().enumerate() {
        if place > 0 {
            println!();
        }
        print!("{}", told::told(drift));
    }
    Ok(())
}
