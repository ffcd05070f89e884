//! Explanation of how a log is read: its layout, the format of its times, its units, and its first rows.

use std::fmt;
use std::io::{Cursor, Read};
use std::path::Path;

use serde::Serialize;

use super::formats::{named, read_table};
use super::head::{self, Head};
use super::table::{Cells, Table, Understood};
use super::time_form::TimeForm;
use super::{BadLog, Kind, Split, Uses, decode, every_column, files, spaced, unit};
use isotherm_core::quantity::{DateOrder, DecimalMark, Dialect, Moment, TimeUnit, time};

/// Number of bytes at the start of a CSV log that are read for the explanation.
const SAMPLE: u64 = 1 << 16;
/// Number of log rows that are shown.
const SHOWN: usize = 3;
/// Smallest time that counts as a date, in the year 1973. A smaller time is a number that counts from the start of the
/// log.
const FIRST_DATE: Moment = Moment::from_nanos(100_000_000_000_000_000);

/// Explanation of how one log is read.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Explanation {
    /// Path of the log file.
    pub file: String,
    /// Layout of a CSV file; `None` for other files.
    pub csv: Option<CsvLayout>,
    /// Format of the times; `None` if the log cannot be read.
    pub time: Option<TimeLayout>,
    /// Columns of the log except the time column.
    pub columns: Vec<ExplainedColumn>,
    /// First rows of the log, as the program reads them.
    pub rows: Vec<ExplainedRow>,
    /// Errors in the shown part of the log.
    pub errors: Vec<String>,
}

/// Layout of a CSV file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CsvLayout {
    /// Name of the character encoding, for example `UTF-8`.
    pub encoding: &'static str,
    /// Number of the line with the names of the columns.
    pub names_in_line: u64,
    /// Number of the first line with values.
    pub rows_from_line: u64,
    /// Name of the character that separates the columns.
    pub separator: &'static str,
    /// Decimal mark; `None` if no number has a decimal mark.
    pub decimal: Option<&'static str>,
}

/// Format of the times of a log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TimeLayout {
    /// Name of the column with the time.
    pub column: String,
    /// Name of the column with the date; `None` if date and time are in one column.
    pub date: Option<String>,
    /// Format of the times. This field is only used for the text output, and is left out of the JSON output.
    #[serde(skip)]
    form: TimeForm,
    /// Unit of times that are numbers.
    pub unit: String,
    /// Time zone that applies to times without an offset from UTC.
    pub zone: String,
    /// Order of day and month; `None` if no date shows the order.
    pub dates: Option<&'static str>,
}

/// Explanation of one column of a log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExplainedColumn {
    /// Name of the column without its unit.
    pub name: String,
    /// Unit in the header or in the cells of the column; `None` if the log states no unit.
    pub unit: Option<String>,
    /// Unit into which the values are converted; `None` if the unit of the column is not known.
    pub read_as: Option<&'static str>,
    /// Guessed kind of quantity; `None` if the column has no numbers.
    pub kind: Option<Kind>,
}

/// Row of a log, as the program reads it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExplainedRow {
    /// Number of the row in the file, counted from one: its line in a CSV file.
    pub line: u64,
    /// Time of the row, in the form in which the program reads it.
    pub time: String,
    /// Values of the columns; `None` if a value is missing, or is not a number.
    pub values: Vec<Option<f64>>,
}

/// Explains how a log is read. Errors in the log are part of the explanation.
///
/// # Errors
/// The file cannot be read.
pub fn explain(file: &Path, split: &Split) -> Result<Explanation, BadLog> {
    let mut found = Explanation { file: file.display().to_string(), ..Explanation::default() };
    let (table, layout) =
        if is_csv(file) { of_csv(file, split, &mut found)? } else { of_table(file, split, &mut found) };
    found.csv = layout;
    if let Some(table) = table {
        fill(&mut found, &table, split);
    }
    Ok(found)
}

fn is_csv(file: &Path) -> bool {
    let ending = file.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    !["parquet", "gz", "xlsx", "xlsm", "xls", "xlsb", "ods"]
        .iter()
        .any(|other| ending.eq_ignore_ascii_case(other))
}

type Found = (Option<Table>, Option<CsvLayout>);

