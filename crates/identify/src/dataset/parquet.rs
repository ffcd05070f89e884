//! Reader of logs in Parquet files. The columns are the same as in a CSV log. Times are seconds, texts or time stamps.
//!
//! ```text
//! metadata: rows × columns, pages ── within the limits? ── column by column into the table
//! ```
//! A file of some kilobytes can claim in its metadata that it contains gigabytes. Therefore all sizes are checked
//! before anything is decompressed. The Parquet library may panic, so panics are caught while the file is read.

use std::fs::File;
use std::path::Path;

use parquet::basic::{LogicalType, TimeUnit, Type};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::metadata::RowGroupMetaData;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use parquet::schema::types::ColumnDescPtr;

use super::csv::{MOST_COLUMNS, check_header};
use super::table::{Reader, Table, TooMuch};
use super::time_form::TimeForm;
use super::{BadLog, Split, Uses, files};
use isotherm_core::border::beyond;
use isotherm_core::quantity::{Dialect, with_date};
use isotherm_profile::safe_file::quoted;

mod pages;
mod thrift;

/// Maximum size of the numbers in memory, as a multiple of the file size.
const PER_BYTE: u64 = 10;
/// Size of the numbers in memory that is always allowed, bytes. The multiple of the file size is added to it.
const AT_LEAST: u64 = 96_000_000;
/// Maximum number of date changes in a file. One change per day would be more than two hundred years.
const MOST_DATES: usize = 100_000;
/// Number of values that are decoded in one step.
const BATCH: usize = 8192;

/// Reads a Parquet log. Error messages contain row numbers, counted from one.
pub(super) fn read(file: &Path, split: &Split, uses: Uses<'_>) -> Result<Table, BadLog> {
    let opened = files::open(file)?;
    let refused = |why: String| BadLog(vec![format!("{}: {why}", file.display())]);
    beyond(|| from_file(file, opened, split, uses)).unwrap_or_else(|_| {
        Err(refused(
            "the file cannot be read as Parquet: the reader failed. Write the file again, or write it as CSV"
                .to_owned(),
        ))
    })
}

fn from_file(path: &Path, file: File, split: &Split, uses: Uses<'_>) -> Result<Table, BadLog> {
    let refused = |why: String| BadLog(vec![format!("{}: {why}", path.display())]);
    let length = file.metadata().map_err(|why| files::cannot_be_read(path, &why))?.len();
    let again = file.try_clone().map_err(|why| files::cannot_be_read(path, &why))?;
    let reader = SerializedFileReader::new(file)
        .map_err(|why| refused(format!("the file is not a Parquet file: {why}")))?;
    let columns = reader.metadata().file_metadata().schema_descr().columns().to_vec();
    if columns.len() > MOST_COLUMNS {
        return Err(refused(format!(
            "{} columns: at most {MOST_COLUMNS} are allowed; leave columns out",
            columns.len()
        )));
    }
    let names: Vec<String> = columns.iter().map(name).collect();
    check_header(&names).map_err(refused)?;
    let there_are = names.join(", ");
    let no_time =
        format!("there is no column time, time_s or time_min; the columns are {}", quoted(&there_are));
    let dialect = Dialect::of("", split.zone.clone()).with(split.decimal, split.dates);
    let choice = (split.column.as_deref(), split.time_unit);
    let table = Reader::new(path, names, ("row", dialect), choice, uses);
    let mut table = table.ok_or_else(|| refused(no_time))?;
    let file = Opened { reader, again, length };
    file.check_size(&table).map_err(refused)?;
    // The time column determines which rows exist.
    let time = table.time_at();
    let others = (0..columns.len()).filter(|place| *place != time);
    for place in [time].into_iter().chain(others) {
        if place != time && !table.reads(place) {
            continue;
        }
        let wrong = |why: String| refused(format!("column {}: {why}", columns[place].name()));
        // The date of a row completes a time of day.
        let date = table.date_at().filter(|_| place == time);
        let dates = date.map(|date| file.dates(&columns[date], date)).transpose();
        let read = dates.and_then(|dates| file.read(&columns[place], (place, dates), &mut table));
        match read {
            Ok(()) => {}
            Err(Stopped::Told) => break,
            Err(Stopped::Wrong(why)) => return Err(wrong(why)),
        }
    }
    table.finish((1, "there are no rows"))
}

