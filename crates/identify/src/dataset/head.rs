//! Head of a CSV log: the lines before the column names, which a logger writes, and the lines with units after the
//! column names.

use std::io::{self, Chain, Cursor, Read};

use isotherm_core::quantity::{Dialect, TimeColumns, is_unit};

/// Number of bytes at the start of a log in which the line with the column names must be.
const SAMPLE: u64 = 1 << 16;
/// Maximum number of lines before the column names.
const MOST_SKIPPED: usize = 200;
/// Maximum number of lines with units and similar words after the column names.
const MOST_AFTER: usize = 2;

/// Head of a log: the lines before its first row of values.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Head {
    /// Number of lines before the line with the column names.
    pub(super) skipped: u64,
    /// Number of lines between the column names and the first row.
    pub(super) after: u64,
    /// Unit of each column in the lines after the column names; empty if a column has no unit there.
    pub(super) units: Vec<String>,
    /// First lines with values after the head.
    pub(super) rows: Vec<String>,
}

impl Head {
    /// Returns the names of the columns. If no column has the name of a time column, the first column can become the
    /// time column. This requires that its name is empty, and that its cells are dates with times. The library pandas
    /// writes an index without a name in this way.
    pub(super) fn with_time(&self, mut names: Vec<String>, separator: u8) -> Vec<String> {
        let is_index = || {
            let row = self.rows.iter().find(|line| !line.trim().is_empty());
            row.is_some_and(|line| cells(line, separator).first().is_some_and(|cell| is_clock(cell)))
        };
        if TimeColumns::find(&names, None).is_none()
            && let Some(first) = names.first_mut().filter(|name| name.is_empty())
            && is_index()
        {
            "time".clone_into(first);
        }
        names
    }
}

/// Reader of the rest of a log, from the line with the column names on.
type FromNames<R> = Chain<Cursor<Vec<u8>>, R>;

/// Finds the head of a log. Also returns a reader that begins at the line with the column names.
pub(super) fn start<R: Read>(mut input: R) -> io::Result<(Head, FromNames<R>)> {
    let mut sample = Vec::new();
    input.by_ref().take(SAMPLE).read_to_end(&mut sample)?;
    let text = String::from_utf8_lossy(&sample);
    let mut lines: Vec<&str> = text.lines().collect();
    if sample.len() as u64 == SAMPLE && lines.len() > 1 {
        // The last line may be incomplete.
        lines.pop();
    }
    let head = find(&lines);
    drop(text);
    let skipped = usize::try_from(head.skipped).unwrap_or(0);
    let begin: usize = match skipped {
        0 => 0,
        skipped => sample.split_inclusive(|byte| *byte == b'\n').take(skipped).map(<[u8]>::len).sum(),
    };
    sample.drain(..begin);
    Ok((head, Cursor::new(sample).chain(input)))
}

/// Finds the head in the first lines of a log. If no line contains the name of a time column, the log has no lines
/// before the column names.
fn find(lines: &[&str]) -> Head {
    let skipped = names_at(lines).unwrap_or(0);
    let Some(header) = lines.get(skipped) else { return Head::default() };
    let separator = Dialect::of(header, None).separator();
    let width = cells(header, separator).len();
    let (mut after, mut units) = (0, vec![String::new(); width]);
    for (place, line) in (1..).zip(lines.iter().skip(skipped + 1).take(MOST_AFTER + 1)) {
        if line.trim().is_empty() {
            continue;
        }
        let found = cells(line, separator);
        if found.len() != width
            || !found.iter().any(|cell| !cell.is_empty())
            || found.iter().any(|cell| is_value(cell))
        {
            break;
        }
        let stated: Vec<&str> =
            found.iter().map(|cell| cell.trim_matches(['[', ']', '(', ')', ' '])).collect();
        // The first line after the names must show that it belongs to the head.
        if after == 0 && !stated.iter().any(|unit| is_unit(unit)) {
            break;
        }
        for (unit, stated) in units.iter_mut().zip(stated) {
            if unit.is_empty() && is_unit(stated) {
                stated.clone_into(unit);
            }
        }
        after = place;
    }
    let rows = lines.iter().skip(skipped + 1 + after).map(|line| (*line).to_owned()).collect();
    Head { skipped: skipped as u64, after: after as u64, units, rows }
}

