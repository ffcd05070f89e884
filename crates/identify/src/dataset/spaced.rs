//! Reader of logs whose columns are separated by blanks, as in tables of fixed width. The blanks between columns are
//! replaced by tabs.

use std::io::{self, BufRead, BufReader, Cursor, Read};

use super::head;
use super::text_reader::{Begun, Convert, TextReader};
use isotherm_core::quantity::TimeColumns;

/// Number of bytes at the start of a log in which the line with the column names must be.
const SAMPLE: u64 = 1 << 16;
/// Maximum length of a line, bytes. A longer line is returned unchanged.
const LONGEST_LINE: u64 = 1 << 20;
/// Number of rows from which the reader detects how the columns are separated.
const COMPARED: usize = 50;

/// Reader of a text whose columns are separated by one character. A text whose columns are separated by blanks is
/// converted.
pub(super) type Columns<R> = TextReader<R, Spaced<R>>;

/// Converter that replaces the blanks between columns by tabs.
pub(super) struct Spaced<R> {
    input: BufReader<Begun<R>>,
    layout: Layout,
    /// Number of lines that were read so far.
    lines: usize,
}

/// Layout of a log whose columns are separated by blanks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    /// Index of the line with the column names.
    names: usize,
    /// Number of columns of the log.
    width: usize,
    /// Index of the column with the time.
    time: usize,
    /// Minimum number of blanks between two columns. If it is 2, a column name may contain a single blank.
    blanks: usize,
}

/// Returns a reader of a UTF-8 text whose columns are separated by one character.
pub(super) fn columns<R: Read>(mut input: R) -> io::Result<Columns<R>> {
    let mut sample = Vec::new();
    input.by_ref().take(SAMPLE).read_to_end(&mut sample)?;
    let layout = {
        let text = String::from_utf8_lossy(&sample);
        let mut lines: Vec<&str> = text.lines().collect();
        if sample.len() as u64 == SAMPLE && lines.len() > 1 {
            // The last line may be incomplete.
            lines.pop();
        }
        Layout::of(&lines)
    };
    let input = Cursor::new(sample).chain(input);
    Ok(match layout {
        None => Columns::Plain(input),
        Some(layout) => Columns::converted(Spaced { input: BufReader::new(input), layout, lines: 0 }),
    })
}

impl Layout {
    /// Finds the layout of a log. `None` if its columns are not separated by blanks, or if no line contains column
    /// names.
    fn of(lines: &[&str]) -> Option<Layout> {
        if head::names_at(lines).is_some() {
            return None;
        }
        // If both layouts fit as many rows, the first one is used.
        let found = [2, 1].into_iter().filter_map(|blanks| Layout::with(lines, blanks));
        found.reduce(|one, other| if other.1 > one.1 { other } else { one }).map(|(layout, _)| layout)
    }

    /// Finds the line with the column names, if at least `blanks` blanks separate two columns. Also returns the number
    /// of rows that fit this layout. `None` if no line contains column names.
    fn with(lines: &[&str], blanks: usize) -> Option<(Layout, usize)> {
        let tabbed: Vec<String> = lines.iter().map(|line| names(line, blanks).join("\t")).collect();
        let tabbed: Vec<&str> = tabbed.iter().map(String::as_str).collect();
        let at = head::names_at(&tabbed)?;
        let columns: Vec<String> = head::cells(tabbed[at], b'\t').into_iter().map(str::to_owned).collect();
        let time = TimeColumns::find(&columns, None)?.time;
        let layout = Layout { names: at, width: columns.len(), time, blanks };
        let fits = |line: &&&str| layout.row(line).len() == layout.width;
        let rows = lines[at + 1..].iter().filter(|line| !line.trim().is_empty()).take(COMPARED);
        let fitting = rows.filter(fits).count();
        (fitting > 0).then_some((layout, fitting))
    }

    /// Returns the cells of a row. If the row has too many cells, a date and the time of day after it are joined to one
    /// cell.
    fn row(&self, line: &str) -> Vec<String> {
        let found = cells(line, self.blanks);
        let more = found.len().saturating_sub(self.width);
        let end = self.time + more + 1;
        let is_time = match found.get(self.time..end) {
            Some([date, clock]) => {
                (is_date(date) && clock.contains(':')) || (date.contains(':') && is_half(clock))
            }
            Some([date, clock, half]) => is_date(date) && clock.contains(':') && is_half(half),
            _ => false,
        };
        if !is_time {
            return found.into_iter().map(str::to_owned).collect();
        }
        let joined = found[self.time..end].join(" ");
        let [before, after] = [&found[..self.time], &found[end..]];
        let whole = before.iter().copied().chain([joined.as_str()]).chain(after.iter().copied());
        whole.map(str::to_owned).collect()
    }

    /// Returns the line with this index, with tabs instead of blanks between the columns.
    fn tabbed(&self, index: usize, line: &str) -> String {
        match index == self.names {
            true => names(line, self.blanks).join("\t"),
            false => self.row(line).join("\t"),
        }
    }
}

/// Returns whether a cell is a date.
fn is_date(cell: &str) -> bool {
    let marks = cell.bytes().filter(|byte| matches!(byte, b'-' | b'/' | b'.')).count();
    marks == 2 && cell.starts_with(|first: char| first.is_ascii_digit())
}

/// Returns whether a cell is AM or PM.
fn is_half(cell: &str) -> bool {
    ["am", "pm", "a.m.", "p.m."].iter().any(|half| cell.eq_ignore_ascii_case(half))
}

