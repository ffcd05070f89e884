//! Conversion of any log to CSV in UTF-8, for the row reader of `isotherm replay`. The first line of the result
//! contains the column names.
//!
//! Therefore `isotherm replay` and `isotherm identify` accept the same logs: the same encodings, and the same
//! additional lines before the column names.

use std::collections::HashMap;
use std::io::{self, BufRead, BufReader, Cursor, Read, Write};
use std::path::Path;

use super::formats::read_table;
use super::table::{Cells, Units, Uses};
use super::tidy::Tidy;
use super::{BadLog, Implausible, Series, Split, decode, files, head, measured, spaced, steps};
use isotherm_core::quantity::{Dialect, TimeColumns, names_and_units, time};

/// Maximum number of bytes before the end of the line with the column names, as in [`head::start`].
const LONGEST_HEAD: u64 = 1 << 16;

/// Log as CSV in UTF-8.
pub struct PlainLog {
    /// Text of the log. The first line contains the names of the columns, with the units from a second header line.
    pub input: Box<dyn Read>,
    /// Whether the log file is CSV. If the log file has another format, the program wrote `input` with decimal points
    /// and times in UTC.
    pub is_csv: bool,
    /// Cells of the first rows below the column names. The order of day and month and the decimal mark are detected
    /// from these cells.
    pub first_rows: Vec<Vec<String>>,
    /// Numbers of lines of the file that are not in `input`: lines before the column names, and lines between the
    /// column names and the first row.
    pub left_out: [u64; 2],
    /// Implausible values (not measured by the sensor) in the columns `split.displacements`. If the file is not CSV,
    /// these values are empty cells in `input`, and the list of lines is empty.
    pub implausible: Implausible,
}

/// Reads any log that [`Dataset::read`](super::Dataset::read) reads. `input` is the opened file. If the file is not
/// CSV, only the used columns are converted, without columns of texts.
///
/// # Errors
/// - The errors of [`Dataset::read`](super::Dataset::read) for this file. Errors in the rows of a CSV log are not
///   detected here.
/// - A column of `split.displacements` has too many implausible values.
pub fn plain_log(
    file: &Path,
    input: impl Read + 'static,
    split: &Split,
    (units, uses): (Units<'_>, Uses<'_>),
) -> Result<PlainLog, BadLog> {
    let ending = file.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    let plain = match ending.to_ascii_lowercase().as_str() {
        #[cfg(feature = "tables")]
        "gz" => plain_csv(super::gzip::open(file)?, split),
        #[cfg(not(feature = "tables"))]
        "gz" => Ok(None),
        "parquet" | "xlsx" | "xlsm" | "xls" | "xlsb" | "ods" => Ok(None),
        _ => plain_csv(input, split),
    };
    match plain.map_err(|why| files::cannot_be_read(file, &why))? {
        Some((log, names)) => {
            steps::check(
                &file.display().to_string(),
                (names.as_slice(), log.first_rows.as_slice()),
                split.time_unit,
            )?;
            let is_measured = |(name, _): &(String, String)| split.displacements.contains(name);
            let implausible = match names_and_units(&names).iter().any(is_measured) {
                true => measured::in_file(file, split, (units, uses))?,
                false => Implausible::default(),
            };
            Ok(PlainLog { implausible, ..log })
        }
        None => csv_of_table(file, split, (units, uses)),
    }
}

