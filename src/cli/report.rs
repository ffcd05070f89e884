//! `isotherm report`: reports the thermal drift in logs, in the terms of ISO 230-3.

use std::io::Write;
use std::path::PathBuf;

use clap::builder::TypedValueParser;

use super::columns::ColumnTable;
use super::extra_files::ExtraFiles;
use super::loading::load_with;
use super::print::print_json;
use super::progress::Progress;
use super::runs::Runs;
use super::values::one_of;
use crate::cli::print::Out;
use crate::clock::Clock;
use isotherm_identify::applied::{Applied, add_without_cz};
use isotherm_identify::dataset::{Column, Kind};
use isotherm_identify::drift::{Drift, Test, drift};
use isotherm_identify::setup::units;
use isotherm_identify::{report, uses};

mod text;

/// Reports the drift in logs in the terms of ISO 230-3: how far each displacement moved, when, and the state of the
/// machine then.
///
/// The report only describes a log. You are responsible for the durations and conditions that the standard requires. A
/// log is CSV with a column `time`, `time_s` or `time_min`. `time` is in seconds, RFC 3339, or `05.01.2026 06:00:10` by
/// the clock of --zone. Displacements are in columns whose names end with `_um`. Other columns are temperatures, speeds
/// (`_rpm`), positions (`_mm`) and angles (`_deg`).
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm report night.csv\n  isotherm report warm-up.csv --test spindle --displacement z_error_um\n  isotherm report day7.csv --profile surface-grinder --json"
)]
pub(super) struct Arguments {
    /// The logs; each run is reported separately
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,
    /// Test of the standard that the logs represent [default: detected from their columns]
    #[arg(long, value_parser = tests())]
    test: Option<Test>,
    /// The columns of displacements, µm [default: every column whose name ends with _um]
    #[arg(long, value_name = "COLUMN", value_delimiter = ',')]
    displacement: Vec<String>,
    /// The column with the Cz that acted on the displacements during the measurement, µm. `none` means that no Cz acted
    /// [default: as a log of the gateway says]
    #[arg(long, value_name = "COLUMN")]
    cz: Option<String>,
    /// Writes a page with diagrams as one file, for any browser
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
    /// The machine's profile, for the units of its signals
    #[arg(long, value_name = "PROFILE")]
    profile: Option<PathBuf>,
    #[command(flatten)]
    runs: Runs,
    /// Prints one JSON document
    #[arg(long)]
    json: bool,
}

/// Returns a parser for the tests of ISO 230-3 by their names on the command line.
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
    let mut dataset =
        arguments.runs.read(&arguments.logs, ("gauge_um", &arguments.displacement), &unit, &uses)?;
    let mut displacements = arguments.displacement.clone();
    add_without_cz(&mut dataset, profile.as_ref(), &mut displacements, &applied)?;
    let working = Progress::begin("calculating the drift of each run");
    let drifts = drift(&dataset, &displacements, arguments.test, &unit)?;
    drop(working);
    let mut beside = ExtraFiles::default();
    if let Some(path) = &arguments.report {
        let page = report::drift_page(&dataset, &drifts, profile.as_ref(), Clock::wall().time_of_day());
        beside.write("the report", path, page);
    }
    let is_used = |column: &Column| {
        let of_run = |drift: &Drift| drift.displacements.iter().any(|moved| moved.name == column.name);
        // Angles move a rotary axis.
        column.kind != Kind::Other || column.name.ends_with("_deg") || drifts.iter().any(of_run)
    };
    let columns = ColumnTable::new(&dataset, &is_used);
    if arguments.json {
        print_json(&serde_json::json!({ "runs": drifts, "columns": columns }))?;
        return beside.end(true);
    }
    let mut out = Out;
    for (place, drift) in drifts.iter().enumerate() {
        if place > 0 {
            writeln!(out)?;
        }
        text::render(&mut out, drift)?;
    }
    columns.render(&mut out)?;
    if arguments.report.is_some() {
        writeln!(out)?;
    }
    beside.end(false)
}