/// Returns the name of a column. For a value inside a nested structure, the name is the whole path of the value.
fn name(column: &ColumnDescPtr) -> String {
    if is_plain(column) { column.name().to_owned() } else { column.path().string() }
}

/// Returns whether the column has at most one value in each row.
fn is_plain(column: &ColumnDescPtr) -> bool {
    column.path().parts().len() == 1 && column.max_rep_level() == 0
}

/// Reason why the reader stopped reading a column.
enum Stopped {
    /// Error whose message was already added to the table.
    Told,
    Wrong(String),
}

impl From<ParquetError> for Stopped {
    fn from(why: ParquetError) -> Stopped {
        let why = why.to_string();
        let missing = why.rsplit_once("Disabled feature at compile time: ");
        Stopped::Wrong(match missing {
            Some((_, compression)) => format!(
                "the compression {compression} is not supported: write the file with the compression Snappy, Zstandard or \
                 gzip"
            ),
            None => why,
        })
    }
}

struct Opened {
    reader: SerializedFileReader<File>,
    /// Second handle of the same file, for the check of its pages.
    again: File,
    length: u64,
}

impl Opened {
    fn groups(&self) -> &[RowGroupMetaData] {
        self.reader.metadata().row_groups()
    }

    /// Rejects a file whose numbers would need more memory than the file size allows.
    fn check_size(&self, table: &Reader) -> Result<(), String> {
        let rows = self.groups().iter().try_fold(0u64, |rows, group| {
            u64::try_from(group.num_rows()).ok().and_then(|more| rows.checked_add(more))
        });
        let rows = rows.ok_or("the number of rows is negative: write the file again")?;
        let columns = 1 + table.kept() as u64;
        let (needed, limit) =
            (rows.saturating_mul(8 * columns), AT_LEAST.saturating_add(self.length.saturating_mul(PER_BYTE)));
        if needed > limit {
            let million = |bytes: u64| bytes.div_ceil(1_000_000);
            return Err(format!(
                "{rows} rows of {columns} columns would need {} MB of memory. For a file of {} MB, at most {} \
                 MB are allowed. Write fewer rows or columns, or write the log as CSV",
                million(needed),
                million(self.length),
                million(limit)
            ));
        }
        Ok(())
    }

    /// Reads one column of all row groups into the table. `dates` contains the dates of the rows if this column
    /// contains the times and another column contains the dates.
    fn read(
        &self,
        column: &ColumnDescPtr,
        (place, dates): (usize, Option<Dates>),
        table: &mut Reader,
    ) -> Result<(), Stopped> {
        let is_time = place == table.time_at();
        if !is_plain(column) {
            if is_time {
                return Err(Stopped::Wrong("this column must have one value in each row".to_owned()));
            }
            table.is_text(
                place,
                "the values of this column are nested, but it must have one value in each row",
            );
            return Ok(());
        }
        if is_time && let Some(stamps) = Stamps::of(column) {
            table.declare_times(stamps.form());
        }
        let mut number = 0;
        for (group, metadata) in self.groups().iter().enumerate() {
            if !is_time && !table.reads(place) {
                break;
            }
            // The column of an empty row group may have no page.
            if metadata.num_rows() == 0 {
                continue;
            }
            if self.has_deltas_of_texts(column, (place, metadata))? {
                if is_time || table.needs_words(place) {
                    return Err(Stopped::Wrong(DELTAS.to_owned()));
                }
                table.is_text(
                    place,
                    "the texts of this column are delta-encoded (stored as differences), which is not \
                     supported",
                );
                return Ok(());
            }
            let rows = usize::try_from(metadata.num_rows()).unwrap_or(usize::MAX);
            let rows = if is_time { rows } else { rows.min(table.wants(place)) };
            let group = self.reader.get_row_group(group)?;
            let cells = Cells { column, rows, is_optional: column.max_def_level() > 0 };
            cells.read(group.get_column_reader(place)?, &mut |value| {
                number += 1;
                take(table, (place, number), (value, dates.as_ref()))
            })?;
        }
        Ok(())
    }