/// Returns the index of the line with the column names; `None` if none of the first 200 lines, or of the
/// first 64 KiB, contains them.
#[cfg(feature = "tables")]
pub(super) fn line_of_names(text: &[u8]) -> Option<usize> {
    let sample = &text[..text.len().min(1 << 16)];
    names_at(&String::from_utf8_lossy(sample).lines().collect::<Vec<&str>>())
}

/// Returns whether a text has a line with the names of columns, and another line below it.
pub(super) fn has_rows(text: &[u8]) -> bool {
    let text = String::from_utf8_lossy(text);
    let lines: Vec<&str> = text.lines().collect();
    names_at(&lines).is_some_and(|names| lines[names + 1..].iter().any(|line| !line.trim().is_empty()))
}

/// Returns the index of the line with the names of the columns.
pub(super) fn names_at(lines: &[&str]) -> Option<usize> {
    let below = |place: usize| lines.get(place + 1..).unwrap_or_default();
    let mut places = 0..lines.len().min(MOST_SKIPPED);
    let named = places.clone().find(|place| are_names(lines[*place], below(*place)));
    named.or_else(|| places.find(|place| are_names_after_index(lines[*place], below(*place))))
}

/// Returns whether a line contains column names of which the first is empty, and the next line begins with a date and
/// time. The first column is then an index of times.
fn are_names_after_index(line: &str, next: &[&str]) -> bool {
    let separator = Dialect::of(line, None).separator();
    let found = cells(line, separator);
    let Some(("", names)) = found.split_first().map(|(first, names)| (*first, names)) else { return false };
    let Some(row) = next.iter().find(|line| !line.trim().is_empty()) else { return false };
    let row = cells(row, separator);
    !names.is_empty()
        && names.iter().all(|name| !name.is_empty() && !is_value(name))
        && row.len() == found.len()
        && is_clock(row[0])
}

/// Returns whether a cell is a date and time, or a time of a day.
fn is_clock(cell: &str) -> bool {
    cell.contains(':') && is_value(cell)
}

/// Returns whether a line contains the names of the columns. One of the cells must be the name of a time column, and no
/// cell may be a value. One of the next lines must have as many cells, with a time under that name.
fn are_names(line: &str, next: &[&str]) -> bool {
    let separator = Dialect::of(line, None).separator();
    let found: Vec<String> = cells(line, separator).into_iter().map(str::to_owned).collect();
    if found.len() < 2 || found.iter().any(|cell| is_value(cell) && !is_channel(cell)) {
        return false;
    }
    let Some(time) = TimeColumns::find(&found, None) else { return false };
    let is_row = |line: &&str| {
        let row = cells(line, separator);
        row.len().abs_diff(found.len()) <= 1 && row.get(time.time).is_some_and(|cell| is_value(cell))
    };
    // Loggers write empty lines between the names and the rows.
    let mut filled = next.iter().filter(|line| !line.trim().is_empty()).take(1 + MOST_AFTER).peekable();
    filled.peek().is_none() || filled.any(is_row)
}

/// Returns whether a cell is a number, a date or a time.
fn is_value(cell: &str) -> bool {
    // `T1` and `E1` are names.
    let begins =
        cell.trim_start_matches(['+', '-', '.', ' ']).starts_with(|first: char| first.is_ascii_digit());
    let is_number = || cell.bytes().all(|byte| byte.is_ascii_digit() || b" .,:/-+eETZ".contains(&byte));
    // `1/5/2026 6:00:10 AM` has other letters.
    begins && (cell.contains(':') || is_number())
}

