//! Table of one log file: times and columns, before the file is divided into runs. `Reader` fills it while a file is
//! read.

use std::collections::HashMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use super::series::Series;
use super::time_form::TimeForm;
use super::unit::are_alike;
use super::words::{MOST_WORDS, Messages, Words};
use super::{BadLog, active_cz, steps};
use isotherm_core::quantity::{
    Cell, Conversion, DateOrder, DecimalMark, Dialect, Moment, TimeColumns, TimeUnit, names_and_units,
};
use isotherm_profile::counted;
use isotherm_profile::safe_file::quoted;

/// Maximum number of rows of a file: seven months with one row per second. More rows would take too long to read.
const MOST_ROWS: usize = 20_000_000;
/// Maximum count of numbers in a file. In memory, they need at most 8 bytes each, which is 1.2 GB.
const MOST_NUMBERS: usize = 150_000_000;
/// Number of rows that are read of an unused log column. Its kind is guessed from these rows.
const SAMPLED: usize = 1000;
/// Maximum number of errors that are listed one by one. Further errors are only counted.
const MOST_LISTED: usize = 20;

/// Function that returns the unit of a log column according to the profile; `None` if the profile has no signal of this
/// name.
pub type Units<'a> = &'a dyn Fn(&str) -> Option<&'static str>;

/// Function that returns whether the column of this name is used. An unused column is not read completely, because a
/// log may have hundreds of columns, but a model requires about ten.
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
    /// Number of each table row in the file, for messages.
    pub(super) lines: Numbering,
    /// Word that messages use for a row of the file: "line" or "row".
    pub(super) row: &'static str,
    pub(super) columns: Vec<(String, Cells)>,
    /// Unit of each column that has a unit in its header or cells. The key is the name of the column.
    pub(super) units: HashMap<String, String>,
    /// Conversion of the values of each column whose unit differs from the unit that the program uses.
    pub(super) conversions: HashMap<String, Conversion>,
    /// Used columns without any number. Each item is the column name, and the reason.
    pub(super) lost: Vec<(String, String)>,
    /// Unused columns without any number. Each item is the column name, and the reason.
    pub(super) texts: Vec<(String, String)>,
    /// Messages that a logger wrote instead of values. The key is the name of the column.
    failed: HashMap<String, Messages>,
    /// Words for values that are not available, such as `n/a`. The key is the name of the column.
    unavailable: HashMap<String, Messages>,
    /// Names of the columns that contain the active Cz (compensation value that acted during the
    /// measurement).
    pub(super) acted: Vec<String>,
    /// Rows directly after a zero command, each with the axis of the command; `None` for all axes. Only logs of the
    /// gateway contain zero commands.
    pub(super) zeros: Vec<(usize, Option<String>)>,
    /// Whether the machine was already on before the first row, according to a gateway log.
    pub(super) continues: bool,
    pub(super) understood: Understood,
}

/// Format of a log file, by which its times and numbers were read.
#[derive(Clone, Debug, Default)]
pub(super) struct Understood {
    /// Name of the column with the time, and of the column with the date if there is one.
    pub(super) time: String,
    pub(super) date: Option<String>,
    /// Format of the times: numbers, texts or time stamps.
    pub(super) form: TimeForm,
    /// Unit of the times, if the times are numbers.
    pub(super) unit: TimeUnit,
    /// Whether the times are numbers from the start of the log, and nothing states their unit.
    pub(super) is_unit_assumed: bool,
    /// Whether the name of the time column states that its times are in UTC.
    pub(super) is_in_utc: bool,
    pub(super) decimal: Option<DecimalMark>,
    pub(super) dates: Option<DateOrder>,
}

/// Cells of a column in the finished table.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cells {
    /// Numbers; NaN if missing.
    Numbers(Series),
    /// Texts, for example names and states. A column is stored as text only if it may divide the log into runs, or
    /// shows when Cz (the compensation value) was active.
    Text(Words),
    /// First numbers of an unused column, from which its kind is guessed.
    Unread(Series),
}

