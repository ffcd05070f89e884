//! Recognises logs by rows of numbers and times with the same separator.

use super::kind::FileKind;

/// Maximum number of lines that are examined.
const COMPARED: usize = 300;
const SEPARATORS: [char; 4] = ['\t', ';', ',', '|'];
/// Names of the first column by which a log without rows is recognised.
const TIMES: [&str; 8] = ["time", "time_s", "time_min", "timestamp", "date", "datetime", "zeit", "datum"];

/// Returns [`FileKind::Log`] if the text has rows of numbers and times.
pub(super) fn of(text: &str) -> Option<FileKind> {
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).take(COMPARED).collect();
    let is_head = |separator: char| {
        let first = lines.first().and_then(|line| line.split(separator).next()).unwrap_or_default();
        let first = first.trim().trim_matches('"');
        lines[0].contains(separator) && TIMES.iter().any(|time| first.eq_ignore_ascii_case(time))
    };
    let has_rows = |separator: char| {
        // The last line may be cut, so one row is enough if the line above has as many cells.
        lines.windows(2).any(|pair| {
            let cells = |line: &str| line.split(separator).count();
            cells(pair[0]) > 1 && cells(pair[0]) == cells(pair[1]) && is_row(pair[1], separator)
        })
    };
    let is_log = !lines.is_empty() && SEPARATORS.into_iter().any(|one| is_head(one) || has_rows(one));
    is_log.then_some(FileKind::Log)
}

/// Returns whether a line is a row of data: at least one cell is a number or a time. At least half of the cells must be
/// numbers, times or empty.
fn is_row(line: &str, separator: char) -> bool {
    let cells: Vec<&str> = line.split(separator).map(|cell| cell.trim().trim_matches('"').trim()).collect();
    let data = cells.iter().filter(|cell| is_data(cell)).count();
    let empty = cells.iter().filter(|cell| cell.is_empty()).count();
    data > 0 && 2 * (data + empty) >= cells.len()
}

/// Returns whether a cell is a number, a date or a time of day.
fn is_data(cell: &str) -> bool {
    let is_number = cell.replace(',', ".").parse::<f64>().is_ok();
    let in_time = |byte: u8| byte.is_ascii_digit() || b"-:/. TZ+,".contains(&byte);
    let is_time = cell.len() >= 4
        && cell.bytes().next().is_some_and(|first| first.is_ascii_digit())
        && cell.bytes().all(in_time);
    is_number || is_time
}
