//! `isotherm replay`: repeats the decisions of a recorded log with the code of the gateway.
//!
//! A log of the gateway gives the same decisions again, bit for bit; the summary says whether it did. The summary also
//! lists when a sensor was replaced and by which other sensors, and when a sensor was suspected. It also lists when and
//! why an axis was on hold.
//!
//! A log of outputs (`NAME-DATE.outputs.csv`) gives the same output actions again. It is replayed alone, or together
//! with the log of decisions in the same directory.
//!
//! A log from another source is replayed by the same code, row by row. The axes count as armed, and their registers
//! start at zero:
//! - An axis updates at a row only if its period has passed since its last update. If rows come faster, the
//!   columns `z_cz_um`, `z_state` and `z_acted` of an axis `z` do not change until the next update. If rows
//!   come slower, there is one update per row. Then Cz may lag more than on the machine, and a warning is
//!   given.
//! - `z_raw_um` (Cz that the model requests) and `z_model` (name of the model) are calculated at every row,
//!   even without an update.
//! - `range` is applied to the values if the profile or its template states it. A default `range` is not applied, so
//!   that the log of an earlier version gives the same decisions. `max_rate`, `max_age` and `fault_when` are not applied
//!   either, because each row counts as a new reading.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::PathBuf;

use anyhow::Context;

use super::loading::{ProfileArguments, load_modelled, of_other_kind};
use super::logs::LogFormat;
use super::print::print_json;
use crate::cli::print::{say_all, say_beside};
pub use crate::gateway::log::Recording;
use crate::gateway::log::{LogReader, LogRow, number};
use isotherm_core::compensation::{Compensation, Decision, Remembered, Snapshot};
use isotherm_core::quantity::Micron;
use isotherm_profile::log_columns::{DECIDED, EXPECTED, SLOPE, TIME};
use isotherm_profile::{Axis, FileKind, Profile, safe_file};

mod findings;
mod outputs;
mod spans;
mod summary;
#[cfg(test)]
mod tests;
mod whole_file;

use findings::Findings;
pub use findings::{Hold, SensorFault, StandIn, Suspicion};
pub use outputs::{OutputsSummary, replay_outputs};
pub use spans::{AxisSpans, OmittedSpans, Span};
use summary::Tally;
pub use summary::{AxisSummary, Difference, ErrorSummary, Range, Reproduced, Summary};
use whole_file::WholeFile;

/// Repeats the decisions of a recorded log with the code of the gateway, and compares them.
///
/// The rows of --out have every stage of Cz. If the log has a measured error, they also have the error before and after
/// compensation.
///
/// The summary says when a sensor was replaced and by which other sensors, and when a sensor was suspected of being
/// frozen. It also says when and why an axis was on hold.
///
/// A log is CSV with a column `time` and one column for each signal in its unit. `time` is in seconds, RFC 3339, or
/// `05.01.2026 06:00:10` by the clock of --zone. Logs of loggers and spreadsheets are read as `isotherm identify` reads
/// them. `<axis>_error_um` is the measured error, if there is one. Missing values are empty. A log of outputs
/// (`NAME-DATE.outputs.csv`) is replayed with the log of the decisions in the same directory, or alone.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  isotherm replay my-machine.toml monday.csv --out replayed.csv")]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// The log file
    #[arg(value_name = "LOG.csv")]
    recording: PathBuf,
    #[command(flatten)]
    format: LogFormat,
    /// Writes the replayed rows to this file
    #[arg(long, value_name = "FILE.csv")]
    out: Option<PathBuf>,
    /// Prints one JSON document
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let profile = load_modelled(&arguments.profile, arguments.json)?.profile;
    let name = arguments.recording.display().to_string();
    let log =
        safe_file::open(&arguments.recording).with_context(|| format!("the log {name} cannot be read"))?;
    let mut log = BufReader::new(log);
    let first = log.fill_buf().with_context(|| format!("the log {name} cannot be read"))?;
    if outputs::is_of_outputs(first) {
        return run_outputs(arguments, log, &name);
    }
    let of_another_kind = |why: anyhow::Error| of_other_kind(&arguments.recording, FileKind::Log, why);
    let (log, recording) = opened(arguments, &profile, log, &name).map_err(of_another_kind)?;
    let begin = |path: &PathBuf| WholeFile::begin(path, &arguments.recording);
    let mut out = arguments.out.as_ref().map(begin).transpose()?;
    let mut summary = replay(&profile, log, recording, out.as_mut().map(|file| file as &mut dyn Write))
        .map_err(of_another_kind)?;
    summary.outputs = outputs::beside(&arguments.recording)?;
    if let Some(out) = out {
        out.end()?;
    }
    if arguments.json {
        return print_json(&summary);
    }
    say_all!("{summary}")?;
    Ok(())
}

