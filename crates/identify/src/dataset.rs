//! Logs as runs: what each column is, and one run per warm-up.
//!
//! ```text
//! file ── table (cells by column) ── split ── runs        kinds guessed from names, units and values
//! ```
//! CSV, with whatever a spreadsheet separates columns by, or Parquet. The first column named `time` (seconds, RFC 3339, or a
//! date and time of the zone), `time_s` or `time_min` orders the rows; every other column is a number per row (NaN where it
//! is missing) or text.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

use jiff::tz::TimeZone;

use crate::statistics::range;
use isotherm_core::quantity::Moment;

mod acted;
mod csv;
mod files;
mod gauge;
mod kind;
#[cfg(feature = "parquet")]
mod parquet;
mod split;
mod table;
#[cfg(test)]
mod tests;

pub use kind::Kind;
use table::Table;

/// Several runs over the same columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dataset {
    /// What stands in each column, in the order of the first file; the time is not among them.
    pub columns: Vec<Column>,
    /// What else the files have, which nobody computes with, and of which no values are kept.
    pub unread: Vec<Column>,
    /// One warm-up each, in the order of the files and of time.
    pub runs: Vec<Run>,
    /// What is odd, but kept nothing from being read.
    pub remarks: Vec<String>,
}

/// A column of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// As the header has it.
    pub name: String,
    /// What it seems to be.
    pub kind: Kind,
}

/// One warm-up: the rows between a cold machine and its end.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// The file's name without its ending, with a number or the splitting column's value behind it where it was split.
    pub name: String,
    /// Where it came from.
    pub file: PathBuf,
    /// When each row was taken, ascending.
    pub times: Vec<Moment>,
    /// By column, by row; NaN where it is missing.
    pub values: Vec<Vec<f64>>,
}

/// How files become runs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Split {
    /// A new run begins where this column has a new value.
    pub column: Option<String>,
    /// A new run begins after so long without a row.
    pub gap: Option<Duration>,
    /// Where the clock hung whose times have no offset from UTC; none: such times are refused.
    pub zone: Option<TimeZone>,
}

/// Everything that is wrong with the logs, each with its place.
#[derive(Clone, Debug, Default, PartialEq, Eq, thiserror::Error)]
#[error("{}", .0.join("\n"))]
pub struct BadLog(pub Vec<String>);

impl BadLog {
    /// This where nothing is wrong.
    pub(crate) fn unless<T>(wrong: Vec<String>, good: T) -> Result<T, BadLog> {
        if wrong.is_empty() { Ok(good) } else { Err(BadLog(wrong)) }
    }
}

/// The unit of a column, where a profile knows it.
pub type Units<'a> = &'a dyn Fn(&str) -> Option<&'static str>;

/// Whether somebody computes with a column, by its name. Of the others little more than the name is read: a log may have
/// hundreds, of which a model takes ten.
pub type Uses<'a> = &'a dyn Fn(&str) -> bool;

/// Uses all of them.
#[must_use]
pub fn every_column(_: &str) -> bool {
    true
}

impl Dataset {
    /// Reads the logs, or those in a directory, and splits them into runs.
    ///
    /// # Errors
    /// Everything that cannot be read, with file, line and column.
    pub fn read(
        files: &[PathBuf],
        split: &Split,
        units: Units<'_>,
        uses: Uses<'_>,
    ) -> Result<Dataset, BadLog> {
        let (mut tables, mut wrong) = (Vec::new(), Vec::new());
        for file in files::logs(files, &mut wrong) {
            match read_table(&file, split, uses) {
                Ok(table) => tables.push(table),
                Err(BadLog(found)) => wrong.extend(found),
            }
        }
        Dataset::from_tables(BadLog::unless(wrong, tables)?, split, units)
    }

    /// Adds the readings of a small file, `time` and one column of µm (or, named `…_mm`, of mm), as the column `error`: each in
    /// the row that is nearest in time, at most `within` away.
    ///
    /// # Errors
    /// A file that is none of these; none of its readings lies near a row; the logs have that column, or are of one time.
    pub fn add_gauge(
        &mut self,
        file: &Path,
        (error, within): (&str, Duration),
        zone: Option<TimeZone>,
    ) -> Result<(), BadLog> {
        gauge::add(self, file, (error, within), zone)
    }

