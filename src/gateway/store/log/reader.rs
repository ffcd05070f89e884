//! Reader of decision logs of the gateway (one row per step of the axes), and of logs of other programs.

use std::collections::HashMap;
use std::fmt::Display;
use std::io::Read;

use csv::StringRecord;
use jiff::tz::TimeZone;

use isotherm_core::compensation::{Change, Control, Measured, Permit, Remembered, ReturnTo};
use isotherm_core::quantity::{
    Cell, Conversion, DateOrder, DecimalMark, Dialect, Micron, Moment, TimeColumns, TimeUnit, is_comment,
    names_and_units, time, with_date,
};
use isotherm_core::reading::{Reading, Reason};
use isotherm_profile::log_columns::{
    ACTING, BEHIND, DECIDED, EXPECTED, FORGET, FROM, MEASURED, MEMORY, PERMIT, PREFERRED, RETURN,
    RETURN_SLOPE, SIGN, SLOPE_FROM, STOOD_IN, TIME, TRUST, WORSE, ZERO,
};
use isotherm_profile::safe_file::{self, Lines, quoted};
use isotherm_profile::{Axis, Profile};

/// Column for the measured error of an axis, in a log that another program has written.
const ERROR: &str = "error_um";

/// Error in a log file, with its line and column.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}, line {line}{}: {message}", .column.as_ref().map(|name| format!(", column {name}")).unwrap_or_default())]
pub struct LogError {
    /// Name of the log file.
    pub file: String,
    /// Number of the line in the file. The header is line 1.
    pub line: u64,
    /// Name of the log column; `None` if the error belongs to no column.
    pub column: Option<String>,
    /// Cause of the error, as a text for users.
    pub message: String,
}

/// Properties of a log file that the reader needs in addition to the rows.
#[derive(Clone, Debug, Default)]
pub struct Recording<'a> {
    /// Name of the log, as messages show it.
    pub name: &'a str,
    /// Time zone of times without an offset from UTC. With `None`, the reader rejects such times.
    pub zone: Option<TimeZone>,
    /// Decimal mark of the numbers. With `None`, the mark is detected from the numbers.
    pub decimal: Option<DecimalMark>,
    /// Order of day and month in dates. With `None`, the order is detected from the dates.
    pub dates: Option<DateOrder>,
    /// Unit of times that are numbers. `None` if the column name contains the unit.
    pub time_unit: Option<TimeUnit>,
    /// Cells of the first rows. The reader detects two facts from them: the order of day and month, and whether a
    /// mark before three digits is a decimal mark.
    pub first_rows: Vec<Vec<String>>,
    /// Numbers of lines of the file that were removed: before the line with the column names, and after it.
    pub left_out: [u64; 2],
    /// Lines with an implausible value, for each column of measured errors. Such a value was not measured by a
    /// sensor. The lines are in ascending order.
    pub implausible: HashMap<String, Vec<u64>>,
    /// Warnings about the file that were found before the rows are read.
    pub remarks: Vec<String>,
}

impl<'a> From<&'a str> for Recording<'a> {
    fn from(name: &'a str) -> Recording<'a> {
        Recording { name, ..Recording::default() }
    }
}

impl<'a> From<(&'a str, Option<TimeZone>)> for Recording<'a> {
    fn from((name, zone): (&'a str, Option<TimeZone>)) -> Recording<'a> {
        Recording { name, zone, ..Recording::default() }
    }
}

/// Row of a log: the state of the machine at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogRow {
    /// Number of the line in the log file at which the row begins.
    pub line: u64,
    /// Time as text, as in the log. A number in another unit than seconds is converted to seconds or to a date.
    pub time: String,
    /// Time of the row, for calculations.
    pub now: Moment,
    /// Reading of each signal of the profile.
    pub readings: Vec<Reading>,
    /// Control inputs of each axis of the profile.
    pub controls: Vec<Control>,
    /// Measured error of each axis in µm.
    pub errors: Vec<Option<f64>>,
    /// Decision of each axis in the log; `None` if the log contains no decision.
    pub decided: Vec<Option<LoggedDecision>>,
    /// Saved state in this log row, if a run of the gateway or one of its files begins at this row. Otherwise `None`.
    pub begins: Option<Remembered>,
    /// Requests between the previous log row and this row to change the preferred model: axis and change. `None`
    /// withdraws a request.
    pub preferred: Vec<(usize, Option<Change>)>,
    /// Zero commands between the previous log row and this row: time and axis. The axis is `None` if the command
    /// applies to all references.
    pub zeroed: Vec<(Moment, Option<usize>)>,
}