/// Opens the log as rows of CSV. The log may have the encoding of a logger and additional lines before and after the
/// column names, or another table format, for example Parquet.
#[cfg(feature = "identify")]
fn opened<'a>(
    arguments: &Arguments,
    profile: &Profile,
    log: BufReader<File>,
    name: &'a str,
) -> anyhow::Result<(Box<dyn Read>, Recording<'a>)> {
    use isotherm_identify::dataset::{Split, plain_log};
    use isotherm_identify::setup::units;
    let errors: Vec<String> =
        profile.axes.iter().map(|axis| format!("{}_error_um", axis.settings.name)).collect();
    let uses = |column: &str| {
        profile.signals.iter().any(|signal| signal.name == column)
            || errors.iter().any(|error| error == column)
    };
    let units = units(profile);
    let LogFormat { decimal, dates, time_unit, .. } = arguments.format;
    let split = Split {
        zone: Some(arguments.format.zone()),
        decimal,
        dates,
        time_unit,
        displacements: errors.clone(),
        ..Split::default()
    };
    let log = plain_log(&arguments.recording, log, &split, (&units, &uses))?;
    let (implausible, remarks) = (log.implausible.lines, log.implausible.remarks);
    let recording = match log.is_csv {
        true => {
            Recording { first_rows: log.first_rows, left_out: log.left_out, ..recording(arguments, name) }
        }
        false => Recording::from(name),
    };
    Ok((log.input, Recording { implausible, remarks, ..recording }))
}

/// Opens the log as rows of CSV. Without the feature `identify`, the log must be CSV in UTF-8 that begins with the
/// column names.
#[cfg(not(feature = "identify"))]
fn opened<'a>(
    arguments: &Arguments,
    _: &Profile,
    log: BufReader<File>,
    name: &'a str,
) -> anyhow::Result<(Box<dyn Read>, Recording<'a>)> {
    Ok((Box::new(log), recording(arguments, name)))
}

fn recording<'a>(arguments: &Arguments, name: &'a str) -> Recording<'a> {
    let LogFormat { decimal, dates, time_unit, .. } = arguments.format;
    Recording { name, zone: Some(arguments.format.zone()), decimal, dates, time_unit, ..Recording::default() }
}

fn run_outputs(arguments: &Arguments, log: impl Read, name: &str) -> anyhow::Result<()> {
    if arguments.out.is_some() {
        let why = format!(
            "{name} is a log of outputs, which has no stages of Cz: leave out --out, or give the log of the \
             decisions"
        );
        anyhow::bail!(why);
    }
    let summary = replay_outputs(log, name)?;
    if arguments.json {
        return print_json(&summary);
    }
    say_all!("{summary}")?;
    Ok(())
}

/// Number of rows between two progress messages. A replay of a month takes long enough to need them.
const SAID_EVERY: u64 = 2_000_000;

/// Decision and error of one axis at one log row.
#[derive(Clone, Debug)]
struct Outcome<'a> {
    raw: Option<Micron>,
    model: &'a str,
    decision: Decision,
    /// Name of a sensor whose value was calculated from other sensors; empty if there was no such sensor.
    stood_in: &'a str,
    error: Option<f64>,
}

