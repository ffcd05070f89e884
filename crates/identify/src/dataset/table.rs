//! One file: its time and its columns, before it is split into runs.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use super::{BadLog, acted};
use isotherm_core::quantity::{Moment, time};

/// Most mistakes of one file that are listed.
const MOST_LISTED: usize = 20;

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

/// How the time column counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TimeUnit {
    /// Seconds or RFC 3339.
    Seconds,
    /// Minutes.
    Minutes,
}

impl TimeUnit {
    /// What a column of this name counts; `None`: it is not the time.
    fn of(name: &str) -> Option<TimeUnit> {
        match name {
            "time" | "time_s" => Some(TimeUnit::Seconds),
            "time_min" => Some(TimeUnit::Minutes),
            _ => None,
        }
    }

    fn moment(self, text: &str) -> Result<Moment, String> {
        let read = time::parse(text)?;
        match self {
            TimeUnit::Seconds => Ok(read),
            // A minute is sixty of the seconds that were read: exact to the nanosecond.
            TimeUnit::Minutes if text.contains(':') => {
                Err(format!("`{text}` is a date, and `time_min` counts minutes; name the column `time`"))
            }
            TimeUnit::Minutes => (read.as_nanos().checked_mul(60).map(Moment::from_nanos))
                .ok_or_else(|| format!("`{text}` minutes is beyond the end of time")),
        }
    }
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

/// A table while it is read, row by row.
pub(super) struct Reader {
    table: Table,
    names: Vec<String>,
    /// The place of the time, and how it counts.
    time: (usize, TimeUnit),
    /// By column.
    texts: Vec<Vec<String>>,
    /// What the file calls a row: line, row.
    row: &'static str,
    wrong: Wrong,
}

impl Reader {
    /// `None` where no column is the time.
    pub(super) fn new(file: &Path, names: Vec<String>, row: &'static str) -> Option<Reader> {
        let time = names.iter().enumerate().find_map(|(place, name)| Some((place, TimeUnit::of(name)?)))?;
        Some(Reader {
            table: Table { file: file.to_owned(), ..Table::default() },
            time,
            texts: vec![Vec::new(); names.len()],
            names,
            row,
            wrong: Wrong::in_file(file.to_owned()),
        })
    }

    /// Adds a mistake in a row of the file.
    pub(super) fn refuse(&mut self, number: u64, column: Option<&str>, message: impl Display) {
        self.wrong.at(&format!("{} {number}", self.row), column, message);
    }

    /// Adds a row: a text for each column.
    pub(super) fn add(&mut self, number: u64, cells: Vec<String>) {
        let (time, unit) = self.time;
        match unit.moment(cells.get(time).map_or("", String::as_str)) {
            Ok(moment) => self.table.times.push(moment),
            Err(why) => {
                let name = self.names[time].clone();
                return self.refuse(number, Some(&name), why);
            }
        }
        self.table.lines.push(number);
        self.texts.iter_mut().zip(cells).for_each(|(texts, cell)| texts.push(cell));
    }

    /// The table as it is learnt from. `empty`: what is said of a file without rows, and of which of its rows.
    pub(super) fn finish(mut self, empty: (u64, &str)) -> Result<Table, BadLog> {
        if self.table.times.is_empty() && self.wrong.is_empty() {
            self.refuse(empty.0, None, empty.1);
        }
        for (place, name) in std::mem::take(&mut self.names).into_iter().enumerate() {
            let texts = std::mem::take(&mut self.texts[place]);
            if place != self.time.0 && !name.is_empty() {
                let cells = self.cells(&name, texts);
                self.table.columns.push((name, cells));
            }
        }
        if self.wrong.is_empty() {
            acted::keep_what_acted(&mut self.table, &mut self.wrong);
        }
        self.wrong.or(self.table)
    }

    /// Texts become numbers where they all are. A column with both is a mistake, named at its first text.
    fn cells(&mut self, name: &str, texts: Vec<String>) -> Cells {
        let numbers: Vec<Option<f64>> = texts.iter().map(|text| number(text)).collect();
        let Some(first) = numbers.iter().position(Option::is_none) else {
            return Cells::Numbers(numbers.into_iter().flatten().collect());
        };
        let text = texts[first].trim();
        let dotted = text.replace(',', ".");
        let has_comma = text.contains(',') && dotted.parse::<f64>().is_ok();
        if !has_comma && !numbers.iter().flatten().any(|value| value.is_finite()) {
            return Cells::Text(texts);
        }
        let hint = if has_comma {
            format!("`{text}` has a decimal comma; write {dotted}")
        } else {
            format!("`{text}` is no number; leave the cell empty where the value is missing")
        };
        self.refuse(self.table.lines[first], Some(name), hint);
        Cells::Numbers(numbers.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
    }
}

/// The mistakes of one file, as they are found.
#[derive(Debug)]
pub(super) struct Wrong {
    file: PathBuf,
    listed: Vec<String>,
    count: usize,
}

impl Wrong {
    fn in_file(file: PathBuf) -> Wrong {
        Wrong { file, listed: Vec::new(), count: 0 }
    }

    /// Adds a mistake; `what` names the row, as "line 3".
    pub(super) fn at(&mut self, what: &str, column: Option<&str>, message: impl Display) {
        self.count += 1;
        if self.listed.len() < MOST_LISTED {
            let column = column.map(|name| format!(", column {name}")).unwrap_or_default();
            self.listed.push(format!("{}, {what}{column}: {message}", self.file.display()));
        }
    }

    fn is_empty(&self) -> bool {
        self.count == 0
    }

    fn or<T>(mut self, good: T) -> Result<T, BadLog> {
        if self.count > self.listed.len() {
            let more = self.count - self.listed.len();
            self.listed.push(format!("{}: {more} more of this kind", self.file.display()));
        }
        if self.is_empty() { Ok(good) } else { Err(BadLog(self.listed)) }
    }
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
