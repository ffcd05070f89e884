//! `isotherm logs explain`: shows how isotherm reads a log: encoding, times, units and first rows.

use std::path::PathBuf;

use super::logs::LogFormat;
use super::print::print_json;
use crate::cli::print::say_all;
use isotherm_identify::dataset::{Split, explain};

/// Shows how isotherm reads logs, before a model is identified from them.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  isotherm logs explain monday.csv --zone Europe/Berlin")]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: LogsVerb,
}

#[derive(Debug, clap::Subcommand)]
enum LogsVerb {
    /// Shows how isotherm reads a log: header, times, units and first rows
    Explain(ExplainArguments),
}

/// Shows how `identify`, `select` and `report` understand a log: encoding, line with the column names, time, units, and
/// first rows. The command also shows the errors in these rows. If there are errors, the exit code is 1.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  isotherm logs explain monday.csv --zone Europe/Berlin")]
struct ExplainArguments {
    /// The log file
    #[arg(value_name = "LOG")]
    file: PathBuf,
    #[command(flatten)]
    format: LogFormat,
    /// Prints one JSON document
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let LogsVerb::Explain(ExplainArguments { file, format, json }) = &arguments.what;
    let split = Split {
        zone: Some(format.zone()),
        decimal: format.decimal,
        dates: format.dates,
        time_unit: format.time_unit,
        ..Split::default()
    };
    let explanation = explain(file, &split)?;
    if *json {
        print_json(&explanation)?;
    } else {
        say_all!("{explanation}")?;
    }
    anyhow::ensure!(explanation.errors.is_empty(), "{} cannot be read completely", file.display());
    Ok(())
}
