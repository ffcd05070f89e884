//! Table of one file, with its time and columns, before it is divided into runs.

use std::collections::HashMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use super::{BadLog, active_cz};
use isotherm_core::quantity::{Dialect, Moment, time};
use isotherm_profile::safe_file::quoted;

/// Maximum number of rows of a file: those of seven months with one row per second. More rows would take too long to
/// read.
const MOST_ROWS: usize = 20_000_000;
/// Maximum number of numbers of a file; with 8 bytes each, they take 1.2 GB.
const MOST_NUMBERS: usize = 150_000_000;
/// Maximum number of different texts in a column that divides runs.
const MOST_WORDS: usize = 100_000;
/// Number of rows of an unused log column from which its kind is guessed.
const SAMPLED: usize = 1000;
/// Maximum number of listed errors; further errors are only counted.
const MOST_LISTED: usize = 20;

/// Function that returns whether a column is used, by its name. Unused columns are not read completely, because a log
/// may have hundreds of columns, of which a model requires ten.
pub type Uses<'a> = &'a dyn Fn(&str) -> bool;

/// Selects all columns; for use as [`Uses`].
#[must_use]
pub fn every_column(_: &str) -> bool {
    true
}

/// Rows of one file, by column.
#[derive(Clone, Debug, Default)]
pub(super) struct Table {
    pub(super) file: PathBuf,
    pub(super) times: Vec<Moment>,
    /// Line or row number of each row in the file.
    pub(super) lines: Numbering,
    pub(super) columns: Vec<(String, Cells)>,
    /// Names of the columns that contain the active Cz (Cz that acted during the measurement).
    pub(super) acted: Vec<String>,
    /// Rows directly after a zero command, each with the axis of the command; `None` for all axes. Only a log of the
    /// gateway contains them.
    pub(super) zeros: Vec<(usize, Option<String>)>,
    /// Whether the machine was already on before the first row, as the log of a gateway says.
    pub(super) continues: bool,
}

/// Cells of a column.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cells {
    /// Numbers; NaN if missing.
    Numbers(Vec<f64>),
    /// Texts, for example names and states. Texts are stored only if they may divide runs or show when Cz was active.
    Text(Words),
    /// First numbers of an unused column, from which its kind is guessed.
    Unread(Vec<f64>),
}

/// Trimmed texts of a column; each different text is stored once.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Words {
    places: Vec<u32>,
    words: Vec<String>,
    known: HashMap<String, u32>,
}

impl Words {
    /// Returns the texts in the order of the rows.
    pub(super) fn iter(&self) -> impl Iterator<Item = &str> {
        self.places.iter().map(|place| self.words[*place as usize].as_str())
    }

    /// Adds the text of a row. Returns `false` if there are too many different texts.
    fn push(&mut self, text: &str) -> bool {
        let place = match self.known.get(text) {
            Some(place) => *place,
            None if self.words.len() == MOST_WORDS => return false,
            None => {
                let place = u32::try_from(self.words.len()).unwrap_or(u32::MAX);
                self.words.push(text.to_owned());
                self.known.insert(text.to_owned(), place);
                place
            }
        };
        self.places.push(place);
        true
    }
}

/// Line number of each row in its file. Only numbers that are not the number of the previous row plus one are stored.
#[derive(Clone, Debug, Default)]
pub(super) struct Numbering {
    jumps: Vec<(usize, u64)>,
    rows: usize,
}

impl Numbering {
    fn push(&mut self, number: u64) {
        if self.rows == 0 || self.of(self.rows) != number {
            self.jumps.push((self.rows, number));
        }
        self.rows += 1;
    }

    /// Returns the line number of this row in the file. `row` is counted from zero.
    pub(super) fn of(&self, row: usize) -> u64 {
        let behind = self.jumps.partition_point(|(first, _)| *first <= row);
        behind.checked_sub(1).map_or(0, |last| {
            let (first, number) = self.jumps[last];
            number + (row - first) as u64
        })
    }
}