    /// Reads the dates of all rows from the date column.
    fn dates(&self, column: &ColumnDescPtr, place: usize) -> Result<Dates, Stopped> {
        let mut dates = Dates::default();
        if !is_plain(column) {
            return Err(Stopped::Wrong("this column must have one date in each row".to_owned()));
        }
        let mut number = 0;
        for (group, metadata) in self.groups().iter().enumerate() {
            if metadata.num_rows() == 0 {
                continue;
            }
            if self.has_deltas_of_texts(column, (place, metadata))? {
                return Err(Stopped::Wrong(DELTAS.to_owned()));
            }
            let rows = usize::try_from(metadata.num_rows()).unwrap_or(usize::MAX);
            let group = self.reader.get_row_group(group)?;
            let cells = Cells { column, rows, is_optional: column.max_def_level() > 0 };
            cells.read(group.get_column_reader(place)?, &mut |value| {
                number += 1;
                dates.push(number, &value);
                match dates.changes.len() > MOST_DATES {
                    true => Err(Stopped::Wrong(format!(
                        "more than {MOST_DATES} changes of the date: does this column really contain dates?"
                    ))),
                    false => Ok(()),
                }
            })?;
        }
        Ok(dates)
    }

    /// Checks the pages of a column in a row group. Returns whether it contains delta-encoded texts.
    fn has_deltas_of_texts(
        &self,
        column: &ColumnDescPtr,
        (place, metadata): (usize, &RowGroupMetaData),
    ) -> Result<bool, Stopped> {
        let chunk = metadata.columns().get(place).ok_or_else(|| {
            Stopped::Wrong("this column is missing in a row group: write the file again".to_owned())
        })?;
        let looked = pages::check_pages(&self.again, self.length, chunk).map_err(Stopped::Wrong)?;
        Ok(looked.has_deltas_of_texts && column.physical_type() == Type::BYTE_ARRAY)
    }
}

/// Error message about delta-encoded texts (each stored as the difference from the previous text) in a column that is
/// needed.
const DELTAS: &str = "the texts of this column are stored as differences, which is not supported: write them plain or with a \
                      dictionary";

/// Dates of the rows of a file. A date is stored only for rows in which it changes.
#[derive(Debug, Default)]
struct Dates {
    changes: Vec<(u64, String)>,
}

impl Dates {
    fn push(&mut self, row: u64, value: &Value<'_>) {
        let text = match value {
            Value::Text(text) => text.split('T').next().unwrap_or_default(),
            Value::Number(_) => "",
        };
        if self.changes.last().is_none_or(|(_, last)| last != text) {
            self.changes.push((row, text.to_owned()));
        }
    }

    fn of(&self, row: u64) -> Option<&str> {
        let behind = self.changes.partition_point(|(first, _)| *first <= row);
        self.changes.get(behind.checked_sub(1)?).map(|(_, date)| date.as_str())
    }
}

/// Adds a value to the table. If the value is a time of day, `dates` gives its date.
fn take(
    table: &mut Reader,
    (place, row): (usize, u64),
    (value, dates): (Value<'_>, Option<&Dates>),
) -> Result<(), Stopped> {
    if place == table.time_at() {
        let date = dates.and_then(|dates| dates.of(row));
        let begun = match value {
            Value::Number(number) if number.is_nan() => table.begin(row, ""),
            Value::Number(number) => table.begin(row, &number.to_string()),
            Value::Text(text) => table.begin(row, &with_date(text, date)),
        };
        return begun.map(drop).map_err(|TooMuch| Stopped::Told);
    }
    if !table.reads(place) {
        return Ok(());
    }
    match value {
        Value::Number(number) if !table.needs_words(place) => table.number(place, number),
        Value::Number(number) if number.is_nan() => table.text(place, row, ""),
        Value::Number(number) => table.text(place, row, &number.to_string()),
        Value::Text(text) => table.text(place, row, text),
    }
    Ok(())
}

/// Value in one row of a Parquet column.
enum Value<'v> {
    /// Number; NaN if missing.
    Number(f64),
    Text(&'v str),
}

/// Reader of the cells of one column in one row group.
struct Cells<'c> {
    column: &'c ColumnDescPtr,
    rows: usize,
    is_optional: bool,
}