/// Replays a log. Writes a row to `out` for each row of the log, and returns a summary.
///
/// # Errors
/// The position in the log that cannot be read, or the reason why the output cannot be written.
pub fn replay<'a>(
    profile: &Profile,
    log: impl Read,
    recording: impl Into<Recording<'a>>,
    out: Option<&mut dyn Write>,
) -> anyhow::Result<Summary> {
    let recording = recording.into();
    let name = recording.name;
    let mut reader = LogReader::open(profile, log, recording)?;
    let mut table = out.map(csv::Writer::from_writer);
    if let Some(table) = &mut table {
        table.write_record(header(profile, &reader))?;
    }
    let mut compensation = from(profile, Remembered::default());
    let mut tally = Tally::new(profile);
    let mut cells = Vec::new();
    let mut rows = 0u64;
    while let Some(row) = reader.next_row()? {
        if let Some(memory) = &row.begins {
            tally.begins(profile, memory);
            compensation = from(profile, memory.clone());
        }
        for (at, axis) in &row.zeroed {
            match axis {
                Some(axis) => drop(compensation.zero_axis(*axis, *at)),
                None => compensation.zero(*at),
            }
        }
        for (axis, change) in &row.preferred {
            // A change of another profile has no effect.
            let _ = compensation.prefer(*axis, change.clone());
        }
        let snapshot = Snapshot::new(row.now, &row.readings);
        if !compensation.step(&snapshot, &row.controls).anything {
            compensation.follow(&snapshot);
        }
        tally.row(&row);
        rows += 1;
        if rows.is_multiple_of(SAID_EVERY) {
            say_beside!("{name}: {} million rows so far", rows / 1_000_000);
        }
        cells.clear();
        cells.push(row.time.clone());
        for axis in 0..profile.axes.len() {
            let Some(outcome) = outcome(profile, &compensation, axis, &snapshot, &row) else { continue };
            tally.axis(axis, &row, &outcome);
            if let Some(name) = compensation.preference(axis).and_then(|own| own.preferred().name()) {
                tally.learned(axis, name);
            }
            tally.findings(axis, &row, Findings::of(profile, &compensation, axis, &row));
            outcome.write(&mut cells, &profile.axes[axis], reader.has_error(axis));
        }
        if let Some(table) = &mut table {
            table.write_record(&cells).context("cannot write the replayed rows")?;
        }
    }
    if let Some(table) = &mut table {
        table.flush().context("cannot write the replayed rows")?;
    }
    Ok(tally.summary(name, reader.warnings()))
}

fn from(profile: &Profile, memory: Remembered) -> Compensation {
    let axes = profile.axes.iter().map(|axis| axis.settings.clone()).collect();
    Compensation::new(profile.machine.clone(), axes, memory)
}

fn header<R: Read>(profile: &Profile, reader: &LogReader<R>) -> Vec<String> {
    let mut names = vec![TIME.to_owned()];
    for (place, axis) in profile.axes.iter().enumerate() {
        let residual = reader.has_error(place).then_some("residual_um");
        let slope = axis.settings.intercept_slope.map(|_| SLOPE);
        let expected = axis.says_how_wrong().then_some(EXPECTED);
        let more = slope.into_iter().chain(expected).chain(residual);
        for column in DECIDED.into_iter().chain(more) {
            names.push(format!("{}_{column}", axis.settings.name));
        }
    }
    names
}

fn outcome<'a>(
    profile: &'a Profile,
    compensation: &Compensation,
    axis: usize,
    snapshot: &Snapshot<'_>,
    row: &LogRow,
) -> Option<Outcome<'a>> {
    let decision = *compensation.decision(axis)?;
    let is_own = row.decided.get(axis)?.is_some();
    let (raw, place) = if is_own {
        (decision.raw, decision.model)
    } else {
        compensation.model_value(axis, snapshot).map_or((None, None), |(place, raw)| (Some(raw), Some(place)))
    };
    let models = &profile.axes.get(axis)?.settings.models;
    let model = place.and_then(|place| models.get(place)).map_or("", |model| model.name.as_str());
    let stood_in = decision.stood_in.map_or("", |found| profile.signal(found.signal).name.as_str());
    Some(Outcome { raw, model, decision, stood_in, error: *row.errors.get(axis)? })
}

impl Outcome<'_> {
    /// Returns the residual error, µm; `None` if the log has no measured error at this row.
    fn residual(&self) -> Option<f64> {
        self.error.map(|error| error + self.decision.cz.get())
    }

    fn write(&self, cells: &mut Vec<String>, axis: &Axis, with_residual: bool) {
        cells.push(self.raw.map(|raw| text(raw.get())).unwrap_or_default());
        cells.push(text(self.decision.cz.get()));
        cells.push(self.model.to_owned());
        cells.push(self.decision.state.name().to_owned());
        cells.push(self.decision.acted.to_string());
        if axis.settings.intercept_slope.is_some() {
            cells.push(text(self.decision.slope.get()));
        }
        if axis.says_how_wrong() {
            cells.push(self.decision.expected.map(|expected| text(expected.get())).unwrap_or_default());
        }
        if with_residual {
            cells.push(self.residual().map(text).unwrap_or_default());
        }
    }
}

fn text(value: f64) -> String {
    let mut text = Vec::new();
    number(&mut text, value);
    String::from_utf8(text).unwrap_or_default()
}