/// Decision of an axis in the log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoggedDecision {
    /// Cz that the model requested, µm.
    pub raw: Option<f64>,
    /// Cz after the limits of the axis, µm. These limits are `limit`, `deadband`, `step`, `rate` and the rounding to
    /// counts.
    pub cz: f64,
    /// Name of the model.
    pub model: String,
    /// State of the axis.
    pub state: String,
    /// Names of the limits that changed the value: limit, deadband, step, rate, round.
    pub acted: String,
    /// Expected residual error, µm. The outer `None` means that the log has no such column. The inner `None` means
    /// that the cell is empty.
    pub expected: Option<Option<f64>>,
    /// Name of the sensor that a stand-in replaces. `None` if the log has no such column.
    pub stood_in: Option<String>,
    /// "1" if the axis was worse with its model than without compensation. `None` if the log has no such column.
    pub worse: Option<String>,
}

/// Reader of the rows of a log.
#[derive(Debug)]
pub struct LogReader<R> {
    csv: csv::Reader<Lines<R>>,
    file: String,
    dialect: Dialect,
    /// Whether numbers always have a decimal point: commas separate the columns, and the user has set no decimal
    /// mark.
    has_points: bool,
    names: Vec<String>,
    /// Unit conversion of each column whose name contains a unit.
    conversions: Vec<Conversion>,
    /// Number of lines of the file that were removed before the reader receives the text.
    left_out: u64,
    axes: Vec<String>,
    columns: Columns,
    ranges: Vec<Option<(f64, f64)>>,
    /// Lines with an implausible measured error, for each axis, in ascending order.
    implausible: Vec<Vec<u64>>,
    record: StringRecord,
    last: Option<Moment>,
    warnings: Vec<String>,
}

/// Indices of the columns in a decision log.
#[derive(Clone, Debug)]
struct Columns {
    time: TimeColumns,
    signals: Vec<Option<usize>>,
    axes: Vec<AxisColumns>,
    memory: Option<usize>,
    zero: Option<usize>,
}

#[derive(Clone, Copy, Debug)]
struct AxisColumns {
    permit: Option<usize>,
    from: Option<usize>,
    slope_from: Option<usize>,
    measured: Option<usize>,
    acting: Option<usize>,
    forget: Option<usize>,
    sign: Option<usize>,
    behind: Option<usize>,
    return_to: Option<usize>,
    return_slope: Option<usize>,
    error: Option<usize>,
    decided: Option<[usize; 5]>,
    expected: Option<usize>,
    stood_in: Option<usize>,
    trust: Option<usize>,
    worse: Option<usize>,
    preferred: Option<usize>,
}

/// Limit of a measured error, µm. Some loggers write a larger number if no error was measured.
const NO_ERROR: f64 = 1e6;
/// Smallest number of seconds since 1970 that is shown as a date. The number belongs to the year 1980.
const FIRST_DATE: u64 = 315_532_800;

/// Maximum number of warnings. Without this limit, a log with a wrong clock would give one warning for each row.
const MOST_WARNINGS: usize = 20;