/// Returns whether a cell may be the number of a channel that is used as a column name, as in `101`.
fn is_channel(cell: &str) -> bool {
    cell.len() <= 4 && cell.bytes().all(|byte| byte.is_ascii_digit())
}

/// Returns the cells of a line without their quotes. Quoted separators are not expected in a head.
pub(super) fn cells(line: &str, separator: u8) -> Vec<&str> {
    uncommented(line).split(char::from(separator)).map(|cell| cell.trim().trim_matches('"').trim()).collect()
}

/// Returns a line or a name without the comment sign before it: `# time,bed` becomes `time,bed`.
pub(super) fn uncommented(text: &str) -> &str {
    text.trim_start_matches(['\u{feff}', '#', ' '])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(text: &str) -> (u64, u64, String) {
        let lines: Vec<&str> = text.lines().collect();
        let found = find(&lines);
        (found.skipped, found.after, found.units.join("|"))
    }

    #[test]
    fn the_names_are_found_below_the_lines_of_a_logger() {
        for (text, expected) in [
            ("time,bed\n0,20\n", (0, 0, "|")),
            ("Logger 34970A\nSerial: 1234\n\ntime,bed\n0,20\n", (3, 0, "|")),
            ("Start;05.01.2026\nOperator;Meier\nZeit;bed;air\ns;°C;°C\n0;20;20\n", (2, 1, "s|°C|°C")),
            ("Date,05.01.2026\nTime,06:00:00\nTime,bed\n00:00:00,20\n", (2, 0, "|")),
            (
                "\"TOA5\",\"x\",\"y\"\n\"TIMESTAMP\",\"RECORD\",\"bed\"\n\"TS\",\"RN\",\"Deg C\"\n\"\",\"\",\"Avg\"\n\"2026-01-05 06:00:00\",0,20\n",
                (1, 2, "||Deg C"),
            ),
            ("time\tbed\n[s]\t[°C]\n0\t20\n", (0, 1, "s|°C")),
            ("when,bed\n0,20\n", (0, 0, "|")),
            ("Hall 3\n,bed,air\n2026-01-05 06:00:00,20,20\n", (1, 0, "||")),
            (",Temperatures,\nZeit,bed,air\n06:00:00,20,20\n", (1, 0, "||")),
            ("Datum;Montag\nBediener;Meier\nZeit;bed;air\ns;°C;°C\n0;20;20\n", (2, 1, "s|°C|°C")),
            ("time,bed\n\ns,°C\n0,20\n", (0, 2, "s|°C")),
            ("Logger\ntime,bed\n", (1, 0, "|")),
            ("Scan\n\nTime,101,102\n0,20,21\n", (2, 0, "||")),
            ("# logger\n# time,bed\n0,20\n", (1, 0, "|")),
            ("time,part\n1/5/2026 6:00:10 AM,A\n", (0, 0, "|")),
            ("sep=;\nZeit;bed\n0;20,5\n", (1, 0, "|")),
            ("time,T1,E1\n0,20,1\n", (0, 0, "||")),
            ("", (0, 0, "")),
        ] {
            let (skipped, after, units) = head(text);
            assert_eq!((skipped, after, units.as_str()), expected, "{text}");
        }
    }

    #[test]
    fn the_reader_begins_at_the_names_and_no_byte_is_lost() {
        let text = "Logger\nSerial: 1234\ntime,bed\n0,20\n60,21";
        let (head, mut rest) = start(text.as_bytes()).unwrap();
        let mut read = String::new();
        rest.read_to_string(&mut read).unwrap();
        assert_eq!((head.skipped, read.as_str()), (2, "time,bed\n0,20\n60,21"));
        assert_eq!(head.rows, ["0,20", "60,21"]);
        let long = format!("time,bed\n{}", "0,20\n".repeat(50_000));
        let (_, mut rest) = start(long.as_bytes()).unwrap();
        let mut read = String::new();
        rest.read_to_string(&mut read).unwrap();
        assert_eq!(read, long);
    }
}
