//! A log as Parquet: the same columns as in CSV, times as seconds, as text or as time stamps.

use std::path::Path;

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;

use super::BadLog;
use super::table::{Table, TimeUnit, Wrong, cells};

/// Reads a file; the messages name its rows, counted from one.
pub(super) fn read(file: &Path) -> Result<Table, BadLog> {
    let refused = |why: String| BadLog(vec![format!("{}: {why}", file.display())]);
    let input = std::fs::File::open(file).map_err(|why| refused(super::files::cannot_be_read(&why)))?;
    let reader =
        SerializedFileReader::new(input).map_err(|why| refused(format!("it is no Parquet file: {why}")))?;
    let schema = reader.metadata().file_metadata().schema_descr();
    let names: Vec<String> = schema.columns().iter().map(|column| column.name().to_owned()).collect();
    let time = names.iter().enumerate().find_map(|(place, name)| Some((place, TimeUnit::of(name)?)));
    let Some((time, unit)) = time else {
        return Err(refused(format!(
            "there is no column time, time_s or time_min; there are {}",
            names.join(", ")
        )));
    };
    let rows = reader.get_row_iter(None).map_err(|why| refused(why.to_string()))?;
    let mut wrong = Wrong::in_file(file.to_owned());
    let mut table = Table { file: file.to_owned(), ..Table::default() };
    let mut texts = vec![Vec::new(); names.len()];
    for (place, row) in rows.enumerate() {
        let number = u64::try_from(place).unwrap_or(u64::MAX).saturating_add(1);
        let at = format!("row {number}");
        let row = match row {
            Ok(row) => row,
            // What follows a broken page is broken too.
            Err(why) => return Err(refused(format!("{at}: {why}"))),
        };
        let fields: Vec<String> = row.get_column_iter().map(|(_, field)| text(field)).collect();
        match unit.moment(fields.get(time).map_or("", String::as_str)) {
            Ok(moment) => table.times.push(moment),
            Err(why) => {
                wrong.at(&at, names.get(time).map(String::as_str), why);
                continue;
            }
        }
        table.lines.push(number);
        for (texts, field) in texts.iter_mut().zip(fields) {
            texts.push(field);
        }
    }
    if table.times.is_empty() && wrong.is_empty() {
        wrong.at("row 1", None, "there are no rows");
    }
    for (place, (name, texts)) in names.into_iter().zip(texts).enumerate() {
        if place != time {
            let cells = cells(&name, texts, &table.lines, &mut wrong);
            table.columns.push((name, cells));
        }
    }
    wrong.or(table)
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