fn of_csv(file: &Path, split: &Split, found: &mut Explanation) -> Result<Found, BadLog> {
    let unreadable = |why: std::io::Error| files::cannot_be_read(file, &why);
    let (decoded, encoding) = decode::utf8(files::open(file)?).map_err(unreadable)?;
    let mut text = Vec::new();
    let columns = spaced::columns(decoded).map_err(unreadable)?;
    let are_spaced = columns.is_converted();
    columns.take(SAMPLE).read_to_end(&mut text).map_err(unreadable)?;
    if text.len() as u64 == SAMPLE
        && let Some(end) = text.iter().rposition(|byte| *byte == b'\n')
    {
        // The last line may be incomplete.
        text.truncate(end + 1);
    }
    let (Head { skipped, after, .. }, rest) = head::start(Cursor::new(&text)).map_err(unreadable)?;
    let mut names = Vec::new();
    rest.take(SAMPLE).read_to_end(&mut names).map_err(unreadable)?;
    let names = String::from_utf8_lossy(&names);
    let separator = match Dialect::of(names.lines().next().unwrap_or_default(), None).separator() {
        _ if are_spaced => "blank",
        b';' => "semicolon",
        b'|' => "pipe",
        b'\t' => "tab",
        _ => "comma",
    };
    let read = |uses: Uses<'_>| {
        super::csv::from_text(file, text.as_slice(), split, uses).map_err(|wrong| named(file, wrong))
    };
    let table = with_errors(&read, found);
    let decimal = table.as_ref().and_then(|table| table.understood.decimal).map(|mark| match mark {
        DecimalMark::Point => "point",
        DecimalMark::Comma => "comma",
    });
    let layout = CsvLayout {
        encoding: encoding.unwrap_or("UTF-8"),
        names_in_line: skipped + 1,
        rows_from_line: skipped + after + 2,
        separator,
        decimal,
    };
    Ok((table, Some(layout)))
}

fn of_table(file: &Path, split: &Split, found: &mut Explanation) -> Found {
    (with_errors(&|uses| read_table(file, split, uses), found), None)
}

