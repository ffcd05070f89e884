//! A log as CSV.

use std::path::Path;

use super::BadLog;
use super::table::{Table, TimeUnit, Wrong, cells};

/// Reads a file; the messages name its lines.
pub(super) fn read(file: &Path) -> Result<Table, BadLog> {
    let refused = |why: String| BadLog(vec![format!("{}: {why}", file.display())]);
    let input = std::fs::File::open(file).map_err(|why| refused(super::files::cannot_be_read(&why)))?;
    from_text(file, std::io::BufReader::new(input))
}

/// The same from anything that is read.
pub(super) fn from_text(file: &Path, input: impl std::io::Read) -> Result<Table, BadLog> {
    let header_is_wrong = |why: String| BadLog(vec![format!("{}, line 1: {why}", file.display())]);
    let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(input);
    let header = reader.headers().map_err(|why| header_is_wrong(in_words(&why)))?;
    let names: Vec<String> =
        header.iter().map(|name| name.trim().trim_start_matches('\u{feff}').to_owned()).collect();
    let (time, unit) = check_header(&names).map_err(header_is_wrong)?;
    let mut wrong = Wrong::in_file(file.to_owned());
    let mut table = Table { file: file.to_owned(), ..Table::default() };
    let mut texts = vec![Vec::new(); names.len()];
    // One word for all of them: a decimal comma is in every line.
    let mut uneven: Option<(u64, usize, u64)> = None;
    for record in reader.records() {
        let record = match record {
            Ok(record) => record,
            Err(why) => {
                let line = why.position().map_or(0, csv::Position::line);
                wrong.at(&format!("line {line}"), None, in_words(&why));
                continue;
            }
        };
        let line = record.position().map_or(0, csv::Position::line);
        if record.len() != names.len() {
            uneven.get_or_insert((line, record.len(), 0)).2 += 1;
            continue;
        }
        match unit.moment(record.get(time).unwrap_or_default()) {
            Ok(moment) => table.times.push(moment),
            Err(why) => {
                wrong.at(&format!("line {line}"), names.get(time).map(String::as_str), why);
                continue;
            }
        }
        table.lines.push(line);
        for (texts, cell) in texts.iter_mut().zip(&record) {
            texts.push(cell.to_owned());
        }
    }
    if let Some((line, cells, lines)) = uneven {
        let hint = match cells > names.len() {
            true => "where these are decimal commas, write points; a comma stands between columns only",
            false => "an empty cell has its comma, too",
        };
        let more = if lines > 1 { format!(", and {} lines more like it", lines - 1) } else { String::new() };
        let message = format!("{cells} cells under {} column names{more}: {hint}", names.len());
        wrong.at(&format!("line {line}"), None, message);
    }
    if table.times.is_empty() && wrong.is_empty() {
        wrong.at("line 2", None, "there are no rows under the header");
    }
    for (place, (name, texts)) in names.into_iter().zip(texts).enumerate() {
        if place != time && !name.is_empty() {
            let cells = cells(&name, texts, &table.lines, &mut wrong);
            table.columns.push((name, cells));
        }
    }
    wrong.or(table)
}

/// The place of the time, and how it counts.
fn check_header(names: &[String]) -> Result<(usize, TimeUnit), String> {
    if names.iter().all(String::is_empty) {
        return Err("the log is empty; its first line names the columns".to_owned());
    }
    if let [only] = names
        && only.contains([';', '\t'])
    {
        // What tr takes: all decimal commas become points, and then all separators commas.
        let separator = if only.contains(';') { ";" } else { "\\t" };
        return Err(format!(
            "the columns are not separated by commas; write commas, and decimal points: tr ',{separator}' '.,' < LOG > \
             with-commas.csv makes it so"
        ));
    }
    let mut seen = std::collections::HashSet::new();
    if let Some(twice) = names.iter().find(|name| !name.is_empty() && !seen.insert(name.as_str())) {
        return Err(format!("the column {twice} is there twice; rename one"));
    }
    let found = names.iter().enumerate().find_map(|(place, name)| Some((place, TimeUnit::of(name)?)));
    found.ok_or_else(|| {
        format!(
            "there is no column time (seconds or 2026-01-31T12:00:00Z), time_s or time_min; there are {}",
            names.join(", ")
        )
    })
}

fn in_words(why: &csv::Error) -> String {
    match why.kind() {
        csv::ErrorKind::Utf8 { .. } => {
            "this is not UTF-8 text; save it again as UTF-8 (\"CSV UTF-8\" in a spreadsheet)".to_owned()
        }
        _ => why.to_string(),
    }
}