/// Returns the names of the columns in a line. A unit in brackets belongs to the name before it.
fn names(line: &str, blanks: usize) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for cell in cells(head::uncommented(line), blanks) {
        match found.last_mut() {
            Some(name) if cell.starts_with(['[', '(']) => {
                name.push(' ');
                name.push_str(cell);
            }
            _ => found.push(cell.to_owned()),
        }
    }
    found
}

/// Returns the cells of a line. At least `blanks` blanks, or a tab, separate two cells. Blanks inside quotes do not
/// separate cells.
fn cells(line: &str, blanks: usize) -> Vec<&str> {
    let bytes = line.as_bytes();
    let (mut found, mut begin, mut is_quoted, mut at) = (Vec::new(), None, false, 0);
    while at < bytes.len() {
        let is_blank = |byte: &&u8| matches!(byte, b' ' | b'\t');
        let gap = if is_quoted { 0 } else { bytes[at..].iter().take_while(is_blank).count() };
        if gap == 0 {
            is_quoted ^= bytes[at] == b'"';
            begin.get_or_insert(at);
            at += 1;
            continue;
        }
        let is_end = gap >= blanks || bytes[at..at + gap].contains(&b'\t');
        if is_end && let Some(first) = begin.take() {
            found.push(&line[first..at]);
        }
        at += gap;
    }
    found.extend(begin.map(|first| line[first..].trim_end()));
    found
}

impl<R: Read> Convert for Spaced<R> {
    fn next_part(&mut self, text: &mut Vec<u8>) -> io::Result<bool> {
        if self.input.by_ref().take(LONGEST_LINE).read_until(b'\n', text)? == 0 {
            return Ok(false);
        }
        let is_whole = text.ends_with(b"\n");
        if is_whole || (text.len() as u64) < LONGEST_LINE {
            if let Ok(line) = std::str::from_utf8(text) {
                let end = if is_whole { "\n" } else { "" };
                *text =
                    (self.layout.tabbed(self.lines, line.trim_end_matches(['\n', '\r'])) + end).into_bytes();
            }
            self.lines += 1;
        }
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn reads(text: &str, expected: &str) {
        let mut found = String::new();
        columns(text.as_bytes()).unwrap().read_to_string(&mut found).unwrap();
        assert_eq!(found, expected);
    }

    #[test]
    fn columns_between_blanks_are_read_as_columns_between_tabs() {
        reads("time bed air\n0 20.5 19\n60 20.6 19\n", "time\tbed\tair\n0\t20.5\t19\n60\t20.6\t19\n");
        reads("  time     bed\n     0    20,5\r\n    60    20,6", "time\tbed\n0\t20,5\n60\t20,6");
        reads("Time   spindle front\n0      20.5\n60     20.6\n", "Time\tspindle front\n0\t20.5\n60\t20.6\n");
        reads("time [s] bed [°C]\n0 20.5\n", "time [s]\tbed [°C]\n0\t20.5\n");
        reads("Scan 1\n\ntime bed\n[s] [°C]\n0 20.5\n", "Scan\t1\n\ntime\tbed\n[s]\t[°C]\n0\t20.5\n");
        reads("# time bed\n0 20.5\n", "time\tbed\n0\t20.5\n");
        reads("\"time\" \"bed front\"\n0 20.5\n", "\"time\"\t\"bed front\"\n0\t20.5\n");
    }

    #[test]
    fn a_date_and_the_time_of_day_are_one_cell_under_one_name() {
        reads("Date Time bed\n2026-03-09 06:00:00 20\n", "Date\tTime\tbed\n2026-03-09\t06:00:00\t20\n");
        reads("Timestamp bed\n2026-03-09 06:00:00 20\n", "Timestamp\tbed\n2026-03-09 06:00:00\t20\n");
        reads("Zeitstempel  bed\n09.03.2026 06:00:00  20\n", "Zeitstempel\tbed\n09.03.2026 06:00:00\t20\n");
        reads("Date Time bed\n3/9/2026 6:00:00 AM 20\n", "Date\tTime\tbed\n3/9/2026\t6:00:00 AM\t20\n");
    }

    #[test]
    fn other_texts_are_not_changed() {
        for text in [
            "time,bed front\n0,20.5\n",
            "Logger 3\nZeit;bed front\n0;20,5\n",
            "when bed\n0 20.5\n",
            "the door was open\n",
            "time bed\n",
            "time bed\nopen shut\n",
            // The row numbers of another program have no name.
            "time bed\n1 0 20.5\n2 60 20.6\n",
            "",
        ] {
            reads(text, text);
        }
        assert!(!columns("time,bed\n0,20\n".as_bytes()).unwrap().is_converted());
        assert!(columns("time bed\n0 20\n".as_bytes()).unwrap().is_converted());
    }

    #[test]
    fn a_long_log_is_read_in_parts_and_its_lines_keep_their_numbers() {
        let rows: String = (0..20_000u32).map(|row| format!("{row}   20.5  19\n")).collect();
        let expected: String = (0..20_000u32).map(|row| format!("{row}\t20.5\t19\n")).collect();
        reads(&format!("time   bed   air\n{rows}"), &format!("time\tbed\tair\n{expected}"));
        let wide = "x".repeat(3 << 20);
        reads(&format!("time bed\n0 20\n{wide}\n1 20"), &format!("time\tbed\n0\t20\n{wide}\n1\t20"));
    }
}
