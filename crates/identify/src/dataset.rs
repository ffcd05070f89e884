//! Logs as data sets: kinds of columns, and one run for each warm-up.
//!
//! ```text
//! file ── table (cells by column) ── split ── runs        kinds guessed from names, units and values
//! ```
//! A log is a table of measured values over time: a CSV file with any separator of a spreadsheet, a workbook,
//! or a Parquet file. Its time column is the first column named `time`, `time_s` or `time_min`, or a similar
//! name that loggers use. A time is a number of seconds, a text in RFC 3339, or a local date and time. Every
//! other column has one number per row (NaN if missing), or text. Implausible values, which no sensor
//! measured, are left out. For each of these values, a remark names the file, the line and the value.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::time::Duration;

mod active_cz;
mod csv;
mod decode;
mod error;
mod explain;
mod files;
mod formats;
mod gauge;
#[cfg(feature = "tables")]
mod gzip;
mod head;
mod implausible;
mod kind;
mod measured;
#[cfg(feature = "parquet")]
mod parquet;
mod plain;
mod repeats;
mod run;
mod series;
mod spaced;
mod split;
mod steps;
mod table;
#[cfg(test)]
mod tests;
mod text_reader;
mod tidy;
mod time_form;
mod unit;
mod words;
#[cfg(feature = "tables")]
mod workbook;

pub use error::{BadLog, Refusal};
pub use explain::{CsvLayout, ExplainedColumn, ExplainedRow, Explanation, TimeLayout, explain};
pub use kind::Kind;
pub use measured::Implausible;
pub use plain::{PlainLog, plain_log};
pub use run::Run;
pub(crate) use run::{Datum, Errors, Origin};
pub use series::{Numbers, Series};
pub use split::Split;
pub use table::{Units, Uses, every_column};

use formats::read_table;
use split::Divided;
use table::Table;

/// Reason why a log column is not used if the kind of its quantity cannot be detected.
const UNKNOWN_QUANTITY: &str = "its unit, name and values do not show that it is a temperature, displacement, \
                                speed or position. If it is one of these, let its name end with the unit, for \
                                example `_c` or `_um`";

/// Logged runs of a machine. All runs have the same columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dataset {
    /// Columns of the runs without the time column, in the order of the first file.
    pub columns: Vec<Column>,
    /// Unused columns of the log files. Their values are not stored.
    pub unread: Vec<Column>,
    /// One run for each warm-up, in the order of files and time.
    pub runs: Vec<Run>,
    /// Remarks about unusual data that could be read nevertheless.
    pub remarks: Vec<String>,
    /// Used columns that have no number in one of the logs. Each item gives that log file and the reason.
    pub lost: Vec<Refusal>,
    /// Unused columns that have no number in one of the logs. Each item gives that log file and the reason.
    pub texts: Vec<Refusal>,
    /// Columns with too many implausible values (not measured by the sensor). A command that uses one of these columns
    /// must reject the logs.
    pub implausible: Vec<Refusal>,
    /// Sentences about pairs of runs that contain the same minutes, for example a file and its copy. A model must not
    /// be tested on such runs.
    pub repeats: Vec<String>,
}

/// Log column that a command does not use.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct UnusedColumn {
    /// Name of the column.
    pub name: String,
    /// Reason why the command does not use the column.
    pub why: String,
}

/// Log column that contains numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name of the column in the header of the log.
    pub name: String,
    /// Kind of quantity, guessed from unit, name and values.
    pub kind: Kind,
}

impl Dataset {
    /// Reads log files, and all logs in the named directories, and divides them into runs.
    ///
    /// # Errors
    /// A file cannot be read, or contains an invalid value. Each message contains file, line and column.
    pub fn read(
        files: &[PathBuf],
        split: &Split,
        units: Units<'_>,
        uses: Uses<'_>,
    ) -> Result<Dataset, BadLog> {
        let (mut tables, mut wrong, mut remarks) = (Vec::new(), Vec::new(), Vec::new());
        for file in files::logs(files, &mut wrong, &mut remarks) {
            match read_table(&file, split, uses) {
                Ok(table) => tables.push(table),
                Err(BadLog(found)) => wrong.extend(found),
            }
        }
        let mut dataset = Dataset::from_tables(BadLog::unless(wrong, tables)?, split, units)?;
        dataset.remarks.splice(0..0, remarks);
        Ok(dataset)
    }

