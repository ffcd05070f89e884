//! Reader of logs in CSV files.

use std::path::Path;

use super::active_cz::is_of_machine;
use super::head;
use super::table::{Reader, Table, TooMuch};
use super::tidy::Tidy;
use super::{BadLog, Split, Uses, decode, files, spaced};
use isotherm_core::quantity::{Dialect, is_comment, with_date};
use isotherm_profile::safe_file::{self, quoted};

/// Maximum number of columns. A file with more columns is not a log of a machine.
pub(super) const MOST_COLUMNS: usize = 10_000;

/// Reads a CSV log file. Error messages contain line numbers.
pub(super) fn read(file: &Path, split: &Split, uses: Uses<'_>) -> Result<Table, BadLog> {
    from_text(file, files::open(file)?, split, uses)
}

/// Reads a CSV log from `input`, for example from decompressed data. `file` is only used in error messages, which also
/// contain line numbers.
pub(super) fn from_text(
    file: &Path,
    input: impl std::io::Read,
    split: &Split,
    uses: Uses<'_>,
) -> Result<Table, BadLog> {
    let unreadable = |why: std::io::Error| files::cannot_be_read(file, &why);
    let (decoded, encoding) = decode::utf8(input).map_err(unreadable)?;
    let (head, input) = head::start(spaced::columns(decoded).map_err(unreadable)?).map_err(unreadable)?;
    let (first, input) = safe_file::first_line(input).map_err(unreadable)?;
    let dialect = Dialect::of(&first, split.zone.clone()).with(split.decimal, split.dates);
    let (skipped, after) = (head.skipped, head.after);
    let separator = dialect.separator();
    let header_is_wrong = |why: String| {
        let hint = encoding
            .map(|encoding| format!(" (read as {encoding}: if letters are wrong, save the log as UTF-8)"))
            .unwrap_or_default();
        BadLog(vec![format!("{}, line {}: {why}{hint}", file.display(), skipped + 1)])
    };
    let mut reader = csv::ReaderBuilder::new().flexible(true).delimiter(separator).from_reader(input);
    let header = reader.headers().map_err(|why| header_is_wrong(message(&why)))?;
    let mut names: Vec<String> = header.iter().map(|name| name.trim().to_owned()).collect();
    if let Some(first) = names.first_mut() {
        *first = head::uncommented(first).to_owned();
    }
    check_header(&names).map_err(header_is_wrong)?;
    reader.get_mut().row_is_over();
    let width = names.len();
    let unnamed = names.iter().rev().take_while(|name| name.is_empty() || is_comment(name)).count();
    let names = with_units(head.with_time(names, separator), &head.units);
    if let Some(tidy) = Tidy::find(&names, split) {
        return tidy.read((file, names.as_slice(), &head), &mut reader, dialect, (split, uses));
    }
    let no_time = format!(
        "there is no column time (seconds or 2026-01-31T12:00:00Z), time_s or time_min; the columns are {}",
        quoted(&names.join(", "))
    );
    let by = split.column.as_deref();
    let is_of_gateway = names.iter().any(|name| is_of_machine(name));
    let rows = Reader::new(file, names, ("line", dialect), (by, split.time_unit), uses);
    let mut rows = rows.ok_or_else(|| header_is_wrong(no_time))?;
    let (time, date) = (rows.time_at(), rows.date_at());
    rows.learn(head.rows.iter().map(|line| head::cells(line, separator)));
    let read: Vec<usize> = (0..width).filter(|place| rows.reads(*place)).collect();
    // One message covers all such lines, because a decimal comma occurs in every line.
    let mut uneven: Option<(u64, usize, u64)> = None;
    let mut ends_uneven = false;
    let mut record = csv::StringRecord::new();
    loop {
        match reader.read_record(&mut record) {
            Ok(false) => break,
            Err(why) => {
                let line =
                    why.position().map_or_else(|| reader.position().line(), csv::Position::line) + skipped;
                rows.refuse(line, None, message(&why));
                if why.is_io_error() {
                    break;
                }
            }
            Ok(true) => {
                let own_line = own_line(&reader, &record);
                let line = own_line + skipped;
                ends_uneven = false;
                if record.iter().all(|cell| cell.trim().is_empty()) || own_line <= 1 + after {
                    // Spreadsheets end with thousands of empty lines. Lines with units follow the names.
                } else if fits(&record, width, unnamed) {
                    let cell = |place: usize| record.get(place).unwrap_or_default();
                    match rows.begin(line, &with_date(cell(time), date.map(cell))) {
                        Ok(true) => read.iter().for_each(|place| {
                            if rows.reads(*place) {
                                rows.text(*place, line, cell(*place));
                            }
                        }),
                        Ok(false) => {}
                        Err(TooMuch) => break,
                    }
                } else {
                    uneven.get_or_insert((line, record.len(), 0)).2 += 1;
                    ends_uneven = record.len() < width;
                }
            }
        }
        reader.get_mut().row_is_over();
    }
    // A power cut may cut off the last row of a log of the gateway.
    let is_cut_off = is_of_gateway && ends_uneven && uneven.is_some_and(|(_, _, lines)| lines == 1);
    if let Some((line, cells, lines)) = uneven.filter(|_| !is_cut_off) {
        let more = if lines > 1 { format!(" (also in {} more lines)", lines - 1) } else { String::new() };
        rows.refuse(line, None, uneven_row((cells, width), separator, &more));
    }
    rows.finish((2 + skipped + after, "there are no rows under the header"))
}

