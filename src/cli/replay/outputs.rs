//! Replay of a log of outputs, in which the gateway records the inputs and the actions of each output. The replay uses
//! the recorded inputs again, and compares the resulting actions with those in the log.

use std::collections::BTreeMap;
use std::fmt;
use std::io::{BufReader, Read};
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use serde::Serialize;

use super::{Difference, Reproduced};
use crate::gateway::log::outputs::{ENDING, Entry, HEADER, OutputLogReader, OutputReplay, Replayed};
use isotherm_core::quantity::Moment;
use isotherm_profile::safe_file;
use isotherm_profile::{counted, duration_text};

/// Statistics of a replayed log of outputs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OutputsSummary {
    /// Name of the log.
    pub log: String,
    /// Number of log rows read.
    pub rows: u64,
    /// Time between the earliest and the latest row of the log, s.
    pub span_s: f64,
    /// Warnings about the log.
    pub warnings: Vec<String>,
    /// Results of the comparison, by name of the output, output set or heartbeat.
    pub outputs: BTreeMap<String, Reproduced>,
}

/// Returns whether a log is a log of outputs, judged by its first bytes.
pub(super) fn is_of_outputs(first: &[u8]) -> bool {
    first.starts_with(HEADER.trim_end().as_bytes())
}

/// Replays the log of outputs that belongs to `log`, a log of decisions in the same directory. Returns `None` if there
/// is no such log of outputs.
pub(super) fn beside(log: &Path) -> anyhow::Result<Option<OutputsSummary>> {
    let Some(stem) = log.to_str().and_then(|name| name.strip_suffix(".csv")) else { return Ok(None) };
    let name = format!("{stem}{ENDING}");
    match safe_file::open(Path::new(&name)) {
        Ok(file) => {
            let replayed = replay_outputs(BufReader::new(file), &name);
            let why = "error in the log of the outputs in the same directory; move this log away to replay \
                       only the decisions";
            replayed.map(Some).context(why)
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| format!("the log {name} cannot be read")),
    }
}

/// Replays a log of outputs, and returns the results. `name` is the name of the log in messages.
///
/// # Errors
/// The reason why the log cannot be read, with the position in it.
pub fn replay_outputs(log: impl Read, name: &str) -> anyhow::Result<OutputsSummary> {
    let mut reader = OutputLogReader::open(log, name)?;
    let mut replay = OutputReplay::default();
    let mut outputs: BTreeMap<String, Reproduced> = BTreeMap::new();
    let mut unknown: BTreeMap<String, (u64, u64)> = BTreeMap::new();
    let (mut rows, mut span) = (0, None);
    while let Some(row) = reader.next_row()? {
        rows += 1;
        let (first, latest): (Moment, Moment) = span.unwrap_or((row.now, row.now));
        span = Some((first.min(row.now), latest.max(row.now)));
        let replayed = replay.row(&row);
        if replayed == Replayed::Unknown {
            unknown.entry(row.output).or_insert((row.line, 0)).1 += 1;
            continue;
        }
        if row.entry == Entry::Noted {
            continue;
        }
        let reported = outputs.entry(row.output).or_default();
        let repetitions = if let Entry::Turn { repetitions, .. } = row.entry { repetitions } else { 0 };
        reported.rows += u64::from(replayed != Replayed::Nothing) + repetitions;
        if let Replayed::Different { recorded, replayed } = replayed {
            reported.differing += 1;
            let column = "action".to_owned();
            reported.first.get_or_insert(Difference { line: row.line, column, recorded, replayed });
        }
    }
    let left_out = unknown.into_iter().map(|(output, (line, rows))| {
        format!(
            "{name}, line {line}: no row contains the state from which {output} continues; {rows} rows of {output} \
             are left out"
        )
    });
    let warnings = reader.warnings().iter().cloned().chain(left_out).collect();
    let span_s = span.map_or(0.0, |(first, latest)| latest.since(first).as_secs_f64());
    Ok(OutputsSummary { log: name.to_owned(), rows, span_s, warnings, outputs })
}

impl fmt::Display for OutputsSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let span = Duration::try_from_secs_f64(self.span_s.round()).unwrap_or_default();
        writeln!(f, "{}: {} over {}", self.log, counted(self.rows, "row"), duration_text(span))?;
        for (name, output) in &self.outputs {
            let Some(first) = &output.first else {
                let actions = counted(output.rows, "action");
                writeln!(f, "output {name}: the replay gives the {actions} of the log again")?;
                continue;
            };
            writeln!(
                f,
                "output {name}: {} of {} differ in the replay; first in {}, line {}: `{}` in the log, `{}` \
                 in the replay",
                output.differing,
                counted(output.rows, "action"),
                self.log,
                first.line,
                first.recorded,
                first.replayed
            )?;
        }
        for warning in &self.warnings {
            writeln!(f, "warning: {warning}")?;
        }
        Ok(())
    }
}
