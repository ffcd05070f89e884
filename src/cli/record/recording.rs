//! Files of a recording, and statistics of their columns.

use std::fmt;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;

use crate::cli::new_file::{self, cannot_be_written};
use crate::gateway::log::number;
use crate::observe::status::Status;
use crate::virtual_machine::{AxisSummary, TruthRow};
use isotherm_core::quantity::Moment;
use isotherm_profile::Profile;
use isotherm_profile::{counted, duration_text};

/// File that is being written, and statistics over all files of the recording.
pub(super) struct Recording {
    out: PathBuf,
    machine: String,
    header: String,
    /// Files of the recording; the last one is being written.
    files: Vec<PathBuf>,
    file: File,
    /// Time at which the current file began.
    begun: Moment,
    first: Moment,
    last: Moment,
    rows: u64,
    columns: Vec<Column>,
}

/// Statistics of one signal's column, over all files.
struct Column {
    name: String,
    unit: &'static str,
    rows: u64,
    range: (f64, f64),
    missing: bool,
}

impl Recording {
    pub(super) fn begin(
        out: &Path,
        profile: &Profile,
        on_plant: &[AxisSummary],
        now: Moment,
    ) -> anyhow::Result<Recording> {
        let mut header = csv::Writer::from_writer(Vec::new());
        let errors = on_plant.iter().map(|axis| format!("{}_error_um", axis.axis));
        let names = profile.signals.iter().map(|signal| signal.name.clone());
        header.write_record(["time".to_owned()].into_iter().chain(names).chain(errors))?;
        let header = String::from_utf8(header.into_inner()?)?;
        let columns = profile.signals.iter().map(|signal| Column {
            name: signal.name.clone(),
            unit: signal.unit.0,
            rows: 0,
            range: (f64::INFINITY, f64::NEG_INFINITY),
            missing: false,
        });
        let (out, machine, columns) = (out.to_owned(), profile.name.clone(), columns.collect());
        let path = place(&out, &machine, now, 1);
        let file = open(&path, &header)?;
        let files = vec![path];
        Ok(Recording {
            out,
            machine,
            header,
            files,
            file,
            begun: now,
            first: now,
            last: now,
            rows: 0,
            columns,
        })
    }

    /// Begins a new file if the current one has lasted for `after`.
    pub(super) fn rotate(&mut self, now: Moment, after: Duration) -> anyhow::Result<()> {
        if now.since(self.begun) >= after {
            let path = place(&self.out, &self.machine, now, self.files.len() + 1);
            self.file = open(&path, &self.header)?;
            self.files.push(path);
            self.begun = now;
        }
        Ok(())
    }

    /// Writes one row of the recording with a single write call, so that a power cut loses at most this row.
    pub(super) fn row(
        &mut self,
        now: Moment,
        status: &Status,
        truth: Option<&TruthRow>,
    ) -> anyhow::Result<()> {
        let mut line = now.to_string().into_bytes();
        let values = status.signals.iter().map(|signal| signal.value);
        let errors = truth.iter().flat_map(|row| &row.axes).map(|axis| Some(axis.error_um));
        for value in values.chain(errors) {
            line.push(b',');
            if let Some(value) = value {
                number(&mut line, value);
            }
        }
        line.push(b'\n');
        if let Err(error) = self.file.write_all(&line) {
            let path = self.files.last().unwrap_or(&self.out);
            let rows = counted(self.rows, "row");
            return Err(cannot_be_written(path, &error)
                .context(format!("the recording ends after {rows}, which are kept")));
        }
        self.rows += 1;
        self.last = now;
        for (column, signal) in self.columns.iter_mut().zip(&status.signals) {
            column.missing = signal.value.is_none();
            if let Some(value) = signal.value {
                column.rows += 1;
                column.range = (column.range.0.min(value), column.range.1.max(value));
            }
        }
        Ok(())
    }

    /// Returns the path of the file that is being written.
    pub(super) fn path(&self) -> std::path::Display<'_> {
        self.files.last().unwrap_or(&self.out).display()
    }

    pub(super) fn rows(&self) -> u64 {
        self.rows
    }

    /// Returns the signals without a value in the last row of the recording.
    pub(super) fn missing_now(&self) -> Vec<&str> {
        self.columns.iter().filter(|column| column.missing).map(|column| column.name.as_str()).collect()
    }
}

fn place(out: &Path, machine: &str, now: Moment, part: usize) -> PathBuf {
    if out.is_dir() || out.as_os_str().to_string_lossy().ends_with('/') {
        let stamp = now.to_string().chars().take(19).collect::<String>().replace(':', "");
        return out.join(format!("{machine}-{stamp}.csv"));
    }
    if part == 1 {
        return out.to_owned();
    }
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    let end = out.extension().map_or(String::new(), |end| format!(".{}", end.to_string_lossy()));
    out.with_file_name(format!("{stem}-{part}{end}"))
}

fn open(path: &Path, header: &str) -> anyhow::Result<File> {
    if let Some(directory) = path.parent() {
        std::fs::create_dir_all(directory)
            .with_context(|| format!("the directory {} cannot be created", directory.display()))?;
    }
    new_file::create(path, header)
}

/// Summary of the recording, with the missing values of each column. The user sees it while the displacement sensor is
/// still mounted.
impl fmt::Display for Recording {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let span = Duration::from_secs(self.last.since(self.first).as_secs());
        let files: Vec<String> = self.files.iter().map(|path| path.display().to_string()).collect();
        writeln!(f, "{}: {} over {}", files.join(", "), counted(self.rows, "row"), duration_text(span))?;
        let width = self.columns.iter().map(|column| column.name.len()).max().unwrap_or(0);
        for Column { name, unit, rows, range: (low, high), .. } in &self.columns {
            let missing = self.rows - rows;
            match (*rows, missing) {
                (0, _) => writeln!(f, "  {name:<width$}  never read")?,
                (_, 0) => writeln!(f, "  {name:<width$}  {low:.4} … {high:.4} {unit}")?,
                _ => {
                    let missing = counted(missing, "row");
                    writeln!(f, "  {name:<width$}  {low:.4} … {high:.4} {unit}, missing in {missing}")?;
                }
            }
        }
        Ok(())
    }
}
