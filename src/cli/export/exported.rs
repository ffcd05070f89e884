//! Exported files of earlier days: reads their columns, and writes them again with additional columns.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, anyhow, bail};
use jiff::civil::Date;
use parquet::basic::Type as Physical;
use parquet::column::writer::ColumnCloseResult;
use parquet::data_type::{ByteArrayType, DoubleType, Int64Type};
use parquet::file::metadata::{ParquetMetaData, ParquetMetaDataReader, RowGroupMetaData};
use parquet::file::properties::EnabledStatistics;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{ColumnDescriptor, Type};

use super::columns::{Column, FIRST};
use super::table::{HELD, Kind, field, properties};
use isotherm_core::border::beyond;
use isotherm_profile::safe_file;

/// File extension of an exported file.
const ENDING: &str = ".parquet";

/// Returns the exported days of a machine in a directory, with the paths of their files.
pub(super) fn days(directory: &Path, machine: &str) -> std::io::Result<Vec<(String, PathBuf)>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(directory)? {
        let name = entry?.file_name();
        let day = name.to_str().and_then(|name| day(name, machine));
        found.extend(day.map(|day| (day.to_owned(), directory.join(&name))));
    }
    Ok(found)
}

/// Returns the day in the name of an exported file; `None` for any other file.
fn day<'n>(name: &'n str, machine: &str) -> Option<&'n str> {
    let day = name.strip_prefix(machine)?.strip_prefix('-')?.strip_suffix(ENDING)?;
    // The name of another machine may begin like that of this one.
    day.parse::<Date>().ok().filter(|date| date.to_string() == day).map(|_| day)
}

/// Returns the columns of an exported file. Fails if isotherm has not written the file.
pub(super) fn columns(path: &Path) -> anyhow::Result<Vec<Column>> {
    let (_, metadata) = open(path)?;
    let columns = metadata.file_metadata().schema_descr().columns();
    let mut found = Vec::with_capacity(columns.len());
    for (place, column) in columns.iter().enumerate() {
        let name = column.name();
        // A column that no export writes would become one of all days.
        let is_exported = |kind: &Kind| match FIRST.get(place) {
            Some(first) => *first == (name, *kind),
            None => *kind != Kind::Moment,
        };
        let kind = kind(column).filter(is_exported).with_context(|| unknown(path, name))?;
        found.push((name.to_owned(), kind));
    }
    Ok(found)
}

fn unknown(path: &Path, column: &str) -> String {
    format!("{} was not written by isotherm: no export has this column {column}", path.display())
}

fn open(path: &Path) -> anyhow::Result<(File, ParquetMetaData)> {
    let shown = || format!("{} cannot be read", path.display());
    let file = safe_file::open(path).with_context(shown)?;
    // The library may panic if the file is damaged.
    let metadata = beyond(|| ParquetMetaDataReader::new().parse_and_finish(&file));
    let metadata = metadata.map_err(|_| anyhow!("the reader failed")).with_context(shown)?;
    Ok((file, metadata.with_context(shown)?))
}

/// Returns the type of a column of an exported file; `None` if no export writes such a column.
fn kind(column: &ColumnDescriptor) -> Option<Kind> {
    if column.path().parts().len() != 1 || column.max_rep_level() != 0 {
        return None;
    }
    Some(match column.physical_type() {
        Physical::INT64 => Kind::Moment,
        Physical::DOUBLE => Kind::Number,
        Physical::BYTE_ARRAY => Kind::Text,
        _ => return None,
    })
}

