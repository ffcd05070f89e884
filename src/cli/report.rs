//! `isotherm report`: what logs say about drift, in the terms of ISO 230-3.

use std::io::Write;
use std::path::PathBuf;

use clap::builder::TypedValueParser;

use super::beside::Beside;
use super::identify::one_of;
use super::progress::Progress;
use super::runs::Runs;
use super::{load_with, print_json};
use crate::cli::say::Out;
use crate::clock::Clock;
use isotherm_identify::applied::{Applied, add_without_cz};
use isotherm_identify::drift::{Test, drift};
use isotherm_identify::setup::units;
use isotherm_identify::{report, uses};

mod text;

/// Drift of logs in the terms of ISO 230-3: how far each displacement went, when, and what the machine did meanwhile.
///
/// It describes a log; the durations and limits of the standard are yours to keep. A log is CSV: a column `time`
/// (seconds, RFC 3339, or `05.01.2026 06:00:10` by the clock of --zone), `time_s` or `time_min`, displacements in columns that end with `_um`, temperatures, and what
/// turned or moved: speeds (`_rpm`), positions (`_mm`), angles (`_deg`).
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm report night.csv\n  isotherm report warm-up.csv --test spindle --displacement z_error_um\n  isotherm report day7.csv --profile surface-grinder --json"
)]
pub(super) struct Arguments {
    /// The logs; each run is reported separately
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,
    /// What the logs are taken for, instead of what their columns say
    #[arg(long, value_parser = tests())]
    test: Option<Test>,
    /// The displacements, µm, instead of every column that ends with _um
    #[arg(long, value_name = "COLUMN", value_delimiter = ',')]
    displacement: Vec<String>,
    /// The column with the Cz that acted on the displacements while they were measured, µm; none: nothing acted [default: as
    /// a log of the gateway says]
    #[arg(long, value_name = "COLUMN")]
    cz: Option<String>,
    /// Writes a page with pictures that can be sent to anyone: one file, opened by any browser
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
    /// The machine's profile, which knows the units of its signals
    #[arg(long, value_name = "PROFILE")]
    profile: Option<PathBuf>,
    #[command(flatten)]
    runs: Runs,
    /// One JSON document
    #[arg(long)]
    json: bool,
}

/// The tests of ISO 230-3, as the command line names them.
fn tests() -> impl TypedValueParser<Value = Test> {
    one_of([
        (Test::Etve, "etve", "Environmental temperature variation error: nothing turns or moves"),
        (Test::Spindle, "spindle", "Thermal distortion by a rotating spindle"),
        (Test::Axis, "axis", "Thermal distortion by moving linear axes"),
        (Test::Rotary, "rotary", "Thermal distortion by rotary motion"),
    ])
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let profile = match &arguments.profile {
        Some(path) => Some(load_with(path, &[], arguments.json)?),
        None => None,
    };
    let unit = |name: &str| profile.as_ref().and_then(|profile| units(profile)(name));
    let applied = arguments.cz.as_deref().map(Applied::named).unwrap_or_default();
    let uses = uses::of_report(&arguments.displacement, &applied, &unit);
    let mut dataset = arguments.runs.read(&arguments.logs, "gauge_um", &unit, &uses)?;
    let mut displacements = arguments.displacement.clone();
    add_without_cz(&mut dataset, profile.as_ref(), &mut displacements, &applied)?;
    let working = Progress::begin("how far each run drifted");
    let drifts = drift(&dataset, &displacements, arguments.test, &unit)?;
    drop(working);
    let mut beside = Beside::default();
    if let Some(path) = &arguments.report {
        let page = report::drifted(&dataset, &drifts, profile.as_ref(), Clock::wall().time_of_day());
        beside.write("the report", path, page);
    }
    if arguments.json {
        print_json(&serde_json::json!({ "runs": drifts }))?;
        return beside.end(true);
    }
    let mut out = Out;
    for (place, drift) in drifts.iter().enumerate() {
        if place > 0 {
            writeln!(out)?;
        }
        text::render(&mut out, drift)?;
    }
    if arguments.report.is_some() {
        writeln!(out)?;
    }
    beside.end(false)
}
