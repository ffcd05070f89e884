//! One file: its time and its columns, before it is split into runs.

use std::path::PathBuf;

use super::BadLog;
use isotherm_core::quantity::{Moment, time};

/// Most mistakes of one file that are told.
const MOST_TOLD: usize = 20;

/// The rows of one file, column by column.
#[derive(Clone, Debug, Default)]
pub(super) struct Table {
    pub(super) file: PathBuf,
    pub(super) times: Vec<Moment>,
    /// The line, or row, of the file that each row came from.
    pub(super) lines: Vec<u64>,
    pub(super) columns: Vec<(String, Cells)>,
    pub(super) remarks: Vec<String>,
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
pub(super) enum TimeUnit {
    /// Seconds or RFC 3339.
    Seconds,
    /// Minutes.
    Minutes,
}

impl TimeUnit {
    /// What a column of this name counts; `None`: it is not the time.
    pub(super) fn of(name: &str) -> Option<TimeUnit> {
        match name {
            "time" | "time_s" => Some(TimeUnit::Seconds),
            "time_min" => Some(TimeUnit::Minutes),
            _ => None,
        }
    }

    pub(super) fn moment(self, text: &str) -> Result<Moment, String> {
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
    pub(super) fn numbers(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find_map(|(known, cells)| match cells {
            Cells::Numbers(numbers) if known == name => Some(numbers.as_slice()),
            _ => None,
        })
    }

    pub(super) fn names_of_numbers(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().filter_map(|(name, cells)| match cells {
            Cells::Numbers(_) => Some(name.as_str()),
            Cells::Text(_) => None,
        })
    }
}

/// The mistakes of one file, as they are found.
#[derive(Debug)]
pub(super) struct Wrong {
    file: PathBuf,
    told: Vec<String>,
    count: usize,
}

impl Wrong {
    pub(super) fn in_file(file: PathBuf) -> Wrong {
        Wrong { file, told: Vec::new(), count: 0 }
    }

    /// Adds a mistake; `what` names the row, as "line 3".
    pub(super) fn at(&mut self, what: &str, column: Option<&str>, message: impl std::fmt::Display) {
        self.count += 1;
        if self.told.len() < MOST_TOLD {
            let column = column.map(|name| format!(", column {name}")).unwrap_or_default();
            self.told.push(format!("{}, {what}{column}: {message}", self.file.display()));
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.count == 0
    }

    pub(super) fn or<T>(mut self, good: T) -> Result<T, BadLog> {
        if self.count > self.told.len() {
            let more = self.count - self.told.len();
            self.told.push(format!("{}: {more} more of this kind", self.file.display()));
        }
        if self.count == 0 { Ok(good) } else { Err(BadLog(self.told)) }
    }
}

/// One cell as a number: NaN where it is empty; `None` where it is none.
pub(super) fn number(text: &str) -> Option<f64> {
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

/// Texts become numbers where they all are. A column with both is a mistake, told at its first text.
pub(super) fn cells(name: &str, texts: Vec<String>, lines: &[u64], wrong: &mut Wrong) -> Cells {
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
    wrong.at(&format!("line {}", lines[first]), Some(name), hint);
    Cells::Numbers(numbers.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
}