type Each<'t, V> = &'t mut dyn FnMut(Option<&V>) -> Result<(), Stopped>;
type Take<'t> = &'t mut dyn FnMut(Value<'_>) -> Result<(), Stopped>;

impl Cells<'_> {
    fn read(&self, reader: ColumnReader, take: Take<'_>) -> Result<(), Stopped> {
        let column = self.column;
        match reader {
            ColumnReader::DoubleColumnReader(reader) => self.each(reader, &mut |value| match value {
                None => take(Value::Number(f64::NAN)),
                Some(value) => take(Value::Number(*value)),
            }),
            ColumnReader::FloatColumnReader(reader) => {
                self.fields(reader, take, |value| Ok(Field::convert_float(column, *value)))
            }
            ColumnReader::Int32ColumnReader(reader) => match Stamps::of(column) {
                Some(stamps) => self.each(reader, &mut |value| match value {
                    None => take(Value::Number(f64::NAN)),
                    Some(value) => take(Value::Text(&stamps.text(i64::from(*value)))),
                }),
                None => self.fields(reader, take, |value| Ok(Field::convert_int32(column, *value))),
            },
            ColumnReader::Int64ColumnReader(reader) => match Stamps::of(column) {
                Some(stamps) => self.each(reader, &mut |value| match value {
                    None => take(Value::Number(f64::NAN)),
                    Some(value) => take(Value::Text(&stamps.text(*value))),
                }),
                None => self.fields(reader, take, |value| Ok(Field::convert_int64(column, *value))),
            },
            ColumnReader::Int96ColumnReader(reader) => {
                self.fields(reader, take, |value| Ok(Field::convert_int96(column, *value)))
            }
            ColumnReader::BoolColumnReader(reader) => {
                self.fields(reader, take, |value| Ok(Field::convert_bool(column, *value)))
            }
            ColumnReader::ByteArrayColumnReader(reader) => {
                self.fields(reader, take, |value| Field::convert_byte_array(column, value.clone()))
            }
            ColumnReader::FixedLenByteArrayColumnReader(reader) => {
                self.fields(reader, take, |value| Field::convert_byte_array(column, value.clone().into()))
            }
        }
    }

    /// Reads values as the texts that a CSV file would contain.
    fn fields<T: DataType>(
        &self,
        reader: ColumnReaderImpl<T>,
        take: Take<'_>,
        field: impl Fn(&T::T) -> Result<Field, ParquetError>,
    ) -> Result<(), Stopped> {
        self.each(reader, &mut |value| match value {
            None => take(Value::Number(f64::NAN)),
            Some(value) => take(Value::Text(&text(&field(value)?))),
        })
    }

    fn each<T: DataType>(
        &self,
        mut reader: ColumnReaderImpl<T>,
        take: Each<'_, T::T>,
    ) -> Result<(), Stopped> {
        let (mut levels, mut values) = (Vec::new(), Vec::new());
        let mut left = self.rows;
        while left > 0 {
            levels.clear();
            values.clear();
            let there = self.is_optional.then_some(&mut levels);
            let (records, ..) = reader.read_records(left.min(BATCH), there, None, &mut values)?;
            if records == 0 {
                return Err(Stopped::Wrong(format!(
                    "this column has {left} rows fewer than the file states: write the file again"
                )));
            }
            left -= records;
            let mut values = values.iter();
            if self.is_optional {
                let of =
                    |level: &i16| (*level == self.column.max_def_level()).then(|| values.next()).flatten();
                levels.iter().map(of).try_for_each(&mut *take)?;
            } else {
                values.map(Some).try_for_each(&mut *take)?;
            }
        }
        Ok(())
    }
}