/// Line number in the file of each table row. A line number is stored only if it is not the previous line number plus
/// one.
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

    pub(super) fn cells_mut(&mut self, name: &str) -> Option<&mut Cells> {
        self.columns.iter_mut().find(|(known, _)| known == name).map(|(_, cells)| cells)
    }

    pub(super) fn numbers(&self, name: &str) -> Option<&Series> {
        match self.cells(name)? {
            Cells::Numbers(numbers) => Some(numbers),
            Cells::Text(_) | Cells::Unread(_) => None,
        }
    }

    pub(super) fn names_of_numbers(&self) -> impl Iterator<Item = &str> {
        let numbers = self.columns.iter().filter(|(_, cells)| matches!(cells, Cells::Numbers(_)));
        numbers.map(|(name, _)| name.as_str())
    }

    /// Returns the rows in which this column contains a message of the logger instead of a value.
    pub(super) fn failed_rows(&self, name: &str) -> impl Iterator<Item = usize> {
        self.failed.get(name).into_iter().flat_map(Messages::rows)
    }

    /// Returns the rows in which this column contains a word for a value that is not available.
    pub(super) fn unavailable_rows(&self, name: &str) -> impl Iterator<Item = usize> {
        self.unavailable.get(name).into_iter().flat_map(Messages::rows)
    }

    /// Returns the word that this row of a column contains instead of a value; empty if the row has a value.
    pub(super) fn word(&self, name: &str, row: usize) -> &str {
        let mut kinds = [&self.failed, &self.unavailable].into_iter();
        kinds.find_map(|words| words.get(name)?.of(row)).unwrap_or_default()
    }

    /// Returns the unused columns, with their first numbers.
    pub(super) fn unread(&self) -> impl Iterator<Item = (&str, &Series)> {
        self.columns.iter().filter_map(|(name, cells)| match cells {
            Cells::Unread(sample) => Some((name.as_str(), sample)),
            Cells::Numbers(_) | Cells::Text(_) => None,
        })
    }
}

/// Column of the table while the file is read.
#[derive(Debug, Default)]
struct Column {
    name: String,
    numbers: Series,
    /// Texts of the column; `None` if they are not needed.
    words: Option<Words>,
    /// Whether at least one cell of the column was a number.
    has_numbers: bool,
    /// Line and text of the first cell that is not a number.
    text: Option<(u64, String)>,
    /// Unit in the header or in the first cell with a unit; empty if there is none.
    unit: String,
    conversion: Conversion,
    failed: Messages,
    unavailable: Messages,
    /// Whether the column is used. Only the first cells of an unused column are read.
    is_used: bool,
    /// Whether no more cells of the column are read, because enough cells were read or because an error was reported.
    is_over: bool,
}

/// Reader that fills a table row by row, and collects the errors in the file.
pub(super) struct Reader {
    table: Table,
    columns: Vec<Column>,
    /// Indices of the columns that contain the time of a row: time, and date if it is separate.
    time: TimeColumns,
    /// Unit of the times if they are numbers; `None` before the first row.
    unit: Option<TimeUnit>,
    /// Format of the times. The first row shows whether they are numbers or texts.
    form: TimeForm,
    /// Number of columns that are read completely, without the time.
    kept: usize,
    /// Word that messages use for a row of the file: "line" or "row".
    row: &'static str,
    dialect: Dialect,
    /// Row and message of the first invalid time, and the number of further invalid times.
    untimed: Option<(u64, String, u64)>,
    listed: Vec<String>,
    unlisted: usize,
}

