//! Logs as CSV in UTF-8 that begins with the column names, for the reader of rows in `isotherm replay`. A log is thereby
//! read in the same encodings, and below the same lines of a logger, as by `isotherm identify`.

use std::io::{self, BufRead, BufReader, Cursor, Read, Write};
use std::path::Path;

use jiff::tz::TimeZone;

use super::table::Cells;
use super::{BadLog, Split, Uses, decode, head, read_table};
use isotherm_core::quantity::{Dialect, time};

/// Number of bytes in which the names of the columns are searched, as in [`head::start`].
const LONGEST_HEAD: u64 = 1 << 16;

/// Log as CSV in UTF-8.
pub struct PlainLog {
    /// Text of the log. Its first line has the names of the columns, with the units of a second line.
    pub input: Box<dyn Read>,
    /// Cells of the first rows.
    pub first_rows: Vec<Vec<String>>,
    /// Number of lines of the file before the names, and between the names and the first row, which are not in `input`.
    pub left_out: [u64; 2],
}

/// Reads CSV in any encoding of a logger, without the lines around the column names.
///
/// # Errors
/// Those of the input.
pub fn plain_csv(input: impl Read + 'static) -> io::Result<PlainLog> {
    let (decoded, _) = decode::utf8(input)?;
    let (head, rest) = head::start(decoded)?;
    let left_out = [head.skipped, head.after];
    let mut rest = BufReader::new(rest);
    let mut line = Vec::new();
    rest.by_ref().take(LONGEST_HEAD).read_until(b'\n', &mut line)?;
    let header = String::from_utf8_lossy(&line).into_owned();
    let separator = Dialect::of(&header, None).separator();
    let owned =
        |line: &str| head::cells(line, separator).into_iter().map(str::to_owned).collect::<Vec<String>>();
    let first_rows = head.rows.iter().map(|line| owned(line)).collect();
    if head.after > 0 || head::uncommented(&header) != header {
        let mut unused = Vec::new();
        for _ in 0..head.after {
            unused.clear();
            rest.by_ref().take(LONGEST_HEAD).read_until(b'\n', &mut unused)?;
        }
        line = with_units(&owned(&header), &head.units, separator);
    }
    Ok(PlainLog { input: Box::new(Cursor::new(line).chain(rest)), first_rows, left_out })
}

/// Returns the line with the names of the columns and their units.
fn with_units(names: &[String], units: &[String], separator: u8) -> Vec<u8> {
    let cell = |(place, name): (usize, &String)| {
        let unit = units.get(place).filter(|unit| !unit.is_empty() && !name.is_empty());
        let unit = unit.map(|unit| format!(" [{unit}]")).unwrap_or_default();
        format!("\"{}{unit}\"", name.replace('"', "\"\""))
    };
    let cells: Vec<String> = names.iter().enumerate().map(cell).collect();
    let mut line = cells.join(char::from(separator).to_string().as_str()).into_bytes();
    line.push(b'\n');
    line
}

/// Reads the columns of a Parquet log that are used, as CSV. Texts are left out.
///
/// # Errors
/// Those of [`Dataset::read`](super::Dataset::read) for this file.
pub fn csv_of_parquet(file: &Path, zone: Option<TimeZone>, uses: Uses<'_>) -> Result<PlainLog, BadLog> {
    let split = Split { zone, ..Split::default() };
    let table = read_table(file, &split, uses)?;
    let columns: Vec<(&String, &Vec<f64>)> = table
        .columns
        .iter()
        .filter_map(|(name, cells)| match cells {
            Cells::Numbers(numbers) => Some((name, numbers)),
            Cells::Text(_) | Cells::Unread(_) => None,
        })
        .collect();
    let mut text = b"time".to_vec();
    for (name, _) in &columns {
        text.extend(format!(",\"{}\"", name.replace('"', "\"\"")).into_bytes());
    }
    text.push(b'\n');
    for (row, at) in table.times.iter().enumerate() {
        time::write(&mut text, *at);
        for (_, numbers) in &columns {
            text.push(b',');
            if numbers[row].is_finite() {
                // Writing to a vector never fails.
                let _ = write!(text, "{}", numbers[row]);
            }
        }
        text.push(b'\n');
    }
    Ok(PlainLog { input: Box::new(Cursor::new(text)), first_rows: Vec::new(), left_out: [0; 2] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn plain(log: &[u8], expected: &str, left_out: [u64; 2]) {
        let mut found = plain_csv(Cursor::new(log.to_vec())).unwrap();
        let mut text = String::new();
        found.input.read_to_string(&mut text).unwrap();
        assert_eq!((text.as_str(), found.left_out), (expected, left_out));
    }

    #[test]
    fn a_log_begins_with_its_names_and_is_in_utf_8() {
        plain(b"time,bed\n0,20\n", "time,bed\n0,20\n", [0, 0]);
        plain(b"Logger\n\nZeit;\xd6l\n0;20\n", "Zeit;\u{d6}l\n0;20\n", [2, 0]);
        plain(b"Logger\nZeit;bed\nmin;\xb0C\n0;20,5\n", "\"Zeit [min]\";\"bed [\u{b0}C]\"\n0;20,5\n", [1, 1]);
        let wide: Vec<u8> = "time,bed\n0,20\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
        plain(&wide, "time,bed\n0,20\n", [0, 0]);
        plain(b"# logger\n# time,bed\n0,20\n", "\"time\",\"bed\"\n0,20\n", [1, 0]);
        plain(b"", "", [0, 0]);
    }

    #[test]
    fn the_cells_of_the_first_rows_are_known() {
        let log = b"Date,Time,bed\n31/01/2026,06:00:00,20\n".to_vec();
        assert_eq!(plain_csv(Cursor::new(log)).unwrap().first_rows, [["31/01/2026", "06:00:00", "20"]]);
    }
}