/// Returns the text that this field would have in a CSV file. Numbers have all their digits.
fn text(field: &Field) -> String {
    match field {
        Field::Null => String::new(),
        Field::Str(text) => text.clone(),
        Field::Float(value) => value.to_string(),
        Field::Double(value) => value.to_string(),
        Field::TimestampMillis(stamp) => stamp_text(stamp.checked_mul(1_000_000)),
        Field::TimestampMicros(stamp) => stamp_text(stamp.checked_mul(1000)),
        other => other.to_string(),
    }
}

/// Time stamps of a column whose type states their time unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stamps {
    /// Number of nanoseconds in one unit of the time stamps.
    unit: i64,
    kind: StampKind,
}

/// Meaning of the time stamps of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StampKind {
    /// Dates and times in UTC.
    Utc,
    /// Wall-clock dates and times without a time zone.
    Wall,
    /// Times of day without a date.
    OfDay,
}

impl Stamps {
    fn of(column: &ColumnDescPtr) -> Option<Stamps> {
        let (stamp, kind) = match column.logical_type_ref()? {
            LogicalType::Timestamp(stamp) if stamp.is_adjusted_to_u_t_c => (stamp, StampKind::Utc),
            LogicalType::Timestamp(stamp) => (stamp, StampKind::Wall),
            LogicalType::Time(stamp) => (stamp, StampKind::OfDay),
            _ => return None,
        };
        let unit = match stamp.unit {
            TimeUnit::MILLIS => 1_000_000,
            TimeUnit::MICROS => 1000,
            TimeUnit::NANOS => 1,
        };
        Some(Stamps { unit, kind })
    }

    /// Returns the format of the time stamps.
    fn form(self) -> TimeForm {
        match self.kind {
            StampKind::Utc => TimeForm::StampsInUtc,
            StampKind::Wall => TimeForm::WallStamps,
            StampKind::OfDay => TimeForm::TimesOfDay,
        }
    }

    /// Returns a time stamp as the text that a CSV file would contain; empty if the stamp is not a valid time.
    fn text(self, stamp: i64) -> String {
        let nanos = stamp.checked_mul(self.unit);
        match self.kind {
            StampKind::Utc => stamp_text(nanos),
            StampKind::Wall => stamp_text(nanos).trim_end_matches('Z').to_owned(),
            StampKind::OfDay => nanos.filter(|nanos| *nanos >= 0).map(of_day_text).unwrap_or_default(),
        }
    }
}

fn of_day_text(nanos: i64) -> String {
    let (seconds, nanos) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
    format!("{:02}:{:02}:{:02}.{nanos:09}", seconds / 3600, seconds / 60 % 60, seconds % 60)
}

fn stamp_text(nanos: Option<i64>) -> String {
    let stamp = nanos.and_then(|nanos| jiff::Timestamp::from_nanosecond(i128::from(nanos)).ok());
    stamp.map(|stamp| stamp.to_string()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_stamps_are_texts_with_their_zone() {
        let text = |unit, kind, stamp| Stamps { unit, kind }.text(stamp);
        assert_eq!(text(1, StampKind::Utc, 1_773_036_000_000_000_000), "2026-03-09T06:00:00Z");
        assert_eq!(text(1000, StampKind::Wall, 1_773_036_000_500_000), "2026-03-09T06:00:00.5");
        assert_eq!(text(1_000_000, StampKind::Utc, i64::MAX), "");
        assert_eq!(text(1, StampKind::OfDay, 21_610_500_000_000), "06:00:10.500000000");
        assert_eq!(text(1, StampKind::OfDay, -1), "");
    }

    #[test]
    fn a_date_holds_until_the_next_one() {
        let mut dates = Dates::default();
        for (row, text) in [(1, "2026-03-09"), (2, "2026-03-09"), (3, "2026-03-10T00:00:00")] {
            dates.push(row, &Value::Text(text));
        }
        assert_eq!(dates.changes.len(), 2);
        let found: Vec<Option<&str>> = [0, 1, 2, 3, 9].map(|row| dates.of(row)).to_vec();
        let day = Some("2026-03-09");
        assert_eq!(found, [None, day, day, Some("2026-03-10"), Some("2026-03-10")]);
    }
}