impl Reader {
    /// Creates a reader; `None` if no column contains the time. `by` is the name of the column that divides the file
    /// into runs. `uses` selects the columns. `stated` is the unit of times that are numbers, if the operator has
    /// stated it.
    pub(super) fn new(
        file: &Path,
        names: Vec<String>,
        (row, dialect): (&'static str, Dialect),
        (by, stated): (Option<&str>, Option<TimeUnit>),
        uses: Uses<'_>,
    ) -> Option<Reader> {
        let time = TimeColumns::find(&names, stated)?;
        let dialect = if time.is_in_utc { dialect.in_utc() } else { dialect };
        let plain = names_and_units(&names);
        let column = |(place, (name, unit)): (usize, (String, String))| {
            let has_words = by == Some(name.as_str()) || active_cz::needs_words(&name);
            let is_date = time.date == Some(place) && !has_words;
            let is_over = place == time.time || is_date || name.is_empty();
            let is_used = has_words || active_cz::needs(&name) || uses(&name);
            let conversion = Conversion::of(&name, &unit);
            let words = has_words.then(Words::default);
            Column { words, is_used, is_over, name, unit, conversion, ..Column::default() }
        };
        let columns: Vec<Column> = plain.into_iter().enumerate().map(column).collect();
        Some(Reader {
            table: Table { file: file.to_owned(), row, ..Table::default() },
            time,
            unit: None,
            form: TimeForm::default(),
            kept: columns.iter().filter(|column| column.is_used && !column.is_over).count(),
            columns,
            row,
            dialect,
            untimed: None,
            listed: Vec::new(),
            unlisted: 0,
        })
    }

    /// Adds an error in the row with the number `number` of the file.
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

    /// Sets the format of the times, because the file declares it.
    #[cfg(feature = "parquet")]
    pub(super) fn declare_times(&mut self, form: TimeForm) {
        self.form = form;
    }

    /// Returns the index of the time column.
    pub(super) fn time_at(&self) -> usize {
        self.time.time
    }

    /// Returns the index of the column with the date; `None` if the time column has the date.
    pub(super) fn date_at(&self) -> Option<usize> {
        self.time.date
    }

    /// Detects two properties of the log from its first rows: the order of day and month in dates, and
    /// whether a mark before three digits is a decimal mark. The caller reads these rows again later.
    pub(super) fn learn<'a>(&mut self, rows: impl Iterator<Item = Vec<&'a str>> + Clone) {
        let dated = self.time.date.unwrap_or(self.time.time);
        for cells in rows.clone() {
            if let Some(text) = cells.get(dated) {
                self.dialect.learn_dates(text);
            }
        }
        self.dialect.learn_marks(rows);
    }

    /// Returns whether the reader needs the next cell of this column.
    pub(super) fn reads(&self, place: usize) -> bool {
        self.wants(place) > 0
    }

    /// Returns how many more cells of this column the reader needs.
    pub(super) fn wants(&self, place: usize) -> usize {
        match self.columns.get(place) {
            Some(column) if column.is_over => 0,
            Some(column) if column.is_used => usize::MAX,
            Some(column) => SAMPLED.saturating_sub(column.numbers.len()),
            None => 0,
        }
    }

    /// Returns the number of columns that are read completely, without the time.
    #[cfg(feature = "parquet")]
    pub(super) fn kept(&self) -> usize {
        self.kept
    }

    /// Returns whether the cells of this column must be kept as texts. Texts are kept only if the column may
    /// divide the log into runs, or shows when Cz (the compensation value) was active. They are not kept if
    /// all cells so far are numbers.
    #[cfg(feature = "parquet")]
    pub(super) fn needs_words(&self, place: usize) -> bool {
        self.columns.get(place).is_some_and(|column| column.words.is_some())
    }

    /// Stops reading a column whose cells are texts that are not needed. `why` is the reason in the message about the
    /// column.
    #[cfg(feature = "parquet")]
    pub(super) fn is_text(&mut self, place: usize, why: &str) {
        let column = &mut self.columns[place];
        column.is_over = true;
        column.text = Some((0, String::new()));
        let list = if column.is_used { &mut self.table.lost } else { &mut self.table.texts };
        list.push((column.name.clone(), why.to_owned()));
    }

