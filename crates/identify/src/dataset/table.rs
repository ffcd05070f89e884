//! One file: its time and its columns, before it is split into runs.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use super::{BadLog, acted};
use isotherm_core::quantity::{Dialect, Moment, time};

/// The rows of one file, column by column.
#[derive(Clone, Debug, Default)]
pub(super) struct Table {
    pub(super) file: PathBuf,
    pub(super) times: Vec<Moment>,
    /// The line, or row, of the file that each row came from.
    pub(super) lines: Vec<u64>,
    pub(super) columns: Vec<(String, Cells)>,
    /// Columns with the Cz that acted.
    pub(super) acted: Vec<String>,
}

/// The cells of a column.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cells {
    /// NaN where one is missing.
    Numbers(Vec<f64>),
    /// Names, states, products: nothing to compute with, but runs may be told apart by them.
    Text(Vec<String>),
}

impl Table {
    pub(super) fn cells(&self, name: &str) -> Option<&Cells> {
        self.columns.iter().find(|(known, _)| known == name).map(|(_, cells)| cells)
    }

    pub(super) fn numbers(&self, name: &str) -> Option<&[f64]> {
        match self.cells(name)? {
            Cells::Numbers(numbers) => Some(numbers),
            Cells::Text(_) => None,
        }
    }

    pub(super) fn names_of_numbers(&self) -> impl Iterator<Item = &str> {
        let numbers = self.columns.iter().filter(|(_, cells)| matches!(cells, Cells::Numbers(_)));
        numbers.map(|(name, _)| name.as_str())
    }
}

/// Reads a cell of the time, behind the time of the row before.
type ReadTime = fn(&mut Dialect, &str, Option<Moment>) -> Result<Moment, String>;

/// A table while it is read, row by row, with the mistakes that are found.
pub(super) struct Reader {
    table: Table,
    columns: Vec<(String, Vec<String>)>,
    /// The place of the time, and what reads its cells.
    time: (usize, ReadTime),
    /// What the file calls a row: line, row.
    row: &'static str,
    dialect: Dialect,
    listed: Vec<String>,
    unlisted: usize,
}

impl Reader {
    /// `None` where no column is the time.
    pub(super) fn new(
        file: &Path,
        names: Vec<String>,
        (row, dialect): (&'static str, Dialect),
    ) -> Option<Reader> {
        let unit = |name: &str| -> Option<ReadTime> {
            match name {
                "time" | "time_s" => Some(Dialect::moment),
                "time_min" => Some(minutes),
                _ => None,
            }
        };
        Some(Reader {
            table: Table { file: file.to_owned(), ..Table::default() },
            time: names.iter().enumerate().find_map(|(place, name)| Some((place, unit(name)?)))?,
            columns: names.into_iter().map(|name| (name, Vec::new())).collect(),
            row,
            dialect,
            listed: Vec::new(),
            unlisted: 0,
        })
    }

    /// Adds a mistake in a row of the file.
    pub(super) fn refuse(&mut self, number: u64, column: Option<&str>, message: impl Display) {
        self.refuse_at(&format!("{} {number}", self.row), column, message);
    }

    fn refuse_at(&mut self, place: &str, column: Option<&str>, message: impl Display) {
        const MOST_LISTED: usize = 20;
        if self.listed.len() == MOST_LISTED {
            self.unlisted += 1;
            return;
        }
        let column = column.map(|name| format!(", column {name}")).unwrap_or_default();
        self.listed.push(format!("{}, {place}{column}: {message}", self.table.file.display()));
    }

    /// Adds a row: a text for each column.
    pub(super) fn add(&mut self, number: u64, cells: Vec<String>) {
        let (time, read) = self.time;
        let last = self.table.times.last().copied();
        match read(&mut self.dialect, cells.get(time).map_or("", String::as_str), last) {
            Ok(moment) => self.table.times.push(moment),
            Err(why) => {
                let name = self.columns[time].0.clone();
                return self.refuse(number, Some(&name), why);
            }
        }
        self.table.lines.push(number);
        self.columns.iter_mut().zip(cells).for_each(|((_, texts), cell)| texts.push(cell));
    }

    /// The table as it is learnt from. `empty`: what is said of a file without rows, and of which of its rows.
    pub(super) fn finish(mut self, empty: (u64, &str)) -> Result<Table, BadLog> {
        if self.table.times.is_empty() && self.listed.is_empty() {
            self.refuse(empty.0, None, empty.1);
        }
        for (place, (name, texts)) in std::mem::take(&mut self.columns).into_iter().enumerate() {
            if place != self.time.0 && !name.is_empty() {
                let cells = self.cells(&name, texts);
                self.table.columns.push((name, cells));
            }
        }
        if self.listed.is_empty() {
            for column in acted::keep_what_acted(&mut self.table) {
                let message = "no row in which what stood in the register was verified: what acted is not known; leave \
                               this log out";
                self.refuse_at(&format!("every {}", self.row), Some(&column), message);
            }
        }
        if self.unlisted > 0 {
            let more = format!("{}: {} more of this kind", self.table.file.display(), self.unlisted);
            self.listed.push(more);
        }
        BadLog::unless(self.listed, self.table)
    }

    /// Texts become numbers where they all are. A column with both is a mistake, named at its first text.
    fn cells(&mut self, name: &str, texts: Vec<String>) -> Cells {
        let mut numbers = Vec::with_capacity(texts.len());
        for (row, text) in texts.iter().enumerate() {
            match self.dialect.number(text.trim()) {
                Ok(text) => numbers.push(number(&text)),
                Err(why) => {
                    self.refuse(self.table.lines[row], Some(name), why);
                    return Cells::Numbers(Vec::new());
                }
            }
        }
        let Some(first) = numbers.iter().position(Option::is_none) else {
            return Cells::Numbers(numbers.into_iter().flatten().collect());
        };
        let text = texts[first].trim();
        let dotted = text.replace(',', ".");
        let has_comma = text.contains(',') && dotted.parse::<f64>().is_ok();
        if !has_comma && !numbers.iter().flatten().any(|value| value.is_finite()) {
            return Cells::Text(texts);
        }
        let hint = match has_comma {
            true => format!("`{text}` has a decimal comma; write {dotted}"),
            false => format!("`{text}` is no number; leave the cell empty where the value is missing"),
        };
        self.refuse(self.table.lines[first], Some(name), hint);
        Cells::Numbers(numbers.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
    }
}

/// A time in minutes.
fn minutes(dialect: &mut Dialect, text: &str, _: Option<Moment>) -> Result<Moment, String> {
    let read = time::parse(&dialect.number(text.trim())?)?;
    if text.contains(':') {
        return Err(format!("`{text}` is a date, and `time_min` counts minutes; name the column `time`"));
    }
    // A minute is sixty of the seconds that were read: exact to the nanosecond.
    let nanos = read.as_nanos().checked_mul(60);
    nanos.map(Moment::from_nanos).ok_or_else(|| format!("`{text}` minutes is beyond the end of time"))
}

/// One cell as a number: NaN where it is empty; `None` where it is none.
fn number(text: &str) -> Option<f64> {
    let text = text.trim();
    if text.is_empty() || ["na", "nan", "null", "none", "-"].contains(&text.to_ascii_lowercase().as_str()) {
        return Some(f64::NAN);
    }
    match text {
        "true" => Some(1.0),
        "false" => Some(0.0),
        _ => text.parse::<f64>().ok().map(|value| if value.is_finite() { value } else { f64::NAN }),
    }
}