    /// Adds the readings of a dial gauge as the column `error`. The file has a time column and one column in µm, or in
    /// mm if its name ends with `_mm`. Each value of the gauge is added to the log row that is nearest in time, at most
    /// `within` away.
    ///
    /// # Errors
    /// - The file has another form.
    /// - No value of the gauge is near a log row in time.
    /// - The logs have a column `error` already, or overlap in time.
    pub fn add_gauge(
        &mut self,
        file: &Path,
        (error, within): (&str, Duration),
        split: &Split,
    ) -> Result<(), BadLog> {
        gauge::add(self, file, (error, within), split)
    }

    fn from_tables(tables: Vec<Table>, split: &Split, units: Units<'_>) -> Result<Dataset, BadLog> {
        // Names that have numbers in at least one file, in the order of their first occurrence.
        let (mut names, mut seen) = (Vec::new(), HashSet::new());
        for name in tables.iter().flat_map(Table::names_of_numbers) {
            if seen.insert(name) {
                names.push(name.to_owned());
            }
        }
        let mut remarks: Vec<String> = tables.iter().filter_map(|table| lacking(table, &names)).collect();
        let acted: HashSet<String> = tables.iter().flat_map(|table| table.acted.iter().cloned()).collect();
        let logged = logged_units(&tables);
        let unit = |name: &str| units(name).or_else(|| logged.get(name).copied());
        let unread = unread(&tables, &unit);
        let lost: Vec<Refusal> = tables.iter().flat_map(|table| refusals(table, &table.lost)).collect();
        let texts = tables.iter().flat_map(|table| refusals(table, &table.texts)).collect();
        remarks.extend(not_used(&lost));
        let guess = |name: &str, values: &Series| match Kind::of_name(name, unit(name)) {
            None if split.displacements.iter().any(|known| known == name) => Kind::Displacement,
            _ => Kind::guess(name, unit(name), values.iter()),
        };
        let foreign: Vec<Refusal> = tables.iter().flat_map(|table| foreign(table, units)).collect();
        let Divided { runs, remarks: left_out, refused: mut implausible } =
            split::runs(tables, &names, split, &guess)?;
        implausible.extend(foreign);
        remarks.extend(left_out);
        let column = |(place, name): (usize, String)| {
            let kind = match acted.contains(&name) {
                true => Kind::Compensation,
                false => Kind::guess(&name, unit(&name), runs.iter().flat_map(|run| &run.values[place])),
            };
            Column { name, kind }
        };
        let columns: Vec<Column> = names.into_iter().enumerate().map(column).collect();
        let is_measured = |place: usize| {
            matches!(columns[place].kind, Kind::Temperature | Kind::Displacement | Kind::Other)
        };
        let repeats = repeats::find(&runs, &is_measured);
        Ok(Dataset { columns, unread, remarks, runs, lost, texts, implausible, repeats })
    }

    /// Returns the columns that a command does not use, each with the reason. `is_used` decides whether the command
    /// uses a column.
    pub fn unused(&self, is_used: &dyn Fn(&Column) -> bool) -> Vec<UnusedColumn> {
        // The touches of a probe are used, although their columns are not kept.
        let read = self.columns.iter().chain(&self.unread).filter(|column| !is_used(column));
        let why = |column: &Column| match column.kind {
            Kind::Other => UNKNOWN_QUANTITY.to_owned(),
            kind => format!("{kind}, but this command did not select it"),
        };
        let mut found: Vec<UnusedColumn> =
            read.map(|column| UnusedColumn { name: column.name.clone(), why: why(column) }).collect();
        for lost in self.lost.iter().chain(&self.texts) {
            if !found.iter().any(|known| known.name == lost.column) && self.column(&lost.column).is_none() {
                found.push(UnusedColumn { name: lost.column.clone(), why: lost.message.clone() });
            }
        }
        found
    }

    /// Returns the names of the used log columns, followed by the names of the unused log columns.
    pub(crate) fn names(&self) -> Vec<&str> {
        self.columns.iter().chain(&self.unread).map(|column| column.name.as_str()).collect()
    }