/// Reads a CSV log in any encoding of a logger. Leaves out the additional lines before and after the column names. Also
/// returns the column names with their units. `None` if the log is in long format, with one row for each value.
fn plain_csv(input: impl Read + 'static, split: &Split) -> io::Result<Option<(PlainLog, Vec<String>)>> {
    let (decoded, _) = decode::utf8(input)?;
    let (head, rest) = head::start(spaced::columns(decoded)?)?;
    let left_out = [head.skipped, head.after];
    let mut rest = BufReader::new(rest);
    let mut line = Vec::new();
    rest.by_ref().take(LONGEST_HEAD).read_until(b'\n', &mut line)?;
    let header = String::from_utf8_lossy(&line).into_owned();
    let separator = Dialect::of(&header, None).separator();
    let owned =
        |line: &str| head::cells(line, separator).into_iter().map(str::to_owned).collect::<Vec<String>>();
    let names = head.with_time(owned(&header), separator);
    if Tidy::find(&names, split).is_some() {
        return Ok(None);
    }
    let has_index =
        TimeColumns::find(&owned(&header), None).is_none() && names.iter().any(|name| name == "time");
    let first_rows = head.rows.iter().map(|line| owned(line)).collect();
    if head.after > 0 || has_index || head::uncommented(&header) != header {
        let mut unused = Vec::new();
        for _ in 0..head.after {
            unused.clear();
            rest.by_ref().take(LONGEST_HEAD).read_until(b'\n', &mut unused)?;
        }
        line = with_units(&names, &head.units, separator);
    }
    let input = Box::new(Cursor::new(line).chain(rest));
    let implausible = Implausible::default();
    let names = super::csv::with_units(names, &head.units);
    Ok(Some((PlainLog { input, is_csv: true, first_rows, left_out, implausible }, names)))
}

/// Returns a CSV line with the names of the columns and their units.
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

/// Reads the used columns of a log that is not CSV, and returns them as CSV.
fn csv_of_table(
    file: &Path,
    split: &Split,
    (units, uses): (Units<'_>, Uses<'_>),
) -> Result<PlainLog, BadLog> {
    let mut table = read_table(file, split, uses)?;
    let implausible = Implausible { lines: HashMap::new(), ..measured::leave_out(&mut table, split, units)? };
    let columns: Vec<(&String, &Series)> = table
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
            let number = numbers.at(row);
            if number.is_finite() {
                // Writing to a vector never fails.
                let _ = write!(text, "{number}");
            }
        }
        text.push(b'\n');
    }
    Ok(PlainLog {
        input: Box::new(Cursor::new(text)),
        is_csv: false,
        first_rows: Vec::new(),
        left_out: [0; 2],
        implausible,
    })
}

#[cfg(test)]
mod tests {
    use isotherm_core::quantity::TimeUnit;

    use super::*;

    #[track_caller]
    fn plain(log: &[u8], expected: &str, left_out: [u64; 2]) {
        let (mut found, _) = plain_csv(Cursor::new(log.to_vec()), &Split::default()).unwrap().unwrap();
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
        plain(b",bed\n2026-01-05 06:00:00,20\n", "\"time\",\"bed\"\n2026-01-05 06:00:00,20\n", [0, 0]);
        plain(b"Logger\n time    bed\n    0   20.5\n", "time\tbed\n0\t20.5\n", [1, 0]);
        plain(b",bed\n0,20\n", ",bed\n0,20\n", [0, 0]);
        plain(b"", "", [0, 0]);
    }

    #[cfg(feature = "tables")]
    #[test]
    fn a_compressed_log_is_read() {
        use flate2::{Compression, write::GzEncoder};
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("day.csv.gz");
        let mut encoder = GzEncoder::new(std::fs::File::create(&path).unwrap(), Compression::default());
        encoder.write_all(b"Logger\ntime,bed\n0,20\n").unwrap();
        encoder.finish().unwrap();
        let every = super::super::every_column;
        let mut found = plain_log(&path, io::empty(), &Split::default(), (&|_: &str| None, &every)).unwrap();
        let mut text = String::new();
        found.input.read_to_string(&mut text).unwrap();
        assert_eq!((text.as_str(), found.left_out), ("time,bed\n0,20\n", [1, 0]));
    }