    /// Begins a new row with its time. If the time is invalid, adds an error and returns `Ok(false)`. Returns `Err` if
    /// the file is too large.
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
                format!("{limit}: record fewer rows per minute, divide the file, or leave columns out"),
            );
            return Err(TooMuch);
        }
        let place = self.time.time;
        let last = self.table.times.last().copied();
        let unit = *self.unit.get_or_insert_with(|| self.time.unit_of(&self.columns[place].name, time));
        match self.dialect.moment_in(unit, &quoted(time), last) {
            Ok(moment) => {
                if self.table.times.is_empty() && self.form == TimeForm::Numbers {
                    self.form = TimeForm::of(time);
                }
                self.table.times.push(moment);
                self.table.lines.push(number);
                Ok(true)
            }
            Err(why) => {
                // One mistake is often in every row.
                self.untimed.get_or_insert((number, why, 0)).2 += 1;
                Ok(false)
            }
        }
    }

    /// Adds a cell of the current row as text.
    pub(super) fn text(&mut self, place: usize, number: u64, text: &str) {
        let text = quoted(text.trim());
        let cell = match self.dialect.cell(&text) {
            // A state or a command of the gateway may look like a wrong number.
            _ if active_cz::is_of_machine(&self.columns[place].name) => Cell::Text,
            Ok(cell) => cell,
            Err(_) if !self.columns[place].is_used => Cell::Text,
            Err(why) => return self.end_column(place, number, why),
        };
        let column = &mut self.columns[place];
        let read = match cell {
            Cell::Number(value, "") if column.conversion == Conversion::Same => value,
            Cell::Number(value, unit) if column.words.is_none() => match column.with_unit(value, unit) {
                Ok(value) => value,
                Err(_) if !column.is_used => f64::NAN,
                Err(why) => return self.end_column(place, number, why),
            },
            // `7C` may be the name of a run.
            Cell::Number(..) | Cell::Text => {
                column.text.get_or_insert_with(|| (number, text.clone().into_owned()));
                f64::NAN
            }
            Cell::Absent => f64::NAN,
            Cell::Failed => {
                if column.is_used {
                    column.failed.push(column.numbers.len(), &text);
                }
                f64::NAN
            }
            Cell::Unavailable => {
                if column.is_used {
                    column.unavailable.push(column.numbers.len(), &text);
                }
                f64::NAN
            }
        };
        column.has_numbers |= read.is_finite();
        column.numbers.push(read);
        if column.has_numbers && column.text.is_none() {
            column.words = None;
        } else if column.words.as_mut().is_some_and(|words| !words.push(&text)) {
            let message = format!(
                "the column has more than {MOST_WORDS} different texts, so it cannot divide the log into runs"
            );
            self.end_column(place, number, message);
        }
    }

    /// Adds an error about a column, and stops reading the column.
    fn end_column(&mut self, place: usize, number: u64, message: impl Display) {
        let name = std::mem::take(&mut self.columns[place].name);
        self.refuse(number, Some(&name), message);
        self.columns[place] = Column { name, is_over: true, ..Column::default() };
    }

    /// Adds a cell of the current row as a number; NaN if missing.
    #[cfg(feature = "parquet")]
    pub(super) fn number(&mut self, place: usize, value: f64) {
        let column = &mut self.columns[place];
        column.has_numbers |= value.is_finite();
        if value.is_infinite() && column.is_used {
            column.failed.push(column.numbers.len(), &value.to_string());
        }
        column.numbers.push(if value.is_finite() { column.conversion.apply(value) } else { f64::NAN });
        if column.has_numbers {
            column.words = None;
        }
    }

    /// Returns whether the times are read as seconds by assumption: they are numbers, but neither the file nor the
    /// operator states their unit.
    fn assumes_seconds(&self) -> bool {
        self.form == TimeForm::Numbers && !self.time.is_stated && self.unit == Some(TimeUnit::Seconds)
    }

    /// Returns the finished table, or all errors. If the file has no rows, `empty` is the line number and the message
    /// of the error.
    pub(super) fn finish(mut self, empty: (u64, &str)) -> Result<Table, BadLog> {
        let is_unit_assumed =
            self.assumes_seconds() && self.table.times.first().is_some_and(|first| steps::is_count(*first));
        let name = |place: usize| self.columns[place].name.clone();
        self.table.understood = Understood {
            time: name(self.time.time),
            date: self.time.date.map(name),
            form: self.form,
            unit: self.unit.unwrap_or(self.time.unit),
            is_unit_assumed,
            is_in_utc: self.time.is_in_utc,
            decimal: self.dialect.decimal(),
            dates: self.dialect.dates(),
        };
        if let Some((number, why, rows)) = self.untimed.take() {
            let more = match rows - 1 {
                0 => String::new(),
                more => format!(" (also in {})", counted(more, &format!("more {}", self.row))),
            };
            let (at, name) = (&self.row, quoted(&self.columns[self.time.time].name));
            let message = format!("{}, {at} {number}, column {name}: {why}{more}", self.table.file.display());
            self.listed.insert(0, message);
        }
        if self.assumes_seconds() {
            let first = self.table.times.iter().take(steps::COMPARED);
            let times: Vec<f64> = first.map(|at| at.since(Moment::default()).as_secs_f64()).collect();
            if let Some(why) = steps::question(&self.columns[self.time.time].name, &times) {
                self.listed.insert(0, format!("{}: {why}", self.table.file.display()));
            }
        }
        if self.table.times.is_empty() && self.listed.is_empty() {
            self.refuse(empty.0, None, empty.1);
        }
        for (place, mut column) in std::mem::take(&mut self.columns).into_iter().enumerate() {
            let is_date = self.time.date == Some(place) && column.words.is_none();
            if place != self.time.time && !is_date && !column.name.is_empty() {
                let name = std::mem::take(&mut column.name);
                let cells = self.cells(&name, column);
                self.table.columns.push((name, cells));
            }
        }
        if self.listed.is_empty() {
            for column in active_cz::keep_what_acted(&mut self.table) {
                let message =
                    "no row has a verified register value, so the active Cz is not known: leave this log out";
                self.refuse_at(&format!("every {}", self.row), Some(&column), message);
            }
        }
        let Table { columns, lost, acted, .. } = &mut self.table;
        lost.retain(|(name, _)| {
            columns.iter().any(|(known, _)| known == name) && !active_cz::is_of_touches(name, acted)
        });
        if self.unlisted > 0 {
            let more = format!("{}: further errors: {}", self.table.file.display(), self.unlisted);
            self.listed.push(more);
        }
        BadLog::unless(self.listed, self.table)
    }

    /// Returns the cells of a finished column: numbers if all cells are numbers. If a used column contains numbers and
    /// texts, the first text is reported as an error.
    fn cells(&mut self, name: &str, column: Column) -> Cells {
        if !column.unit.is_empty() {
            self.table.units.insert(name.to_owned(), column.unit);
        }
        if column.conversion != Conversion::Same {
            self.table.conversions.insert(name.to_owned(), column.conversion);
        }
        let first_word =
            column.failed.rows().next().into_iter().chain(column.unavailable.rows().next()).min();
        for (words, of_table) in
            [(column.failed, &mut self.table.failed), (column.unavailable, &mut self.table.unavailable)]
        {
            if words.rows().next().is_some() {
                of_table.insert(name.to_owned(), words);
            }
        }
        let Some((line, text)) = column.text else {
            if column.is_used && !column.is_over && !column.has_numbers {
                let why = match first_word {
                    Some(row) => {
                        let (line, word) = (self.table.lines.of(row), self.table.word(name, row));
                        format!(
                            "{} {line}: `{word}` is not a measured value, and no {} of this column \
                             has a value",
                            self.row, self.row
                        )
                    }
                    None => "the column has no values".to_owned(),
                };
                self.table.lost.push((name.to_owned(), why));
            }
            let of = if column.is_used { Cells::Numbers } else { Cells::Unread };
            return of(column.numbers);
        };
        if !column.has_numbers {
            if column.words.is_none() && !column.is_over {
                let why = format!("{} {line}: `{text}` is not a number", self.row);
                let list = if column.is_used { &mut self.table.lost } else { &mut self.table.texts };
                list.push((name.to_owned(), why));
            }
            return Cells::Text(column.words.unwrap_or_default());
        }
        if !column.is_used {
            return Cells::Unread(column.numbers);
        }
        let hint = format!("`{text}` is not a number; leave the cell empty if the value is missing");
        self.refuse(line, Some(name), hint);
        Cells::Numbers(column.numbers)
    }
}

/// Error: the file is larger than allowed. The reader has already added a message about this.
#[derive(Clone, Copy, Debug)]
pub(super) struct TooMuch;

impl Column {
    /// Converts a value of a column from the unit `unit`; an empty text means no unit. All cells of a column must have
    /// the same unit.
    fn with_unit(&mut self, value: f64, unit: &str) -> Result<f64, String> {
        if !unit.is_empty() && self.unit.is_empty() {
            let conversion = Conversion::of(&self.name, unit);
            // The numbers before had no unit.
            if self.has_numbers && conversion != Conversion::Same {
                return Err(format!(
                    "the unit `{unit}` follows this number, but not the numbers before it: write the same \
                     unit after all numbers of the column"
                ));
            }
            unit.clone_into(&mut self.unit);
            self.conversion = conversion;
        }
        match unit.is_empty() || unit == self.unit || are_alike(&self.name, unit, &self.unit) {
            true => Ok(self.conversion.apply(value)),
            false => Err(format!(
                "the unit `{unit}` follows this number, but the column is in {}: use the same unit for all \
                 numbers of the column",
                self.unit
            )),
        }
    }
}
