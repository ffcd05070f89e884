//! A log as Parquet: the same columns as in CSV, times as seconds, as text or as time stamps.

use std::path::Path;

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;

use jiff::tz::TimeZone;

use super::table::{Reader, Table};
use super::{BadLog, files};
use isotherm_core::quantity::Dialect;

/// Reads a file; the messages name its rows, counted from one.
pub(super) fn read(file: &Path, zone: Option<TimeZone>) -> Result<Table, BadLog> {
    let refused = |why: String| BadLog(vec![format!("{}: {why}", file.display())]);
    let reader = SerializedFileReader::new(files::open(file)?)
        .map_err(|why| refused(format!("it is no Parquet file: {why}")))?;
    let schema = reader.metadata().file_metadata().schema_descr();
    let names: Vec<String> = schema.columns().iter().map(|column| column.name().to_owned()).collect();
    let no_time = format!("there is no column time, time_s or time_min; there are {}", names.join(", "));
    let mut table =
        Reader::new(file, names, ("row", Dialect::of("", zone))).ok_or_else(|| refused(no_time))?;
    let rows = reader.get_row_iter(None).map_err(|why| refused(why.to_string()))?;
    for (number, row) in (1..).zip(rows) {
        // What follows a broken page is broken too.
        let row = row.map_err(|why| refused(format!("row {number}: {why}")))?;
        table.add(number, row.get_column_iter().map(|(_, field)| text(field)).collect());
    }
    table.finish((1, "there are no rows"))
}

/// A field as CSV would write it; f64 with every digit.
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

fn stamp_text(nanos: Option<i64>) -> String {
    let stamp = nanos.and_then(|nanos| jiff::Timestamp::from_nanosecond(i128::from(nanos)).ok());
    stamp.map(|stamp| stamp.to_string()).unwrap_or_default()
}