impl<R: Read> LogReader<R> {
    /// Reads the header.
    ///
    /// # Errors
    /// The header has no column `time`, no signal of the profile, or the same column name twice.
    pub fn open<'a>(
        profile: &Profile,
        input: R,
        recording: impl Into<Recording<'a>>,
    ) -> Result<LogReader<R>, LogError> {
        let recording: Recording<'a> = recording.into();
        let Recording { name: file, zone, decimal, dates, time_unit, first_rows, left_out, .. } = recording;
        let [before, after] = left_out;
        let error =
            |message: String| LogError { file: file.to_owned(), line: 1 + before, column: None, message };
        let (first, input) = safe_file::first_line(input).map_err(|cause| error(cause.to_string()))?;
        let mut dialect = Dialect::of(&first, zone).with(decimal, dates);
        let mut csv =
            csv::ReaderBuilder::new().flexible(true).delimiter(dialect.separator()).from_reader(input);
        let header = csv.headers().map_err(|cause| error(cause.to_string()))?;
        let headers: Vec<String> =
            header.iter().map(|name| name.trim().trim_start_matches('\u{feff}').to_owned()).collect();
        if headers.iter().all(String::is_empty) {
            return Err(error("the log is empty; its first line names the columns".to_owned()));
        }
        let time = TimeColumns::find(&headers, time_unit).ok_or_else(|| {
            error(format!("there is no column {TIME}; the columns are {}", quoted(&headers.join(", "))))
        })?;
        if time.is_in_utc {
            dialect = dialect.in_utc();
        }
        let dated = time.date.unwrap_or(time.time);
        first_rows.iter().filter_map(|cells| cells.get(dated)).for_each(|text| dialect.learn_dates(text));
        dialect.learn_marks(first_rows.iter().map(|cells| cells.iter().map(String::as_str).collect()));
        let (names, units): (Vec<String>, Vec<String>) = names_and_units(&headers).into_iter().unzip();
        let conversions = names.iter().zip(&units).map(|(name, unit)| Conversion::of(name, unit)).collect();
        let mut places = HashMap::new();
        for (place, name) in names.iter().enumerate() {
            if !name.is_empty() && places.insert(name.as_str(), place).is_some() {
                return Err(error(format!("the column {} occurs twice; rename one", quoted(name))));
            }
        }
        let columns = Columns::find(profile, &places, time);
        let missing: Vec<&str> = (profile.signals.iter().zip(&columns.signals))
            .filter_map(|(signal, place)| place.is_none().then_some(signal.name.as_str()))
            .collect();
        if missing.len() == profile.signals.len() {
            let message =
                format!("none of the profile's signals is in the log: {}", quoted(&missing.join(", ")));
            return Err(error(message));
        }
        let mut warnings = recording.remarks;
        if !missing.is_empty() {
            warnings
                .push(format!("{file}: these signals are not in the log: {}", quoted(&missing.join(", "))));
        }
        let mut lines = recording.implausible;
        let lines_of =
            |axis: &Axis| lines.remove(&format!("{}_{ERROR}", axis.settings.name)).unwrap_or_default();
        let implausible = profile.axes.iter().map(lines_of).collect();
        let ranges = profile.signals.iter().map(|signal| signal.range).collect();
        let record = StringRecord::new();
        let axes = profile.axes.iter().map(|axis| axis.settings.name.clone()).collect();
        let (file, left_out) = (file.to_owned(), before + after);
        Ok(LogReader {
            csv,
            file,
            has_points: dialect.separator() == b',' && decimal.is_none(),
            dialect,
            names,
            conversions,
            left_out,
            axes,
            columns,
            ranges,
            implausible,
            record,
            last: None,
            warnings,
        })
    }

    /// Returns the warnings about the log rows that were read.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Returns whether the log has a column with the measured error of this axis.
    pub fn has_error(&self, axis: usize) -> bool {
        self.columns.axes.get(axis).is_some_and(|columns| columns.error.is_some())
    }

    /// Reads the next row of the log. Returns `None` at the end.
    ///
    /// # Errors
    /// The row cannot be read. The error contains its line and column.
    pub fn next_row(&mut self) -> Result<Option<LogRow>, LogError> {
        if !self.read_record()? {
            return Ok(None);
        }
        let line = self.line();
        let (found, wanted) = (self.record.len(), self.names.len());
        if !self.fits() {
            if found < wanted && !self.read_record()? {
                self.warn(format!("line {line}: the last row is incomplete and is left out"));
                return Ok(None);
            }
            let hint = if found > wanted { "; are there decimal commas?" } else { "" };
            let message =
                format!("the row has {found} cells, but the header has {wanted} column names{hint}");
            return Err(LogError { file: self.file.clone(), line, column: None, message });
        }
        self.point()?;
        let row = self.row(line)?;
        if self.last.is_some_and(|last| row.now < last) {
            self.warn(format!("line {line}: the time goes back to {}", row.time));
        }
        self.last = Some(row.now);
        Ok(Some(row))
    }

    /// Returns whether the number of cells fits the column names. Cells at the end may be missing if their
    /// columns are comments or have no name. Additional cells must be empty.
    fn fits(&self) -> bool {
        let (found, wanted) = (self.record.len(), self.names.len());
        match found > wanted {
            true => self.record.iter().skip(wanted).all(|cell| cell.trim().is_empty()),
            false => self.names[found..].iter().all(|name| name.is_empty() || is_comment(name)),
        }
    }

    fn read_record(&mut self) -> Result<bool, LogError> {
        loop {
            self.csv.get_mut().row_is_over();
            let read = self.csv.read_record(&mut self.record);
            let read = read.map_err(|cause| {
                let why = unreadable(&self.file, self.csv.position().line(), &cause);
                LogError { line: why.line + self.left_out, ..why }
            })?;
            // Spreadsheets end with thousands of empty rows.
            if !read || self.record.iter().any(|cell| !cell.trim().is_empty()) {
                return Ok(read);
            }
        }
    }

    /// Replaces decimal commas in the log row by points, unless commas separate the columns. The column with the time
    /// is not changed.
    fn point(&mut self) -> Result<(), LogError> {
        if self.has_points {
            return Ok(());
        }
        let TimeColumns { time, date, .. } = self.columns.time;
        let mut pointed = StringRecord::new();
        for (place, cell) in self.record.iter().enumerate() {
            if place == time || date == Some(place) {
                pointed.push_field(cell);
                continue;
            }
            match self.dialect.number(cell.trim()) {
                Ok(number) => pointed.push_field(&number),
                Err(message) => return Err(self.error(self.line(), place, message)),
            }
        }
        self.record = pointed;
        Ok(())
    }

    /// Returns the number of the line at which the log row begins. The CSV reader only knows where the row ends, and
    /// a quoted cell may contain line breaks.
    fn line(&self) -> u64 {
        let inside = self.record.iter().flat_map(str::bytes).filter(|byte| *byte == b'\n').count();
        self.left_out + self.csv.position().line().saturating_sub(1 + inside as u64)
    }

    fn warn(&mut self, warning: String) {
        match self.warnings.len() {
            MOST_WARNINGS.. => {}
            length if length + 1 == MOST_WARNINGS => {
                self.warnings.push(format!("{}: further warnings are left out", self.file));
            }
            _ => self.warnings.push(format!("{}, {warning}", self.file)),
        }
    }

    fn row(&mut self, line: u64) -> Result<LogRow, LogError> {
        let columns = self.columns.time;
        let time =
            with_date(self.cell(columns.time), columns.date.map(|place| self.cell(place))).into_owned();
        if self.last.is_none() {
            self.columns.time.unit = columns.unit_of(&self.names[columns.time], &time);
        }
        let now = self.dialect.moment_in(self.columns.time.unit, &time, self.last);
        let now = now.map_err(|message| self.error(line, columns.time, message))?;
        let mut row = LogRow { line, time: in_seconds(time, now), now, ..LogRow::default() };
        let mut left_out = Vec::new();
        for (place, range) in self.columns.signals.iter().zip(&self.ranges) {
            row.readings.push(reading(self.number(line, *place)?, *range, now));
        }
        let axes = self.columns.axes.iter().zip(&self.implausible);
        for (axis, (columns, implausible)) in axes.enumerate() {
            if let Some((place, text)) = self.filled(columns.preferred) {
                let change = serde_json::from_str(text).map_err(|cause| self.error(line, place, cause))?;
                row.preferred.push((axis, change));
            }
            row.controls.push(self.control(line, columns)?);
            let error = self.number(line, columns.error)?.filter(|error| error.is_finite());
            let error = error.filter(|_| implausible.binary_search(&line).is_err());
            left_out.extend(error.filter(|error| error.abs() >= NO_ERROR));
            row.errors.push(error.filter(|error| error.abs() < NO_ERROR));
            row.decided.push(self.decided(line, columns)?);
        }
        for error in left_out {
            self.warn(format!(
                "line {line}: an error of {error:e} µm is not a measured value and is left out"
            ));
        }
        if let Some((place, text)) = self.filled(self.columns.memory) {
            let remembered = serde_json::from_str(text).map_err(|cause| self.error(line, place, cause))?;
            row.begins = Some(remembered);
        }
        if let Some((place, text)) = self.filled(self.columns.zero) {
            for text in text.split(';') {
                let zeroed = self.zeroed(text).map_err(|message| self.error(line, place, message))?;
                row.zeroed.push(zeroed);
            }
        }
        Ok(row)
    }

    /// Parses a zero command: a time, and after it the name of an axis. Without a name, the axis is `None`, and the
    /// command applies to all references.
    fn zeroed(&self, text: &str) -> Result<(Moment, Option<usize>), String> {
        let (at, name) = text.split_once(' ').map_or((text, None), |(at, name)| (at, Some(name)));
        let place = |name| {
            let place = self.axes.iter().position(|axis| axis == name);
            place.ok_or_else(|| format!("there is no axis {name}; there are {}", self.axes.join(", ")))
        };
        Ok((time::parse(at)?, name.map(place).transpose()?))
    }

    /// Returns the control inputs of an axis. If the log has no column for permits, the axis is armed, and its
    /// register holds zero in the first row.
    fn control(&self, line: u64, columns: &AxisColumns) -> Result<Control, LogError> {
        let take_over = self.micron(line, columns.from)?;
        let take_over_slope = self.micron(line, columns.slope_from)?;
        let acting = self.micron(line, columns.acting)?;
        let measured = self.micron(line, columns.measured)?.map(|error| Measured { error, acting });
        let forget = self.filled(columns.forget).is_some();
        let sign = self.micron(line, columns.sign)?;
        let behind = self.micron(line, columns.behind)?;
        let slope = self.micron(line, columns.return_slope)?.unwrap_or(Micron::ZERO);
        let return_to = self.micron(line, columns.return_to)?.map(|cz| ReturnTo { cz, slope });
        let trust = self.filled(columns.trust).is_some();
        let Some(place) = columns.permit else {
            let at_rest = self.last.is_none().then_some(Micron::ZERO);
            return Ok(Control {
                permit: Permit::Armed,
                take_over: take_over.or(at_rest),
                forget,
                measured,
                sign,
                trust,
                behind,
                return_to,
                ..Control::default()
            });
        };
        let word = self.cell(place).trim();
        let permit = Permit::from_name(word).ok_or_else(|| {
            self.error(line, place, format!("`{word}` is not one of off, armed, unverified, held, stopping"))
        })?;
        Ok(Control { permit, take_over, take_over_slope, forget, measured, sign, trust, behind, return_to })
    }

    fn decided(&self, line: u64, columns: &AxisColumns) -> Result<Option<LoggedDecision>, LogError> {
        let Some([raw, cz, model, state, acted]) = columns.decided else { return Ok(None) };
        let Some(cz) = self.number(line, Some(cz))? else { return Ok(None) };
        Ok(Some(LoggedDecision {
            raw: self.number(line, Some(raw))?,
            cz,
            model: self.cell(model).to_owned(),
            state: self.cell(state).to_owned(),
            acted: self.cell(acted).to_owned(),
            expected: match columns.expected {
                Some(_) => Some(self.number(line, columns.expected)?),
                None => None,
            },
            stood_in: columns.stood_in.map(|place| self.cell(place).to_owned()),
            worse: columns.worse.map(|place| self.cell(place).to_owned()),
        }))
    }

    fn cell(&self, place: usize) -> &str {
        self.record.get(place).unwrap_or_default()
    }

    fn filled(&self, place: Option<usize>) -> Option<(usize, &str)> {
        let place = place?;
        Some((place, self.cell(place))).filter(|(_, text)| !text.is_empty())
    }

    /// Parses a number, which may be NaN or infinite. Returns `None` if the cell is empty.
    fn number(&self, line: u64, place: Option<usize>) -> Result<Option<f64>, LogError> {
        let Some((place, text)) = self.filled(place) else { return Ok(None) };
        let text = text.trim();
        if text.is_empty() {
            return Ok(None);
        }
        let conversion = self.conversions.get(place).copied().unwrap_or_default();
        if let Ok(value) = text.parse() {
            return Ok(Some(conversion.apply(value)));
        }
        // Cells with units and the messages of loggers are rare, so the dialect may be copied.
        match self.dialect.clone().cell(text) {
            Ok(Cell::Number(value, "")) => Ok(Some(conversion.apply(value))),
            Ok(Cell::Number(value, unit)) => Ok(Some(Conversion::of(&self.names[place], unit).apply(value))),
            Ok(Cell::Absent | Cell::Unavailable) => Ok(None),
            Ok(Cell::Failed) => Ok(Some(f64::NAN)),
            Ok(Cell::Text) => Err(self.error(line, place, format!("`{text}` is not a number"))),
            Err(message) => Err(self.error(line, place, message)),
        }
    }

    fn micron(&self, line: u64, place: Option<usize>) -> Result<Option<Micron>, LogError> {
        Ok(self.number(line, place)?.and_then(Micron::new))
    }

    fn error(&self, line: u64, place: usize, message: impl Display) -> LogError {
        let column = self.names.get(place).cloned();
        LogError { file: self.file.clone(), line, column, message: message.to_string() }
    }
}