    fn from_tables(tables: Vec<Table>, split: &Split, units: Units<'_>) -> Result<Dataset, BadLog> {
        // Every name that has numbers in some file, in the order in which they are met.
        let (mut names, mut seen) = (Vec::new(), HashSet::new());
        for name in tables.iter().flat_map(Table::names_of_numbers) {
            if seen.insert(name) {
                names.push(name.to_owned());
            }
        }
        let lacks = |table: &Table| {
            let own: HashSet<&str> = table.names_of_numbers().collect();
            let lacking = names.iter().map(String::as_str).filter(|name| !own.contains(name));
            let lacking: Vec<&str> = lacking.collect();
            let remark = format!("{} has no column {}", table.file.display(), lacking.join(", "));
            (!lacking.is_empty()).then_some(remark)
        };
        let remarks = tables.iter().filter_map(lacks).collect();
        let acted: HashSet<String> = tables.iter().flat_map(|table| table.acted.iter().cloned()).collect();
        let unread = unread(&tables, units);
        let runs = split::runs(tables, &names, split)?;
        let column = |(place, name): (usize, String)| {
            let kind = match acted.contains(&name) {
                true => Kind::Compensation,
                false => {
                    Kind::guess(&name, units(&name), runs.iter().map(|run| run.values[place].as_slice()))
                }
            };
            Column { name, kind }
        };
        let columns = names.into_iter().enumerate().map(column).collect();
        Ok(Dataset { columns, unread, remarks, runs })
    }

    /// The names of the columns, and behind them those that are not read.
    pub(crate) fn names(&self) -> Vec<&str> {
        self.columns.iter().chain(&self.unread).map(|column| column.name.as_str()).collect()
    }

    /// The places of the columns of this kind.
    pub(crate) fn of_kind(&self, kind: Kind) -> impl Iterator<Item = usize> {
        (0..self.columns.len()).filter(move |place| self.columns[*place].kind == kind)
    }

    /// How long the runs are together, s.
    pub(crate) fn seconds(&self) -> f64 {
        self.runs.iter().map(|run| run.lasts().as_secs_f64()).sum()
    }

    /// The place of the column with this name.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }
}

impl Run {
    /// Hours since the run's first row.
    pub(crate) fn hours(&self) -> impl Iterator<Item = f64> + '_ {
        self.seconds().map(|second| second / 3600.0)
    }

    /// Seconds since the run's first row.
    pub fn seconds(&self) -> impl Iterator<Item = f64> + '_ {
        let first = self.times.first().copied().unwrap_or_default();
        self.times.iter().map(move |time| time.since(first).as_secs_f64())
    }

    /// Largest minus smallest of a column; 0 where it is empty.
    pub(crate) fn range(&self, column: usize) -> f64 {
        range(&self.values[column])
    }

    /// From the first row to the last.
    pub fn lasts(&self) -> Duration {
        match (self.times.first(), self.times.last()) {
            (Some(first), Some(last)) => last.since(*first),
            _ => Duration::ZERO,
        }
    }
}

/// What some file has that nobody computes with, each once, in the order in which it is met.
fn unread(tables: &[Table], units: Units<'_>) -> Vec<Column> {
    let mut found: Vec<Column> = Vec::new();
    let mut seen = HashSet::new();
    for (name, sample) in tables.iter().flat_map(Table::unread) {
        if seen.insert(name) {
            let kind = Kind::guess(name, units(name), std::iter::once(sample));
            found.push(Column { name: name.to_owned(), kind });
        }
    }
    found
}

fn read_table(file: &Path, split: &Split, uses: Uses<'_>) -> Result<Table, BadLog> {
    let ending = file.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    if !ending.eq_ignore_ascii_case("parquet") {
        return csv::read(file, split, uses);
    }
    #[cfg(feature = "parquet")]
    return parquet::read(file, split, uses);
    #[cfg(not(feature = "parquet"))]
    return Err(BadLog(vec![format!(
        "{}: this program was built without Parquet: write CSV, or build it in: `cargo build --release --features parquet`",
        file.display()
    )]));
}
