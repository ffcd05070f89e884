//! Logs of the decisions of one day as one table. The table has the columns `time` and `machine`, and the columns of
//! the logs of all days. The column `machine_memory` is left out, because only a replay needs this column.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::Context;
use csv::{ByteRecord, Reader, ReaderBuilder};

use super::columns::{Column, Columns, FIRST};
use super::table::{Kind, Table};
use crate::gateway::log::{is_for_replay, is_text};
use isotherm_core::quantity::{Moment, time};
use isotherm_profile::safe_file;

/// Open log, with the index of each of its columns in the exported table.
struct Log<'p> {
    path: &'p Path,
    reader: Reader<File>,
    places: Vec<Option<usize>>,
}

/// Writes the logs as a Parquet file with these columns. Returns a warning for each log from which rows were left out.
pub(super) fn write(
    machine: &str,
    logs: &[PathBuf],
    columns: &Columns,
    to: &mut File,
) -> anyhow::Result<Vec<String>> {
    let mut opened = Vec::new();
    for path in logs {
        let (reader, found) = open(path)?;
        let place = |column: Option<Column>| {
            let Some((name, kind)) = column else { return Ok(None) };
            let place = columns.place(&name, kind);
            let changed =
                || format!("{} has changed during the export: run the export again", path.display());
            place.map(Some).with_context(changed)
        };
        let places = found.into_iter().map(place).collect::<anyhow::Result<Vec<_>>>()?;
        let places = std::iter::once(Some(0)).chain(places).collect();
        opened.push(Log { path, reader, places });
    }
    let columns = columns.all();
    let mut table = Table::new(to, columns)?;
    let mut warnings = Vec::new();
    for mut log in opened {
        let left_out = log.copy(machine, columns, &mut table)?;
        if left_out > 0 {
            let rows =
                if left_out == 1 { "row is incomplete or damaged" } else { "rows are incomplete or damaged" };
            warnings.push(format!("{}: {left_out} {rows}, and left out", log.path.display()));
        }
    }
    table.finish()?;
    Ok(warnings)
}

/// Returns the columns of a log that are exported, without its time.
pub(super) fn columns(path: &Path) -> anyhow::Result<Vec<Column>> {
    Ok(open(path)?.1.into_iter().flatten().collect())
}

/// Opens a log. Returns its columns after the time; `None` for a column that is not exported, because only a replay
/// needs it.
fn open(path: &Path) -> anyhow::Result<(Reader<File>, Vec<Option<Column>>)> {
    let shown = || format!("{} cannot be read", path.display());
    let file = safe_file::open(path).with_context(shown)?;
    let mut reader = ReaderBuilder::new().flexible(true).from_reader(file);
    let header = reader.headers().with_context(shown)?.clone();
    let names: Vec<&str> = header.iter().collect();
    let column = |name: &&str| {
        let kind = if is_text(name, &names) { Kind::Text } else { Kind::Number };
        (!is_for_replay(name)).then(|| ((*name).to_owned(), kind))
    };
    // A header that is cut off has no rows after it. Its last name is incomplete, and would be a column of all days.
    let is_whole = reader.position().line() > 1;
    let columns = names.iter().skip(1).filter(|_| is_whole).map(column).collect();
    Ok((reader, columns))
}

impl Log<'_> {
    /// Copies the rows of a log to the table. Returns the number of rows that were left out.
    fn copy(
        &mut self,
        machine: &str,
        columns: &[(String, Kind)],
        table: &mut Table<'_>,
    ) -> anyhow::Result<u64> {
        let (mut row, mut left_out) = (ByteRecord::new(), 0);
        let mut from = vec![None; columns.len()];
        for (cell, place) in self.places.iter().enumerate() {
            if let Some(place) = place {
                from[*place] = Some(cell);
            }
        }
        loop {
            match self.reader.read_byte_record(&mut row) {
                Ok(false) => return Ok(left_out),
                Ok(true) => {}
                Err(_) => return Ok(left_out + 1),
            }
            let Some((at, cells)) = self.whole(&row, columns, &from) else {
                left_out += 1;
                continue;
            };
            table.moment(0, at);
            table.text(1, Some(machine));
            for (column, (cell, (_, kind))) in cells.into_iter().zip(columns).enumerate().skip(FIRST.len()) {
                match (kind, cell) {
                    (Kind::Number, Cell::Number(number)) => table.number(column, number),
                    (_, Cell::Text(text)) => table.text(column, text),
                    _ => {}
                }
            }
            table.end_row()?;
        }
    }

    /// Returns the time and the cells of a row, in the order of the table's columns. Returns `None` if the row is
    /// incomplete or a cell cannot be read.
    fn whole<'r>(
        &self,
        row: &'r ByteRecord,
        columns: &[(String, Kind)],
        from: &[Option<usize>],
    ) -> Option<(Moment, Vec<Cell<'r>>)> {
        if row.len() != self.places.len() {
            return None;
        }
        let text = |place: usize| std::str::from_utf8(row.get(place)?).ok();
        let at = time::parse(text(0)?).ok()?;
        let cells = from.iter().zip(columns).map(|(from, (_, kind))| {
            let cell = from.map_or(Some(""), text)?;
            match kind {
                Kind::Number if cell.is_empty() => Some(Cell::Number(None)),
                Kind::Number => cell.parse().ok().map(|number| Cell::Number(Some(number))),
                _ => Some(Cell::Text(Some(cell).filter(|cell| !cell.is_empty()))),
            }
        });
        Some((at, cells.collect::<Option<_>>()?))
    }
}

enum Cell<'r> {
    Number(Option<f64>),
    Text(Option<&'r str>),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_that_is_cut_off_gives_no_columns() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("m-2026-01-31.csv");
        for (text, names) in [
            ("time,bed,z_state,machine_memory\n", &["bed", "z_state"][..]),
            ("time,bed,z_state\n2026-01-31T10:00:00Z,20.5,active\n", &["bed", "z_state"][..]),
            ("time,bed,z_sta", &[][..]),
            ("", &[][..]),
        ] {
            std::fs::write(&path, text).unwrap();
            let found = columns(&path).unwrap();
            let found: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
            assert_eq!(found, names, "{text}");
        }
    }
}