/// Creates the error of an invalid row. `line` is used if the cause contains no position.
pub(super) fn unreadable(file: &str, line: u64, cause: &csv::Error) -> LogError {
    let message = match cause.kind() {
        csv::ErrorKind::Utf8 { .. } => "this is not text in UTF-8; save the file again as UTF-8".to_owned(),
        _ => cause.to_string(),
    };
    let line = cause.position().map_or(line, csv::Position::line);
    LogError { file: file.to_owned(), line, column: None, message }
}

impl Columns {
    fn find(profile: &Profile, places: &HashMap<&str, usize>, time: TimeColumns) -> Columns {
        let at = |name: &str| places.get(name).copied();
        let axes = profile.axes.iter().map(|axis| {
            let of = |column: &str| at(&format!("{}_{column}", axis.settings.name));
            let [raw, cz, model, state, acted] = DECIDED.map(of);
            let decided = (|| Some([raw?, cz?, model?, state?, acted?]))();
            AxisColumns {
                permit: of(PERMIT),
                from: of(FROM),
                slope_from: of(SLOPE_FROM),
                measured: of(MEASURED),
                acting: of(ACTING),
                forget: of(FORGET),
                sign: of(SIGN),
                behind: of(BEHIND),
                return_to: of(RETURN),
                return_slope: of(RETURN_SLOPE),
                error: of(ERROR),
                decided,
                expected: of(EXPECTED),
                stood_in: of(STOOD_IN),
                trust: of(TRUST),
                worse: of(WORSE),
                preferred: of(PREFERRED),
            }
        });
        Columns {
            time,
            signals: profile.signals.iter().map(|signal| at(&signal.name)).collect(),
            axes: axes.collect(),
            memory: at(MEMORY),
            zero: at(ZERO),
        }
    }
}

