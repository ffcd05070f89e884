//! `isotherm select`: recommends the temperature points to keep.

use std::path::PathBuf;
use std::time::Duration;

use super::columns::ColumnTable;
use super::extra_files::ExtraFiles;
use super::print::print_json;
use super::progress::Progress;
use super::runs::Runs;
use crate::cli::print::Out;
use crate::clock::Clock;
use isotherm_identify::applied::{Applied, without_cz};
use isotherm_identify::dataset::{Column, Kind};
use isotherm_identify::select::{Selected, Settings, points, select, without_incomplete};
use isotherm_identify::setup::Choice;
use isotherm_identify::{report, uses};

mod text;

/// Recommends which temperature points to keep. For each number of points, it also shows the error that remains on a
/// run that was not used to fit the model (held out).
///
/// A log is CSV, as for identify; no profile is needed. Each column of temperatures is a point. The verb shows for each
/// point its correlation with the error and its grey relational grade, and groups of points with similar values. It
/// also shows the order in which partial F tests add points, and a recommendation from held-out runs.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm select mon.csv tue.csv wed.csv --error z_error_um\n  isotherm select week.csv --gap 2h --error z_error_um --report points.html"
)]
pub(super) struct Arguments {
    /// The log files
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,
    /// The column with the measured error e, µm
    #[arg(long, value_name = "COLUMN")]
    error: String,
    /// The column with the Cz that acted on the error during the measurement, µm. `none` means that no Cz acted
    /// [default: as a log of the gateway says]
    #[arg(long, value_name = "COLUMN")]
    cz: Option<String>,
    /// The columns of the temperature points [default: every column of temperatures]
    #[arg(long, value_name = "COLUMN", value_delimiter = ',')]
    inputs: Vec<String>,
    /// Temperature points that are not used
    #[arg(long, value_name = "COLUMN", value_delimiter = ',')]
    without: Vec<String>,
    /// Temperature points to keep in the selection although their readings look faulty
    #[arg(long, value_name = "COLUMN", value_delimiter = ',')]
    keep: Vec<String>,
    /// Temperature points form a group if each pair of them has at least this absolute correlation
    #[arg(long, value_name = "R", value_delimiter = ',', default_value = "0.9,0.7", value_parser = correlation)]
    group: Vec<f64>,
    /// Largest number of temperature points in one model
    #[arg(long, value_name = "K", default_value_t = 8, value_parser = clap::value_parser!(u8).range(1..=32))]
    most: u8,
    /// Time constants of the lags that are applied to each temperature point [default: 0s,6min,25min,100min]
    #[arg(long, value_name = "TIME", value_delimiter = ',', value_parser = humantime::parse_duration)]
    lags: Vec<Duration>,
    /// In F tests, rows that are closer in time than this count as one sample
    #[arg(long, value_name = "TIME", default_value = "30min", value_parser = humantime::parse_duration)]
    independent: Duration,
    /// Time over which rows are averaged after the lags were applied; 0s switches averaging off
    #[arg(long, value_name = "TIME", default_value = "1min", value_parser = humantime::parse_duration)]
    resample: Duration,
    #[command(flatten)]
    runs: Runs,
    /// Writes a page with diagrams as one file, for any browser
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
    /// Prints one JSON document
    #[arg(long)]
    json: bool,
}

/// JSON document that `isotherm select --json` prints.
#[derive(serde::Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    found: &'a Selected,
    columns: ColumnTable,
}

fn correlation(text: &str) -> Result<f64, String> {
    let value: f64 = text.trim().parse().map_err(|_| "write correlations as 0.9,0.7".to_owned())?;
    if (0.0..=1.0).contains(&value) {
        Ok(value)
    } else {
        Err("write correlations between 0 and 1".to_owned())
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let applied = arguments.cz.as_deref().map(Applied::named).unwrap_or_default();
    let choice = Choice {
        error: Some(arguments.error.clone()),
        inputs: arguments.inputs.clone(),
        without: arguments.without.clone(),
        keep: arguments.keep.clone(),
        resample: arguments.resample,
        ..Choice::default()
    };
    let uses = uses::of_select(&choice, &applied);
    let mut dataset = arguments.runs.read(&arguments.logs, (&arguments.error, &[]), &|_| None, &uses)?;
    without_cz(&mut dataset, &arguments.error, None, None, &applied)?;
    without_incomplete(&mut dataset, &choice);
    let pointed = points(&dataset, &choice)?;
    let mut settings = Settings {
        groups: arguments.group.clone(),
        most: usize::from(arguments.most),
        independent: arguments.independent,
        ..Settings::default()
    };
    if !arguments.lags.is_empty() {
        settings.lags = arguments.lags.iter().map(|lag| (!lag.is_zero()).then_some(*lag)).collect();
    }
    let progress = Progress::begin("runs held out");
    let note = |done, all| progress.note("runs held out", done, all);
    let found: Selected = select(&pointed, &settings, &note).map_err(anyhow::Error::msg)?;
    drop(progress);
    let mut beside = ExtraFiles::default();
    if let Some(path) = &arguments.report {
        let page = report::selection_page(&pointed, &found, Clock::wall().time_of_day());
        beside.write("the report", path, page);
    }
    let is_used = |column: &Column| {
        found.points.iter().any(|point| point.name == column.name)
            || found.error == column.name
            || matches!(column.kind, Kind::Speed | Kind::Compensation)
            || found.notes.excluded.iter().any(|faulty| faulty.signal == column.name)
    };
    let columns = ColumnTable::new(&dataset, &is_used);
    if arguments.json {
        print_json(&Document { found: &found, columns })?;
    } else {
        text::render(&mut Out, &found)?;
        columns.render(&mut Out)?;
    }
    beside.end(arguments.json)
}