/// Returns the number of the line in which a record begins, directly after the reader has read that record.
pub(super) fn own_line<R: std::io::Read>(reader: &csv::Reader<R>, record: &csv::StringRecord) -> u64 {
    // `record.position()` is the end of the record before, and therefore wrong after empty lines.
    let inside = record.as_slice().bytes().filter(|byte| *byte == b'\n').count();
    reader.position().line().saturating_sub(1 + inside as u64)
}

/// Returns the message about a row with more or fewer cells than column names. `more` is a text about further rows of
/// this kind, or empty.
pub(super) fn uneven_row((cells, width): (usize, usize), separator: u8, more: &str) -> String {
    let hint = match cells > width {
        true if separator == b',' => {
            "if the numbers contain decimal commas, write decimal points; a comma may only separate columns"
        }
        true => "each column needs a name",
        false => "write the separator also before and after an empty cell",
    };
    format!("this row has {cells} cells{more}, but there are {width} column names: {hint}")
}

/// Returns whether a row has a suitable number of cells. The last `unnamed` columns have no name, or are comments;
/// their cells may be missing. Cells beyond the last column must be empty.
pub(super) fn fits(record: &csv::StringRecord, width: usize, unnamed: usize) -> bool {
    let cells = record.len();
    cells == width
        || (cells < width && cells + unnamed >= width)
        || (cells > width && record.iter().skip(width).all(|cell| cell.trim().is_empty()))
}

/// Adds the units from a second header line to the names of the columns, for example `bed [°C]`.
pub(super) fn with_units(names: Vec<String>, units: &[String]) -> Vec<String> {
    let mut names = names;
    for (name, unit) in names.iter_mut().zip(units) {
        if !name.is_empty() && !unit.is_empty() {
            *name = format!("{name} [{unit}]");
        }
    }
    names
}

/// Checks that a log has column names, but not too many, and that each name occurs only once.
pub(super) fn check_header(names: &[String]) -> Result<(), String> {
    if names.iter().all(String::is_empty) {
        return Err("the log is empty: its first line must contain the names of the columns".to_owned());
    }
    if names.len() > MOST_COLUMNS {
        return Err(format!(
            "{} columns: at most {MOST_COLUMNS} are allowed; leave columns out",
            names.len()
        ));
    }
    let mut seen = std::collections::HashSet::new();
    match names.iter().find(|name| !name.is_empty() && !seen.insert(name.as_str())) {
        Some(twice) => Err(format!("the column {} occurs twice; rename one", quoted(twice))),
        None => Ok(()),
    }
}

pub(super) fn message(why: &csv::Error) -> String {
    match why.kind() {
        csv::ErrorKind::Utf8 { .. } => {
            "the file is not UTF-8 text: save it again as UTF-8 (\"CSV UTF-8\" in a spreadsheet)".to_owned()
        }
        _ => why.to_string(),
    }
}