/// Returns the text of the time `now` in a log. `text` is the original text. A number in another unit than
/// seconds is converted to seconds, or to a date, because the program reads a time that is a number as
/// seconds.
fn in_seconds(text: String, now: Moment) -> String {
    let is_number = text.trim().replace(',', ".").parse::<f64>().is_ok();
    if !is_number || time::parse(&text) == Ok(now) {
        return text;
    }
    let (seconds, nanos) = (now.as_nanos() / 1_000_000_000, now.as_nanos() % 1_000_000_000);
    if seconds >= FIRST_DATE {
        let mut date = Vec::new();
        time::write(&mut date, now);
        return String::from_utf8_lossy(&date).into_owned();
    }
    format!("{seconds}.{nanos:09}").trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Checks a value as the gateway checks it. A value outside the sensor's range is rejected, for example −32 °C from a
/// broken sensor.
fn reading(value: Option<f64>, range: Option<(f64, f64)>, now: Moment) -> Reading {
    match (value, range) {
        (None, _) => Reading::bad(now, Reason::NotInLog),
        (Some(value), _) if !value.is_finite() => Reading::bad(now, Reason::NotANumber),
        (Some(value), Some((low, high))) if !(low..=high).contains(&value) => {
            Reading::bad(now, Reason::OutOfRange)
        }
        (Some(value), _) => Reading::good(value, now),
    }
}
