//! Logs in CSV files.

use std::path::Path;

use super::table::{Reader, Table, TooMuch};
use super::{BadLog, Split, Uses, files};
use isotherm_core::quantity::Dialect;
use isotherm_profile::safe_file::{self, quoted};

/// Maximum number of columns. A file with more is not a log of a machine.
pub(super) const MOST_COLUMNS: usize = 10_000;

/// Reads a CSV log. Error messages contain line numbers.
pub(super) fn read(file: &Path, split: &Split, uses: Uses<'_>) -> Result<Table, BadLog> {
    from_text(file, files::open(file)?, split, uses)
}

/// Reads CSV from any input.
pub(super) fn from_text(
    file: &Path,
    input: impl std::io::Read,
    split: &Split,
    uses: Uses<'_>,
) -> Result<Table, BadLog> {
    let (first, input) = safe_file::first_line(input).map_err(|why| files::cannot_be_read(file, &why))?;
    let dialect = Dialect::of(&first, split.zone.clone());
    let header_is_wrong = |why: String| BadLog(vec![format!("{}, line 1: {why}", file.display())]);
    let mut reader =
        csv::ReaderBuilder::new().flexible(true).delimiter(dialect.separator()).from_reader(input);
    let header = reader.headers().map_err(|why| header_is_wrong(message(&why)))?;
    let names: Vec<String> =
        header.iter().map(|name| name.trim().trim_start_matches('\u{feff}').to_owned()).collect();
    check_header(&names).map_err(header_is_wrong)?;
    reader.get_mut().row_is_over();
    let width = names.len();
    let no_time = format!(
        "there is no column time (seconds or 2026-01-31T12:00:00Z), time_s or time_min; there are {}",
        quoted(&names.join(", "))
    );
    let by = split.column.as_deref();
    let rows = Reader::new(file, names, ("line", dialect), by, uses);
    let mut rows = rows.ok_or_else(|| header_is_wrong(no_time))?;
    let read: Vec<usize> = (0..width).filter(|place| rows.reads(*place)).collect();
    // One message covers all such lines, because a decimal comma occurs in every line.
    let mut uneven: Option<(u64, usize, u64)> = None;
    let mut record = csv::StringRecord::new();
    loop {
        match reader.read_record(&mut record) {
            Ok(false) => break,
            Err(why) => {
                let line = why.position().map_or_else(|| reader.position().line(), csv::Position::line);
                rows.refuse(line, None, message(&why));
                if why.is_io_error() {
                    break;
                }
            }
            Ok(true) => {
                // `record.position()` is the end of the record before, and therefore wrong after empty lines.
                let inside = record.as_slice().bytes().filter(|byte| *byte == b'\n').count();
                let line = reader.position().line().saturating_sub(1 + inside as u64);
                if record.iter().all(|cell| cell.trim().is_empty()) {
                    // Spreadsheets end with thousands of empty lines.
                } else if record.len() == width {
                    match rows.begin(line, &record[rows.time_at()]) {
                        Ok(true) => read.iter().for_each(|place| {
                            if rows.reads(*place) {
                                rows.text(*place, line, &record[*place]);
                            }
                        }),
                        Ok(false) => {}
                        Err(TooMuch) => break,
                    }
                } else {
                    uneven.get_or_insert((line, record.len(), 0)).2 += 1;
                }
            }
        }
        reader.get_mut().row_is_over();
    }
    if let Some((line, cells, lines)) = uneven {
        let hint = match cells > width {
            true => "if these are decimal commas, write points; a comma only separates columns",
            false => "an empty cell also needs its comma",
        };
        let more = if lines > 1 { format!(", also in {} more lines", lines - 1) } else { String::new() };
        rows.refuse(line, None, format!("{cells} cells under {width} column names{more}: {hint}"));
    }
    rows.finish((2, "there are no rows under the header"))
}

fn check_header(names: &[String]) -> Result<(), String> {
    if names.iter().all(String::is_empty) {
        return Err("the log is empty; its first line names the columns".to_owned());
    }
    if names.len() > MOST_COLUMNS {
        return Err(format!("{} columns: at most {MOST_COLUMNS} are read; leave columns out", names.len()));
    }
    let mut seen = std::collections::HashSet::new();
    match names.iter().find(|name| !name.is_empty() && !seen.insert(name.as_str())) {
        Some(twice) => Err(format!("the column {} occurs twice; rename one", quoted(twice))),
        None => Ok(()),
    }
}

fn message(why: &csv::Error) -> String {
    match why.kind() {
        csv::ErrorKind::Utf8 { .. } => {
            "this is not UTF-8 text; save it again as UTF-8 (\"CSV UTF-8\" in a spreadsheet)".to_owned()
        }
        _ => why.to_string(),
    }
}
