//! One file: its time and its columns, before it is split into runs.

use std::collections::HashMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use super::{BadLog, Uses, acted};
use isotherm_core::quantity::{Dialect, Moment, time};
use isotherm_profile::regular::quoted;

/// Rows of one file: a row a second for seven months. What lies beyond takes longer than anybody waits for a first word.
const MOST_ROWS: usize = 20_000_000;
/// Numbers of one file, 8 bytes each: 1.2 GB.
const MOST_NUMBERS: usize = 150_000_000;
/// Different texts of a column by which runs are told apart.
const MOST_WORDS: usize = 100_000;
/// Rows of a column that nobody uses which are looked at, to tell what it is.
const SAMPLED: usize = 1000;
/// Mistakes that are listed; the others are counted.
const MOST_LISTED: usize = 20;

/// The rows of one file, column by column.
#[derive(Clone, Debug, Default)]
pub(super) struct Table {
    pub(super) file: PathBuf,
    pub(super) times: Vec<Moment>,
    /// The line, or row, of the file that each row came from.
    pub(super) lines: Numbering,
    pub(super) columns: Vec<(String, Cells)>,
    /// Columns with the Cz that acted.
    pub(super) acted: Vec<String>,
}

/// The cells of a column.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cells {
    /// NaN where one is missing.
    Numbers(Vec<f64>),
    /// Names, states, products: nothing to compute with, but runs may be told apart by them. Kept only where they are.
    Text(Words),
    /// Nobody uses it: its first numbers, which tell what it is.
    Unread(Vec<f64>),
}

/// The texts of a column, trimmed, each kept once.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Words {
    places: Vec<u32>,
    words: Vec<String>,
    known: HashMap<String, u32>,
}

impl Words {
    /// By row.
    pub(super) fn iter(&self) -> impl Iterator<Item = &str> {
        self.places.iter().map(|place| self.words[*place as usize].as_str())
    }

    /// Whether there was room for it.
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

/// The number that each row has in its file: mostly the next one, so that only where it is not is kept.
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

    /// Of this row, counted from nought.
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

    /// Columns that nobody uses, with some of their numbers.
    pub(super) fn unread(&self) -> impl Iterator<Item = (&str, &[f64])> {
        self.columns.iter().filter_map(|(name, cells)| match cells {
            Cells::Unread(sample) => Some((name.as_str(), sample.as_slice())),
            Cells::Numbers(_) | Cells::Text(_) => None,
        })
    }
}

/// Reads a cell of the time, behind the time of the row before.
type ReadTime = fn(&mut Dialect, &str, Option<Moment>) -> Result<Moment, String>;

/// A column while it is read.
#[derive(Debug, Default)]
struct Column {
    name: String,
    numbers: Vec<f64>,
    /// Its texts, where they may tell something.
    words: Option<Words>,
    /// Some cell was a number.
    has_numbers: bool,
    /// The first cell that was none, and where it stood.
    text: Option<(u64, String)>,
    /// Somebody computes with it; else some of its cells are enough.
    is_used: bool,
    /// It is not read, or no longer: a mistake in it has been told.
    is_over: bool,
}

/// A table while it is read, with the mistakes that are found.
pub(super) struct Reader {
    table: Table,
    columns: Vec<Column>,
    /// The place of the time, and what reads its cells.
    time: (usize, ReadTime),
    /// How many columns are kept.
    kept: usize,
    /// What the file calls a row: line, row.
    row: &'static str,
    dialect: Dialect,
    listed: Vec<String>,
    unlisted: usize,
}

impl Reader {
    /// `None` where no column is the time. `by`: the column by which runs are told apart. `uses`: whether somebody computes
    /// with a column.
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
            let has_words = by == Some(name.as_str()) || acted::tells_by_words(&name);
            let is_over = place == time.0 || name.is_empty();
            let is_used = has_words || acted::needs(&name) || uses(&name);
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

    /// Adds a mistake in a row of the file.
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

    /// Where the time stands.
    pub(super) fn time_at(&self) -> usize {
        self.time.0
    }

    /// Whether the next cell of this column is asked for.
    pub(super) fn reads(&self, place: usize) -> bool {
        self.wants(place) > 0
    }

    /// How many more cells of this column are asked for.
    pub(super) fn wants(&self, place: usize) -> usize {
        match self.columns.get(place) {
            Some(column) if column.is_over => 0,
            Some(column) if column.is_used => usize::MAX,
            Some(column) => SAMPLED.saturating_sub(column.numbers.len()),
            None => 0,
        }
    }

    /// How many columns are read whole, without the time.
    #[cfg(feature = "parquet")]
    pub(super) fn kept(&self) -> usize {
        self.kept
    }

    /// Whether nothing can be learnt without the texts of this column.
    #[cfg(feature = "parquet")]
    pub(super) fn needs_words(&self, place: usize) -> bool {
        self.columns.get(place).is_some_and(|column| column.words.is_some())
    }

    /// Nothing but text, of which nothing is kept.
    #[cfg(feature = "parquet")]
    pub(super) fn is_text(&mut self, place: usize) {
        self.columns[place].is_over = true;
        self.columns[place].text = Some((0, String::new()));
    }

    /// Begins a row with its time. `false`: its time is none, which has been told.
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

    /// A cell of a row that has begun, as it is written.
    pub(super) fn text(&mut self, place: usize, number: u64, text: &str) {
        let text = quoted(text.trim());
        let read = match self.dialect.separator() {
            b',' => to_number(&text),
            _ => match self.dialect.number(&text) {
                Ok(pointed) => to_number(&pointed),
                Err(_) if !self.columns[place].is_used => None,
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
                format!("more than {MOST_WORDS} different texts: nothing can be told apart by them");
            self.refuse(number, Some(&name), message);
        }
    }

    /// A cell of a row that has begun; NaN where it is missing.
    #[cfg(feature = "parquet")]
    pub(super) fn number(&mut self, place: usize, value: f64) {
        let column = &mut self.columns[place];
        column.has_numbers |= value.is_finite();
        column.numbers.push(if value.is_finite() { value } else { f64::NAN });
        if column.has_numbers {
            column.words = None;
        }
    }

    /// The table as it is learnt from. `empty`: what is said of a file without rows, and of which of its rows.
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

    /// Numbers where they all are. A column with both numbers and texts is a mistake, named at its first text.
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
            false => format!("`{text}` is no number; leave the cell empty where the value is missing"),
        };
        self.refuse(line, Some(name), hint);
        Cells::Numbers(column.numbers)
    }
}

/// A file with more than can be kept of it, which has been told.
#[derive(Clone, Copy, Debug)]
pub(super) struct TooMuch;

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