/// Reads a log with all columns. If that fails, adds the errors to `found`, and reads as many columns as possible.
fn with_errors(read: &dyn Fn(Uses<'_>) -> Result<Table, BadLog>, found: &mut Explanation) -> Option<Table> {
    match read(&every_column) {
        Ok(table) => Some(table),
        Err(BadLog(errors)) => {
            found.errors = errors;
            read(&|_: &str| false).ok()
        }
    }
}

fn fill(found: &mut Explanation, table: &Table, split: &Split) {
    let Understood { time, date, form, unit, is_in_utc, dates, .. } = table.understood.clone();
    let zone = split.zone.as_ref().filter(|_| !is_in_utc);
    let zone =
        zone.and_then(|zone| zone.iana_name()).unwrap_or(if is_in_utc { "UTC" } else { "a fixed offset" });
    let dates = dates.map(|order| match order {
        DateOrder::DayFirst => "day-first",
        DateOrder::MonthFirst => "month-first",
    });
    found.time =
        Some(TimeLayout { column: time, date, form, unit: unit.to_string(), zone: zone.to_owned(), dates });
    let mut values: Vec<Vec<f64>> = Vec::new();
    for (name, cells) in &table.columns {
        let series = match cells {
            Cells::Numbers(series) | Cells::Unread(series) => Some(series),
            Cells::Text(_) => None,
        };
        let numbers = series.into_iter().flatten();
        let stated = table.units.get(name);
        let read_as = stated.and_then(|unit| unit::of_profile(name, unit)).filter(|unit| *unit != "percent");
        let has_numbers = numbers.clone().any(|value| value.is_finite());
        let of_unit = stated.and_then(|unit| unit::of_profile(name, unit));
        let kind = has_numbers.then(|| Kind::guess(name, of_unit, numbers.clone()));
        found.columns.push(ExplainedColumn { name: name.clone(), unit: stated.cloned(), read_as, kind });
        values.push(numbers.take(SHOWN).collect());
    }
    for (row, at) in table.times.iter().enumerate().take(SHOWN) {
        let value = |numbers: &Vec<f64>| numbers.get(row).copied().filter(|value| value.is_finite());
        let values = values.iter().map(value).collect();
        found.rows.push(ExplainedRow { line: table.lines.of(row), time: time_text(*at, unit), values });
    }
}

/// Returns a time as text. If the time is not a date, the text is the time since the start of the log.
fn time_text(at: Moment, unit: TimeUnit) -> String {
    if at < FIRST_DATE && unit != TimeUnit::ExcelDays {
        return format!("{} s", at.since(Moment::default()).as_secs_f64());
    }
    let mut text = Vec::new();
    time::write(&mut text, at);
    String::from_utf8_lossy(&text).replace(".000000000", "")
}

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.file)?;
        if let Some(CsvLayout { encoding, names_in_line, rows_from_line, separator, decimal }) = &self.csv {
            writeln!(f, "encoding  {encoding}")?;
            writeln!(f, "names     line {names_in_line}, separated by {separator}s")?;
            writeln!(f, "rows      from line {rows_from_line}")?;
            writeln!(f, "decimals  {}", decimal.unwrap_or("point"))?;
        }
        if let Some(TimeLayout { column, date, form, unit, zone, dates }) = &self.time {
            let date = date.as_ref().map(|date| format!(" and {date}")).unwrap_or_default();
            let dates = dates.map(|order| format!(", dates {order}")).unwrap_or_default();
            write!(f, "time      {column}{date}: ")?;
            match form {
                TimeForm::Numbers => write!(f, "numbers are {unit}")?,
                TimeForm::Texts => f.write_str("texts with a date or a time of day")?,
                TimeForm::StampsInUtc => f.write_str("time stamps in UTC")?,
                TimeForm::WallStamps => f.write_str("time stamps without a zone")?,
                TimeForm::TimesOfDay => f.write_str("times of day")?,
            }
            if *form != TimeForm::StampsInUtc {
                write!(f, "; dates without a time zone are in the zone {zone}")?;
            }
            writeln!(f, "{dates}")?;
        }
        if !self.columns.is_empty() {
            writeln!(f, "\ncolumns:")?;
        }
        let width = self.columns.iter().map(|column| column.name.chars().count()).max().unwrap_or(0);
        for ExplainedColumn { name, unit, read_as, kind } in &self.columns {
            let kind = kind.map_or_else(|| "no numbers".to_owned(), |kind| kind.to_string());
            let unit = unit.as_ref().map(|unit| format!(", unit {unit}")).unwrap_or_default();
            let read_as = read_as.map(|unit| format!(", read as {unit}")).unwrap_or_default();
            writeln!(f, "  {name:width$}  {kind}{unit}{read_as}")?;
        }
        for ExplainedRow { line, time, values } in &self.rows {
            let values: Vec<String> = values
                .iter()
                .map(|value| value.map_or_else(|| "-".to_owned(), |value| value.to_string()))
                .collect();
            writeln!(f, "\nline {line}: {time}\n  {}", values.join("  "))?;
        }
        if !self.errors.is_empty() {
            writeln!(f, "\nerrors that occur if the columns are used:")?;
        }
        self.errors.iter().try_for_each(|error| writeln!(f, "  {error}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn explained(log: &[u8]) -> Explanation {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("day.csv");
        std::fs::write(&file, log).unwrap();
        let zone = jiff::tz::TimeZone::get("Europe/Berlin").ok();
        explain(&file, &Split { zone, ..Split::default() }).unwrap()
    }

    #[test]
    fn head_time_units_and_first_rows_are_shown() {
        let found = explained(
            b"Logger\nDatum;bed;part\n;\xb0F;\n31.01.2026 06:00:00;68,9;A\n31.01.2026 06:01:00;;A\n",
        );
        let csv = found.csv.clone().unwrap();
        assert_eq!((csv.encoding, csv.names_in_line, csv.rows_from_line), ("windows-1252", 2, 4));
        assert_eq!((csv.separator, csv.decimal), ("semicolon", Some("comma")));
        let time = found.time.clone().unwrap();
        assert_eq!((time.column.as_str(), time.zone.as_str()), ("Datum", "Europe/Berlin"));
        assert_eq!(found.columns[0].name, "bed");
        assert_eq!(
            (found.columns[0].read_as, found.columns[0].kind),
            (Some("degC"), Some(Kind::Temperature))
        );
        assert_eq!(found.columns[1].kind, None);
        assert_eq!(found.rows[0].time, "2026-01-31T05:00:00Z");
        assert!((found.rows[0].values[0].unwrap() - 20.5).abs() < 1e-9 && found.rows[1].values[0].is_none());
        assert_eq!(found.errors, Vec::<String>::new());
        let text = found.to_string();
        for part in [
            "encoding  windows-1252",
            "names     line 2",
            "time      Datum: texts with a date or a time of day; dates without a time zone are in the zone Europe/Berlin",
            "bed",
            "temperature, unit °F, read as degC",
            "line 4:",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn pipes_and_blanks_separate_columns() {
        for (log, separator) in [
            (b"time|bed\n0|20.5\n".as_slice(), "pipe"),
            (b"time | bed \n 0 | 20.5\n".as_slice(), "pipe"),
            (b"  time     bed\n     0    20.5\n".as_slice(), "blank"),
            (b"Agilent 34970A\n\ntime bed\n[s] [\xb0C]\n0 20.5\n".as_slice(), "blank"),
        ] {
            let found = explained(log);
            assert_eq!(found.csv.clone().unwrap().separator, separator, "{found}");
            assert_eq!(found.columns[0].name, "bed", "{found}");
            assert_eq!(found.rows[0].values, [Some(20.5)], "{found}");
            assert!(
                found.to_string().contains("time: numbers are seconds; dates without a time zone"),
                "{found}"
            );
        }
    }

    #[test]
    fn errors_are_part_of_the_explanation() {
        let found = explained(b"time,bed,state\n0,20,1\n60,21,idle\n");
        assert_eq!(found.errors.len(), 1, "{found}");
        assert!(found.errors[0].contains("line 3, column state: `idle` is not a number"), "{found}");
        assert_eq!(found.rows[1].time, "60 s");
        let found = explained(b"when,bed\n0,20\n");
        assert!(found.time.is_none() && found.errors[0].contains("there is no column time"), "{found}");
    }
}