impl Table {
    pub(super) fn cells(&self, name: &str) -> Option<&Cells> {
        self.columns.iter().find(|(known, _)| known == name).map(|(_, cells)| cells)
    }

    pub(super) fn numbers(&self, name: &str) -> Option<&[f64]> {
        match self.cells(name)? {
            Cells::Numbers(numbers) => Some(numbers),
            Cells::Text(_) | Cells::Unread(_) => None,
        }
    }

    pub(super) fn names_of_numbers(&self) -> impl Iterator<Item = &str> {
        let numbers = self.columns.iter().filter(|(_, cells)| matches!(cells, Cells::Numbers(_)));
        numbers.map(|(name, _)| name.as_str())
    }

    /// Returns the unused columns, with their first numbers.
    pub(super) fn unread(&self) -> impl Iterator<Item = (&str, &[f64])> {
        self.columns.iter().filter_map(|(name, cells)| match cells {
            Cells::Unread(sample) => Some((name.as_str(), sample.as_slice())),
            Cells::Numbers(_) | Cells::Text(_) => None,
        })
    }
}

/// Parser of a time cell; the last argument is the time of the row before.
type ReadTime = fn(&mut Dialect, &str, Option<Moment>) -> Result<Moment, String>;

/// A column while the file is read.
#[derive(Debug, Default)]
struct Column {
    name: String,
    numbers: Vec<f64>,
    /// Texts, if they may be needed.
    words: Option<Words>,
    /// Whether at least one cell of the column was a number.
    has_numbers: bool,
    /// Line and text of the first cell that is not a number.
    text: Option<(u64, String)>,
    /// Whether the column is used. Only the first cells of an unused column are read.
    is_used: bool,
    /// Whether reading of the column has ended, because it is not needed or an error has been reported.
    is_over: bool,
}

/// A table while the file is read, with the errors found.
pub(super) struct Reader {
    table: Table,
    columns: Vec<Column>,
    /// Index of the time column, and the parser of its cells.
    time: (usize, ReadTime),
    /// Number of columns that are read completely, without the time.
    kept: usize,
    /// Word for a row in messages: line or row.
    row: &'static str,
    dialect: Dialect,
    listed: Vec<String>,
    unlisted: usize,
}