    #[test]
    fn the_cells_of_the_first_rows_are_known() {
        let log = b"Date,Time,bed\n31/01/2026,06:00:00,20\n".to_vec();
        let (found, _) = plain_csv(Cursor::new(log), &Split::default()).unwrap().unwrap();
        assert_eq!(found.first_rows, [["31/01/2026", "06:00:00", "20"]]);
        let long = b"time,sensor,value\n0,bed,20\n".to_vec();
        assert!(plain_csv(Cursor::new(long), &Split::default()).unwrap().is_none(), "it is read as a table");
    }

    /// Returns the implausible values of a log of 100 minutes. If `change` returns a text for a row, this
    /// text replaces the error in that row.
    #[track_caller]
    fn found_in(change: impl Fn(u32) -> Option<&'static str>) -> Result<Implausible, BadLog> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("day.csv");
        let row = |row: u32| {
            let error = change(row).map_or_else(|| (10.0 + 0.1 * f64::from(row)).to_string(), str::to_owned);
            format!("{};{error};20,5\n", 60 * row)
        };
        let rows: String = (0..100).map(row).collect();
        std::fs::write(&path, format!("Logger\nZeit;z_error_um;bed\ns;µm;°C\n{}", rows.replace('.', ",")))
            .unwrap();
        let split = Split { displacements: vec!["z_error_um".to_owned()], ..Split::default() };
        let input = std::fs::File::open(&path).unwrap();
        let uses = |name: &str| ["bed", "z_error_um"].contains(&name);
        plain_log(&path, input, &split, (&|_: &str| None, &uses)).map(|log| log.implausible)
    }

    #[test]
    fn times_without_a_unit_that_may_be_milliseconds_are_asked_for() {
        let read = |head: &str, split: &Split| {
            let directory = tempfile::tempdir().unwrap();
            let path = directory.path().join("day.csv");
            std::fs::write(&path, format!("{head}\n0,20\n1000,21\n2000,22\n3000,23\n")).unwrap();
            let input = std::fs::File::open(&path).unwrap();
            let every = super::super::every_column;
            let plain = plain_log(&path, input, split, (&|_: &str| None, &every)).map(drop);
            (plain, read_table(&path, split, &every).map(drop))
        };
        for head in ["time,bed", "Zeit,bed", "timestamp,bed"] {
            let (plain, table) = read(head, &Split::default());
            for said in [plain.unwrap_err().to_string(), table.unwrap_err().to_string()] {
                assert!(
                    said.contains("the rows are 1000 s apart") && said.contains("--time-unit s, ms"),
                    "{said}"
                );
            }
            let stated = Split { time_unit: Some(TimeUnit::Milliseconds), ..Split::default() };
            assert_eq!(read(head, &stated), (Ok(()), Ok(())));
        }
        for head in ["time_s,bed", "Zeit [ms],bed", "time,bed\nms,°C", "time,bed\ns,°C"] {
            assert_eq!(read(head, &Split::default()), (Ok(()), Ok(())), "{head}");
        }
    }

    #[test]
    fn implausible_values_of_a_measured_error_are_found_by_line() {
        for word in ["999.9", "0", "-9999", "9.9E37", "OL", "n/a"] {
            let found = found_in(|row| [40, 41].contains(&row).then_some(word)).unwrap();
            assert_eq!(found.lines["z_error_um"], [44, 45], "{word}");
            let said = found.remarks.join("; ");
            assert!(said.contains("line 44, column z_error_um: `") && said.contains("left out"), "{said}");
        }
        let found = found_in(|_| None).unwrap();
        assert_eq!(found, Implausible::default());
        let said = found_in(|row| (row % 10 == 5).then_some("999.9")).unwrap_err().to_string();
        assert!(said.contains("more than 5 % of the values"), "{said}");
        let said = found_in(|row| (row == 40).then_some("hot")).unwrap().remarks.join("; ");
        assert!(
            said.contains("the measured error was not checked for implausible values")
                && said.contains("`hot` is not a number"),
            "{said}"
        );
    }
}
