//! Logs as data sets: kinds of columns, and one run for each warm-up.
//!
//! ```text
//! file ── table (cells by column) ── split ── runs        kinds guessed from names, units and values
//! ```
//! A log is a CSV file with any separator of a spreadsheet, or a Parquet file. Its time column is the first one named
//! `time`, `time_s` or `time_min`. `time` is in seconds, in RFC 3339, or date and time of the time zone. Every other
//! column has one number per row (NaN if missing), or text.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

use jiff::tz::TimeZone;

mod active_cz;
mod csv;
mod error;
mod files;
mod gauge;
mod kind;
#[cfg(feature = "parquet")]
mod parquet;
mod run;
mod split;
mod table;
#[cfg(test)]
mod tests;

pub use error::BadLog;
pub use kind::Kind;
pub use run::Run;
pub(crate) use run::{Datum, Errors, Origin};
pub use split::Split;
pub use table::{Uses, every_column};

use table::Table;

/// Several runs with the same columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dataset {
    /// Columns of the runs, in the order of the first file, without the time.
    pub columns: Vec<Column>,
    /// Unused columns of the log files. Their values are not stored.
    pub unread: Vec<Column>,
    /// One run for each warm-up, in the order of files and time.
    pub runs: Vec<Run>,
    /// Remarks about unusual data that could be read nevertheless.
    pub remarks: Vec<String>,
}

/// Log column of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name in the header.
    pub name: String,
    /// Kind of quantity, guessed from unit, name and values.
    pub kind: Kind,
}

/// Function that returns the unit that the profile gives for a log column; `None` if the profile has no signal of this
/// name.
pub type Units<'a> = &'a dyn Fn(&str) -> Option<&'static str>;

impl Dataset {
    /// Reads log files, and all logs in directories, and divides them into runs.
    ///
    /// # Errors
    /// Something cannot be read. Each message contains file, line and column.
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

    /// Adds the readings of a dial gauge as the column `error`. The file has a time column and one column in µm, or in
    /// mm if its name ends with `_mm`. Each reading goes to the row that is nearest in time, within the duration
    /// `within`.
    ///
    /// # Errors
    /// - The file has another form.
    /// - No reading is near a row.
    /// - The logs have a column `error` already, or overlap in time.
    pub fn add_gauge(
        &mut self,
        file: &Path,
        (error, within): (&str, Duration),
        zone: Option<TimeZone>,
    ) -> Result<(), BadLog> {
        gauge::add(self, file, (error, within), zone)
    }

    fn from_tables(tables: Vec<Table>, split: &Split, units: Units<'_>) -> Result<Dataset, BadLog> {
        // Names that have numbers in at least one file, in the order of their first occurrence.
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

    /// Returns the names of the used log columns, then of the unused ones.
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

/// Returns the unused columns of all files, each once, in the order of their first occurrence.
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
        "{}: this program was built without Parquet: write CSV, use a packaged program, or build one with \
         Parquet: `cargo build --release --features parquet`",
        file.display()
    )]));
}