impl Reader {
    /// Creates a reader; `None` if no column contains the time. `by` is the column that divides runs. `uses` selects
    /// the columns.
    pub(super) fn new(
        file: &Path,
        names: Vec<String>,
        (row, dialect): (&'static str, Dialect),
        by: Option<&str>,
        uses: Uses<'_>,
    ) -> Option<Reader> {
        let unit = |name: &str| -> Option<ReadTime> {
            match name {
                "time" | "time_s" => Some(Dialect::moment),
                "time_min" => Some(minutes),
                _ => None,
            }
        };
        let time = names.iter().enumerate().find_map(|(place, name)| Some((place, unit(name)?)))?;
        let column = |(place, name): (usize, String)| {
            let has_words = by == Some(name.as_str()) || active_cz::needs_words(&name);
            let is_over = place == time.0 || name.is_empty();
            let is_used = has_words || active_cz::needs(&name) || uses(&name);
            Column { words: has_words.then(Words::default), is_used, is_over, name, ..Column::default() }
        };
        let columns: Vec<Column> = names.into_iter().enumerate().map(column).collect();
        Some(Reader {
            table: Table { file: file.to_owned(), ..Table::default() },
            time,
            kept: columns.iter().filter(|column| column.is_used && !column.is_over).count(),
            columns,
            row,
            dialect,
            listed: Vec::new(),
            unlisted: 0,
        })
    }

    /// Adds an error in a row of the file.
    pub(super) fn refuse(&mut self, number: u64, column: Option<&str>, message: impl Display) {
        self.refuse_at(&format!("{} {number}", self.row), column, message);
    }

    fn refuse_at(&mut self, place: &str, column: Option<&str>, message: impl Display) {
        if self.listed.len() == MOST_LISTED {
            self.unlisted += 1;
            return;
        }
        let column = column.map(|name| format!(", column {}", quoted(name))).unwrap_or_default();
        self.listed.push(format!("{}, {place}{column}: {message}", self.table.file.display()));
    }

    /// Returns the index of the time column.
    pub(super) fn time_at(&self) -> usize {
        self.time.0
    }

    /// Returns whether the next cell of this column must be read.
    pub(super) fn reads(&self, place: usize) -> bool {
        self.wants(place) > 0
    }

    /// Returns how many more cells of this column must be read.
    pub(super) fn wants(&self, place: usize) -> usize {
        match self.columns.get(place) {
            Some(column) if column.is_over => 0,
            Some(column) if column.is_used => usize::MAX,
            Some(column) => SAMPLED.saturating_sub(column.numbers.len()),
            None => 0,
        }
    }

    /// Number of columns that are read completely, without the time.
    #[cfg(feature = "parquet")]
    pub(super) fn kept(&self) -> usize {
        self.kept
    }

    /// Returns whether the cells of this column must be kept as texts: the column may name the run of each row, and its
    /// cells so far are not all numbers.
    #[cfg(feature = "parquet")]
    pub(super) fn needs_words(&self, place: usize) -> bool {
        self.columns.get(place).is_some_and(|column| column.words.is_some())
    }

    /// Marks a column whose cells are texts that nothing needs, so that they are not stored.
    #[cfg(feature = "parquet")]
    pub(super) fn is_text(&mut self, place: usize) {
        self.columns[place].is_over = true;
        self.columns[place].text = Some((0, String::new()));
    }

    /// Begins a row with its time. Returns `false` if the time is invalid, and adds the error. Returns `Err` if the
    /// file is too large.
    pub(super) fn begin(&mut self, number: u64, time: &str) -> Result<bool, TooMuch> {
        let rows = self.table.times.len();
        if rows >= MOST_ROWS || rows.saturating_mul(self.kept) >= MOST_NUMBERS {
            let limit = match rows >= MOST_ROWS {
                true => format!("more than {} million rows", MOST_ROWS / 1_000_000),
                false => format!("more than {} million numbers", MOST_NUMBERS / 1_000_000),
            };
            self.refuse(
                number,
                None,
                format!("{limit}: log more slowly, or split the file and leave columns out"),
            );
            return Err(TooMuch);
        }
        let (place, read) = self.time;
        let last = self.table.times.last().copied();
        match read(&mut self.dialect, &quoted(time), last) {
            Ok(moment) => {
                self.table.times.push(moment);
                self.table.lines.push(number);
                Ok(true)
            }
            Err(why) => {
                let name = self.columns[place].name.clone();
                self.refuse(number, Some(&name), why);
                Ok(false)
            }
        }
    }

    /// Adds a cell of the current row as text.
    pub(super) fn text(&mut self, place: usize, number: u64, text: &str) {
        let text = quoted(text.trim());
        let read = match self.dialect.separator() {
            b',' => to_number(&text),
            _ => match self.dialect.number(&text) {
                Ok(pointed) => to_number(&pointed),
                Err(_) if !self.columns[place].is_used => None,
                Err(_) if active_cz::is_of_machine(&self.columns[place].name) => None,
                Err(why) => {
                    let name = std::mem::take(&mut self.columns[place].name);
                    self.refuse(number, Some(&name), why);
                    self.columns[place] = Column { name, is_over: true, ..Column::default() };
                    return;
                }
            },
        };
        let column = &mut self.columns[place];
        if read.is_none() && column.text.is_none() {
            column.text = Some((number, text.clone().into_owned()));
        }
        let read = read.unwrap_or(f64::NAN);
        column.has_numbers |= read.is_finite();
        column.numbers.push(read);
        if column.has_numbers && column.text.is_none() {
            column.words = None;
        } else if column.words.as_mut().is_some_and(|words| !words.push(&text)) {
            let name = std::mem::take(&mut column.name);
            self.columns[place] = Column { is_over: true, ..Column::default() };
            let message =
                format!("more than {MOST_WORDS} different texts: this column cannot distinguish runs");
            self.refuse(number, Some(&name), message);
        }
    }

    /// Adds a cell of the current row as a number; NaN if missing.
    #[cfg(feature = "parquet")]
    pub(super) fn number(&mut self, place: usize, value: f64) {
        let column = &mut self.columns[place];
        column.has_numbers |= value.is_finite();
        column.numbers.push(if value.is_finite() { value } else { f64::NAN });
        if column.has_numbers {
            column.words = None;
        }
    }

    /// Returns the finished table, or all errors. `empty` is the line number and the message for a file without rows.
    pub(super) fn finish(mut self, empty: (u64, &str)) -> Result<Table, BadLog> {
        if self.table.times.is_empty() && self.listed.is_empty() {
            self.refuse(empty.0, None, empty.1);
        }
        for (place, mut column) in std::mem::take(&mut self.columns).into_iter().enumerate() {
            if place != self.time.0 && !column.name.is_empty() {
                let name = std::mem::take(&mut column.name);
                let cells = self.cells(&name, column);
                self.table.columns.push((name, cells));
            }
        }
        if self.listed.is_empty() {
            for column in active_cz::keep_what_acted(&mut self.table) {
                let message = "no row has a verified register value, so the Cz that acted is not known: \
                               leave this log out";
                self.refuse_at(&format!("every {}", self.row), Some(&column), message);
            }
        }
        if self.unlisted > 0 {
            let more = format!("{}: further errors: {}", self.table.file.display(), self.unlisted);
            self.listed.push(more);
        }
        BadLog::unless(self.listed, self.table)
    }

    /// Returns the cells of a finished column: numbers if all cells are numbers. A used column with both numbers and
    /// texts is an error at its first text.
    fn cells(&mut self, name: &str, column: Column) -> Cells {
        let Some((line, text)) = column.text else {
            let of = if column.is_used { Cells::Numbers } else { Cells::Unread };
            return of(column.numbers);
        };
        let dotted = text.replace(',', ".");
        let has_comma = text.contains(',') && dotted.parse::<f64>().is_ok();
        if !has_comma && !column.has_numbers {
            return Cells::Text(column.words.unwrap_or_default());
        }
        if !column.is_used {
            return Cells::Unread(column.numbers);
        }
        let hint = match has_comma {
            true => format!("`{text}` has a decimal comma; write {dotted}"),
            false => format!("`{text}` is no number; leave the cell empty if the value is missing"),
        };
        self.refuse(line, Some(name), hint);
        Cells::Numbers(column.numbers)
    }
}

/// Error: the file is larger than allowed. The reader has already added the message.
#[derive(Clone, Copy, Debug)]
pub(super) struct TooMuch;

/// Parses a time in minutes.
fn minutes(dialect: &mut Dialect, text: &str, _: Option<Moment>) -> Result<Moment, String> {
    let read = time::parse(&dialect.number(text.trim())?)?;
    if text.contains(':') {
        return Err(format!("`{text}` is a date, and `time_min` counts minutes; name the column `time`"));
    }
    // A minute is sixty seconds, computed exactly in nanoseconds.
    let nanos = read.as_nanos().checked_mul(60);
    nanos.map(Moment::from_nanos).ok_or_else(|| format!("`{text}` minutes is too large"))
}

/// Parses a cell as a number; NaN if it is empty; `None` if it is not a number.
fn to_number(text: &str) -> Option<f64> {
    if text.is_empty() {
        return Some(f64::NAN);
    }
    if let Ok(value) = text.parse::<f64>() {
        return Some(if value.is_finite() { value } else { f64::NAN });
    }
    match text {
        "true" => Some(1.0),
        "false" => Some(0.0),
        _ if ["na", "null", "none", "-"].iter().any(|known| text.eq_ignore_ascii_case(known)) => {
            Some(f64::NAN)
        }
        _ => None,
    }
}