    /// Returns the indices of the log columns of this kind.
    pub(crate) fn of_kind(&self, kind: Kind) -> impl Iterator<Item = usize> {
        (0..self.columns.len()).filter(move |place| self.columns[*place].kind == kind)
    }

    /// Returns the total duration of all runs, s.
    pub(crate) fn seconds(&self) -> f64 {
        self.runs.iter().map(|run| run.lasts().as_secs_f64()).sum()
    }

    /// Returns the index of the log column with this name; `None` if there is no such column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }
}

/// Returns the unit of each column that has a unit in one of the logs. The units are written as in a profile.
fn logged_units(tables: &[Table]) -> HashMap<String, &'static str> {
    let units = tables.iter().flat_map(|table| &table.units);
    units.filter_map(|(name, unit)| Some((name.clone(), unit::of_profile(name, unit)?))).collect()
}

/// Returns the columns of a file whose unit belongs to another quantity than the unit in the profile.
fn foreign(table: &Table, units: Units<'_>) -> Vec<Refusal> {
    let refusal = |(name, logged): (&String, &String)| {
        let (expected, stated) = (units(name)?, unit::of_profile(name, logged)?);
        let [own, other] = [expected, stated].map(|unit| Kind::of_name(name, Some(unit)));
        let is_foreign = own? != other? || (own == Some(Kind::Speed) && expected != stated);
        let message = format!(
            "{}, column {name}: its unit is `{logged}`, but the signal of the profile is in {expected}: use \
             another column for this signal",
            table.file.display()
        );
        is_foreign.then(|| Refusal { column: name.clone(), message })
    };
    let mut found: Vec<Refusal> = table.units.iter().filter_map(refusal).collect();
    found.sort_by(|one, other| one.column.cmp(&other.column));
    found
}

/// Returns a remark about the columns that other files have, but this file lacks; `None` if this file has all columns.
fn lacking(table: &Table, names: &[String]) -> Option<String> {
    let own: HashSet<&str> = table.names_of_numbers().collect();
    let lacking: Vec<&str> = names.iter().map(String::as_str).filter(|name| !own.contains(name)).collect();
    let is_there = |name: &&str| table.cells(name).is_some();
    let (without_numbers, missing): (Vec<&str>, Vec<&str>) = lacking.into_iter().partition(is_there);
    let file = table.file.display();
    let mut parts = Vec::new();
    if !missing.is_empty() {
        parts.push(format!("{file} has no column {}", missing.join(", ")));
    }
    if !without_numbers.is_empty() {
        parts.push(format!("{file} has no numbers in {}", without_numbers.join(", ")));
    }
    (!parts.is_empty()).then(|| parts.join("; "))
}

/// Converts these columns of a file to refusals. Each item of `columns` is a column name, and the reason why the column
/// cannot be used.
fn refusals(table: &Table, columns: &[(String, String)]) -> Vec<Refusal> {
    let refusal = |(name, why): &(String, String)| Refusal {
        column: name.clone(),
        message: format!("{}, {why}", table.file.display()),
    };
    columns.iter().map(refusal).collect()
}

/// Returns a remark that names each of these columns once; `None` if the list is empty.
fn not_used(lost: &[Refusal]) -> Option<String> {
    let mut seen = HashSet::new();
    let first = lost.iter().filter(|lost| seen.insert(lost.column.as_str()));
    let named: Vec<String> = first.map(|lost| format!("{} ({})", lost.column, lost.message)).collect();
    (!named.is_empty()).then(|| format!("columns without numbers, which are not used: {}", named.join("; ")))
}

/// Returns the unused columns of all files. Each column occurs once, in the order of first occurrence.
fn unread(tables: &[Table], units: Units<'_>) -> Vec<Column> {
    let mut found: Vec<Column> = Vec::new();
    let mut seen = HashSet::new();
    for (name, sample) in tables.iter().flat_map(Table::unread) {
        if seen.insert(name) {
            let kind = Kind::guess(name, units(name), sample.iter());
            found.push(Column { name: name.to_owned(), kind });
        }
    }
    found
}