/// Writes an exported file again, with all of these columns. A column that the file does not have is empty. The other
/// columns are copied as they are stored.
pub(super) fn widen(path: &Path, columns: &[Column], to: &mut File) -> anyhow::Result<()> {
    let (file, metadata) = open(path)?;
    let stored = metadata.file_metadata().schema_descr().columns();
    let (mut fields, mut sources) = (Vec::new(), Vec::new());
    for (name, wanted) in columns {
        let source = stored.iter().position(|column| column.name() == name);
        if let Some(column) = source.and_then(|source| stored.get(source)) {
            if kind(column) != Some(*wanted) {
                let path = path.display();
                bail!(
                    "{path}: the column {name} has another type than on other days. Move this file to another \
                     directory. If the logs of the day are still there, the next export writes it again"
                );
            }
            fields.push(column.self_type_ptr());
        } else if *wanted == Kind::Moment {
            bail!("{}: there is no column {name}", path.display());
        } else {
            fields.push(Arc::new(field(name, *wanted)?));
        }
        sources.push((source, *wanted));
    }
    let schema = Arc::new(Type::group_type_builder("log").with_fields(fields).build()?);
    // The copied columns have no index of their pages.
    let properties =
        properties().set_offset_index_disabled(true).set_statistics_enabled(EnabledStatistics::Chunk).build();
    let mut writer = SerializedFileWriter::new(to, schema, Arc::new(properties))?;
    for rows in metadata.row_groups() {
        let mut group = writer.next_row_group()?;
        let count = count(rows).with_context(|| path.display().to_string())?;
        for (source, kind) in &sources {
            let Some(column) = source.and_then(|source| rows.columns().get(source)) else {
                empty(&mut group, *kind, count)?;
                continue;
            };
            let copied = ColumnCloseResult {
                bytes_written: u64::try_from(column.compressed_size())?,
                rows_written: u64::try_from(count)?,
                metadata: column.clone(),
                bloom_filter: None,
                column_index: None,
                offset_index: None,
            };
            group.append_column(&file, copied)?;
        }
        group.close()?;
    }
    writer.close()?;
    Ok(())
}

/// Returns the number of rows in a row group (part of a Parquet file). A larger number than an export writes is an
/// error, because a damaged file could otherwise use all memory.
fn count(rows: &RowGroupMetaData) -> anyhow::Result<usize> {
    let count = usize::try_from(rows.num_rows()).ok().filter(|count| *count <= HELD);
    count.with_context(|| format!("the file is damaged: one of its row groups has {} rows", rows.num_rows()))
}

