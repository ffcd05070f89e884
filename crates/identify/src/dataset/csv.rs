//! A log as CSV.

use std::path::Path;

use jiff::tz::TimeZone;

use super::table::{Reader, Table};
use super::{BadLog, files};
use isotherm_core::quantity::Dialect;
use isotherm_profile::regular;

/// Reads a file; the messages name its lines.
pub(super) fn read(file: &Path, zone: Option<TimeZone>) -> Result<Table, BadLog> {
    from_text(file, files::open(file)?, zone)
}

/// The same from anything that is read.
pub(super) fn from_text(
    file: &Path,
    input: impl std::io::Read,
    zone: Option<TimeZone>,
) -> Result<Table, BadLog> {
    let (first, input) = regular::first_line(input).map_err(|why| files::cannot_be_read(file, &why))?;
    let dialect = Dialect::of(&first, zone);
    let header_is_wrong = |why: String| BadLog(vec![format!("{}, line 1: {why}", file.display())]);
    let mut reader =
        csv::ReaderBuilder::new().flexible(true).delimiter(dialect.separator()).from_reader(input);
    let header = reader.headers().map_err(|why| header_is_wrong(message(&why)))?;
    let names: Vec<String> =
        header.iter().map(|name| name.trim().trim_start_matches('\u{feff}').to_owned()).collect();
    check_header(&names).map_err(header_is_wrong)?;
    let width = names.len();
    let no_time = format!(
        "there is no column time (seconds or 2026-01-31T12:00:00Z), time_s or time_min; there are {}",
        names.join(", ")
    );
    let mut rows = Reader::new(file, names, ("line", dialect)).ok_or_else(|| header_is_wrong(no_time))?;
    // One message for all of them: a decimal comma is in every line.
    let mut uneven: Option<(u64, usize, u64)> = None;
    let mut record = csv::StringRecord::new();
    loop {
        match reader.read_record(&mut record) {
            Ok(false) => break,
            Err(why) => rows.refuse(why.position().map_or(0, csv::Position::line), None, message(&why)),
            Ok(true) => {
                // A record says where the one before ended, empty lines or not.
                let inside = record.iter().flat_map(str::bytes).filter(|byte| *byte == b'\n').count();
                let line = reader.position().line().saturating_sub(1 + inside as u64);
                if record.iter().all(|cell| cell.trim().is_empty()) {
                    // Spreadsheets end with thousands of these.
                } else if record.len() == width {
                    rows.add(line, record.iter().map(str::to_owned).collect());
                } else {
                    uneven.get_or_insert((line, record.len(), 0)).2 += 1;
                }
            }
        }
    }
    if let Some((line, cells, lines)) = uneven {
        let hint = match cells > width {
            true => "where these are decimal commas, write points; a comma stands between columns only",
            false => "an empty cell has its comma, too",
        };
        let more = if lines > 1 { format!(", and {} lines more like it", lines - 1) } else { String::new() };
        rows.refuse(line, None, format!("{cells} cells under {width} column names{more}: {hint}"));
    }
    rows.finish((2, "there are no rows under the header"))
}

fn check_header(names: &[String]) -> Result<(), String> {
    if names.iter().all(String::is_empty) {
        return Err("the log is empty; its first line names the columns".to_owned());
    }
    let mut seen = std::collections::HashSet::new();
    match names.iter().find(|name| !name.is_empty() && !seen.insert(name.as_str())) {
        Some(twice) => Err(format!("the column {twice} is there twice; rename one")),
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