/// Writes a column without values for this number of rows.
fn empty(group: &mut SerializedRowGroupWriter<'_, &mut File>, kind: Kind, rows: usize) -> anyhow::Result<()> {
    let Some(mut column) = group.next_column()? else { bail!("the file has more columns than its schema") };
    let there = vec![0_i16; rows];
    match kind {
        Kind::Moment => column.typed::<Int64Type>().write_batch(&[], Some(&there), None)?,
        Kind::Number => column.typed::<DoubleType>().write_batch(&[], Some(&there), None)?,
        Kind::Text => column.typed::<ByteArrayType>().write_batch(&[], Some(&there), None)?,
    };
    column.close()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::schema::types::SchemaDescriptor;

    use super::super::columns::Columns;
    use super::super::table::Table;
    use super::*;
    use isotherm_core::quantity::time;

    /// Writes a day with two rows: the number 20.5 and the state "active", then neither.
    fn exported(path: &Path) {
        let mut columns = Columns::new();
        columns.add("bed", Kind::Number);
        columns.add("z_state", Kind::Text);
        let mut file = File::create(path).unwrap();
        let mut table = Table::new(&mut file, columns.all()).unwrap();
        for (second, bed, state) in [(0, Some(20.5), Some("active")), (10, None, None)] {
            table.moment(0, time::parse(&format!("2026-01-31T10:00:{second:02}Z")).unwrap());
            table.text(1, Some("mill-7"));
            table.number(2, bed);
            table.text(3, state);
            table.end_row().unwrap();
        }
        table.finish().unwrap();
    }

    fn rows(path: &Path) -> Vec<String> {
        let reader = SerializedFileReader::new(File::open(path).unwrap()).unwrap();
        reader.get_row_iter(None).unwrap().map(|row| row.unwrap().to_string()).collect()
    }

    #[test]
    fn a_widened_day_has_its_values_and_empty_columns() {
        let home = tempfile::tempdir().unwrap();
        let [narrow, wide] = ["narrow", "wide"].map(|name| home.path().join(name));
        exported(&narrow);
        let mut all = Columns::new();
        all.add("new", Kind::Text);
        columns(&narrow).unwrap().iter().for_each(|(name, kind)| all.add_exported(name, *kind));
        all.add("newest", Kind::Number);
        widen(&narrow, all.all(), &mut File::create(&wide).unwrap()).unwrap();
        assert_eq!(columns(&wide).unwrap(), all.all());
        let names: Vec<&str> = all.all().iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["time", "machine", "new", "bed", "z_state", "newest"]);
        let rows = rows(&wide);
        assert_eq!(rows.len(), 2);
        for words in ["machine: \"mill-7\"", "new: null", "bed: 20.5", "z_state: \"active\"", "newest: null"]
        {
            assert!(rows[0].contains(words), "{words} in {rows:?}");
        }
        assert!(rows[1].contains("bed: null") && rows[1].contains("z_state: null"), "{rows:?}");
        // Once more, from the widened file.
        all.add("last", Kind::Number);
        widen(&wide, all.all(), &mut File::create(&narrow).unwrap()).unwrap();
        assert_eq!(columns(&narrow).unwrap(), all.all());
    }

    #[test]
    fn a_file_that_no_export_has_written_is_refused() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("m-2026-01-31.parquet");
        for bytes in [&b""[..], b"PAR1", b"PAR1\0\0\0\0\xff\xff\xff\xffPAR1", b"time,bed\n"] {
            std::fs::write(&path, bytes).unwrap();
            assert!(columns(&path).unwrap_err().to_string().contains("cannot be read"), "{bytes:?}");
        }
        exported(&path);
        let other = [("time".to_owned(), Kind::Moment), ("bed".to_owned(), Kind::Text)];
        let why = widen(&path, &other, &mut File::create(home.path().join("wide")).unwrap()).unwrap_err();
        assert!(why.to_string().contains("the column bed has another type"), "{why}");
    }

    #[test]
    fn a_file_of_another_program_gives_no_columns_to_the_other_days() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("m-2026-01-31.parquet");
        let [time, machine] = [("time", Kind::Moment), ("machine", Kind::Text)];
        for (found, wrong) in [
            (vec![("parts", Kind::Number)], "parts"),
            (vec![("parts", Kind::Moment), machine], "parts"),
            (vec![time, ("machine", Kind::Number)], "machine"),
            (vec![time, machine, ("bed", Kind::Number), ("parts", Kind::Moment)], "parts"),
        ] {
            let found: Vec<Column> = found.into_iter().map(|(name, kind)| (name.to_owned(), kind)).collect();
            Table::new(&mut File::create(&path).unwrap(), &found).unwrap().finish().unwrap();
            let why = columns(&path).unwrap_err().to_string();
            assert!(why.ends_with(&format!("no export has this column {wrong}")), "{why}");
        }
    }

    #[test]
    fn a_damaged_number_of_rows_is_refused() {
        let schema = Arc::new(Type::group_type_builder("log").build().unwrap());
        let schema = Arc::new(SchemaDescriptor::new(schema));
        for (rows, found) in [(0, Some(0)), (2_000_000, Some(2_000_000)), (2_000_001, None), (-1, None)] {
            let group = RowGroupMetaData::builder(schema.clone()).set_num_rows(rows).build().unwrap();
            assert_eq!(count(&group).ok(), found, "{rows}");
        }
    }

    #[test]
    fn the_days_of_a_machine_are_found_by_their_names() {
        for (name, found) in [
            ("mill-7-2026-01-31.parquet", Some("2026-01-31")),
            ("mill-7-2026-01-31.parquet.part", None),
            ("mill-7-2026-1-31.parquet", None),
            ("mill-7-2026-02-30.parquet", None),
            ("mill-70-2026-01-31.parquet", None),
            ("mill-7-x-2026-01-31.parquet", None),
            ("mill-7.parquet", None),
        ] {
            assert_eq!(day(name, "mill-7"), found, "{name}");
        }
        assert_eq!(day("mill-7-2026-01-31.parquet", "mill"), None);
    }
}
