//! Reader of logs in spreadsheet workbooks (.xlsx). The sheet with a time column is converted to CSV, and
//! then read like a CSV log.
//!
//! ```text
//! zip: sizes of the parts ── within the limits? ── cells of each sheet ── CSV with tabs ── the sheet with a time column
//! ```
//! A file of some kilobytes can decompress to gigabytes. A workbook is a zip file with several parts. Every part is
//! decompressed once to check its size, before the library reads the workbook. The library may panic, so panics are
//! caught while the file is read.

use std::io::Cursor;
use std::path::Path;

use calamine::{DataRef, ExcelDateTime, Reader, SheetType, Xlsx};

use super::table::Table;
use super::{BadLog, Split, Uses, csv, files, head};
use isotherm_core::border::beyond;
use isotherm_core::quantity::DecimalMark;
use isotherm_profile::safe_file;

mod zip;

/// Maximum size of a workbook, bytes.
const LARGEST: u64 = 64 << 20;
/// Maximum size of a sheet after its conversion to CSV, bytes.
const LARGEST_SHEET: usize = 160_000_000;
/// Maximum number of rows and of columns of a sheet.
const MOST_ROWS: u32 = 1 << 20;
const MOST_COLUMNS: u32 = 1 << 14;

/// Reads the sheet of a workbook that has a time column. In error messages, a line number is the row number in the
/// sheet.
pub(super) fn read(file: &Path, split: &Split, uses: Uses<'_>) -> Result<Table, BadLog> {
    let refused = |why: String| BadLog(vec![format!("{}: {why}", file.display())]);
    let bytes = safe_file::read(file, LARGEST).map_err(|why| files::cannot_be_read(file, &why))?;
    zip::check(&bytes).map_err(refused)?;
    let failed = "the workbook cannot be read: the reader failed. Save the sheet as CSV";
    // The decimal mark that the operator has stated is that of numbers that are texts in the sheet.
    let stated = split.decimal;
    let text =
        beyond(|| log_of(bytes, stated)).unwrap_or_else(|_| Err(failed.to_owned())).map_err(refused)?;
    let split = Split { decimal: stated.or(Some(DecimalMark::Point)), ..split.clone() };
    csv::from_text(file, text.as_slice(), &split, uses)
}

/// Returns the sheet that has a time column, as CSV. Returns an error if no sheet or more than one sheet has a time
/// column. `stated` is the decimal mark that the operator stated.
fn log_of(bytes: Vec<u8>, stated: Option<DecimalMark>) -> Result<Vec<u8>, String> {
    let mut book =
        Xlsx::new(Cursor::new(bytes)).map_err(|why| format!("the file is not a workbook: {why}"))?;
    // Sheets with a chart or with macros have no cells.
    let has_cells = |sheet: &&calamine::Sheet| sheet.typ == SheetType::WorkSheet;
    let names: Vec<String> =
        book.sheets_metadata().iter().filter(has_cells).map(|sheet| sheet.name.clone()).collect();
    let mut found: Vec<(&str, Vec<u8>)> = Vec::new();
    for name in &names {
        let (text, unclear) = sheet(&mut book, name, stated).map_err(|why| format!("sheet {name}: {why}"))?;
        let Some(line) = head::line_of_names(&text) else { continue };
        if let Some((row, number)) = unclear.filter(|(row, _)| *row as usize > line) {
            return Err(format!(
                "sheet {name}, line {}: the comma in `{number}` can be a decimal mark or a thousands \
                 separator. State the decimal mark with --decimal comma or --decimal point",
                row + 1
            ));
        }
        found.push((name.as_str(), text));
    }
    match found.as_slice() {
        [] => Err(format!(
            "no sheet has a time column with rows below it (seconds, or dates and times); there are {}",
            names.join(", ")
        )),
        [_] => Ok(found.remove(0).1),
        _ => {
            let names: Vec<&str> = found.iter().map(|(name, _)| *name).collect();
            Err(format!(
                "several sheets have a time column: {}. Save each of these sheets as CSV",
                names.join(", ")
            ))
        }
    }
}

/// Row number and text of a number whose comma may be a decimal mark or separate thousands.
type Unclear = (u32, String);

/// Returns the cells of a sheet as CSV with tabs, one line for each row of the sheet. If the operator stated no decimal
/// mark, also returns the last number whose comma may be a decimal mark or separate thousands.
fn sheet(
    book: &mut Xlsx<Cursor<Vec<u8>>>,
    name: &str,
    stated: Option<DecimalMark>,
) -> Result<(Vec<u8>, Option<Unclear>), String> {
    let mark = stated.unwrap_or(DecimalMark::Point);
    let mut unclear = None;
    let mut cells = book.worksheet_cells_reader(name).map_err(|why| why.to_string())?;
    let mut lines = Lines::default();
    while let Some(cell) = cells.next_cell().map_err(|why| why.to_string())? {
        lines.go_to(cell.get_position())?;
        let text = text(cell.get_value(), mark);
        let is_text = matches!(cell.get_value(), DataRef::String(_) | DataRef::SharedString(_));
        if is_text && stated.is_none() && has_two_readings(&text) {
            unclear = Some((cell.get_position().0, text.trim_matches('"').to_owned()));
        }
        lines.text.extend_from_slice(text.as_bytes());
    }
    lines.end();
    Ok((lines.text, unclear))
}

/// CSV text of a sheet while it is written.
#[derive(Debug, Default)]
struct Lines {
    text: Vec<u8>,
    row: u32,
    column: u32,
    /// Whether the current row has a cell already.
    has_cells: bool,
    /// Largest column index in all rows so far, counted from zero. Each row is filled up to this column, because its
    /// last cells may be missing.
    widest: u32,
}

impl Lines {
    /// Moves to the position of the next cell: writes the line ends and tabs before it. Rows and columns are counted
    /// from zero.
    fn go_to(&mut self, (row, column): (u32, u32)) -> Result<(), String> {
        if row >= MOST_ROWS || column >= MOST_COLUMNS {
            return Err(format!("more than {MOST_ROWS} rows or {MOST_COLUMNS} columns"));
        }
        if row < self.row || (row == self.row && column < self.column) {
            return Err("the cells of this sheet are not in order: save the sheet as CSV".to_owned());
        }
        if row > self.row {
            self.end();
            self.text.extend(std::iter::repeat_n(b'\n', (row - self.row - 1) as usize));
            (self.row, self.column, self.has_cells) = (row, 0, false);
        }
        self.tabs(column);
        self.has_cells = true;
        if self.text.len() > LARGEST_SHEET {
            return Err(format!("it is larger than {} MB as CSV: split it", LARGEST_SHEET / 1_000_000));
        }
        Ok(())
    }

    fn tabs(&mut self, column: u32) {
        self.text.extend(std::iter::repeat_n(b'\t', column.saturating_sub(self.column) as usize));
        self.column = self.column.max(column);
        self.widest = self.widest.max(column);
    }

    fn end(&mut self) {
        if self.has_cells {
            self.tabs(self.widest);
        }
        self.text.push(b'\n');
    }
}

/// Returns the value of a cell as CSV text with the decimal mark `mark`.
fn text(value: &DataRef<'_>, mark: DecimalMark) -> String {
    match value {
        DataRef::Empty => String::new(),
        DataRef::Int(value) => value.to_string(),
        DataRef::Float(value) if mark == DecimalMark::Comma => value.to_string().replace('.', ","),
        DataRef::Float(value) => value.to_string(),
        DataRef::Bool(value) => value.to_string(),
        DataRef::String(text) => quoted(text),
        DataRef::SharedString(text) => quoted(text),
        DataRef::DateTime(date) => date_text(date),
        DataRef::DateTimeIso(text) | DataRef::DurationIso(text) => quoted(text),
        DataRef::Error(error) => error.to_string(),
    }
}

/// Returns whether a text is a number with a comma that may be a decimal mark or separate thousands, as in `1,020` or
/// `21,250 °C`.
fn has_two_readings(text: &str) -> bool {
    let number = text.trim_start_matches(['"', '+', '-', ' ']);
    let end = number.find(|sign: char| !sign.is_ascii_digit() && !matches!(sign, ',' | '.'));
    let is_digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    let parts = number[..end.unwrap_or(number.len())].split_once(',');
    parts.is_some_and(|(whole, rest)| {
        (1..=3).contains(&whole.len())
            && !whole.starts_with('0')
            && is_digits(whole)
            && rest.len() == 3
            && is_digits(rest)
    })
}

fn quoted(text: &str) -> String {
    let line = text.replace(['\n', '\r', '\t'], " ");
    match line.contains(['"', ',', ';']) {
        true => format!("\"{}\"", line.replace('"', "\"\"")),
        false => line,
    }
}

/// Returns a spreadsheet date as text: a date and time, a time of day, or a duration.
fn date_text(date: &ExcelDateTime) -> String {
    let days = date.as_f64();
    if (0.0..10_000.0).contains(&days) && (date.is_duration() || days < 1.0) {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the range was checked")]
        let millis = (days * 86_400_000.0).round() as u64;
        let (seconds, millis) = (millis / 1000, millis % 1000);
        return format!("{:02}:{:02}:{:02}.{millis:03}", seconds / 3600, seconds / 60 % 60, seconds % 60);
    }
    let (year, month, day, hour, minute, second, milli) = date.to_ymd_hms_milli();
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02}.{milli:03}")
}

#[cfg(test)]
mod tests {
    use calamine::ExcelDateTimeType;

    use super::super::every_column;
    use super::*;

    const PARTS: [(&str, &str); 4] = [
        (
            "[Content_Types].xml",
            "<?xml version=\"1.0\"?><Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\"><Default Extension=\"rels\" ContentType=\"application/vnd.openxmlformats-package.relationships+xml\"/><Default Extension=\"xml\" ContentType=\"application/xml\"/><Override PartName=\"/xl/workbook.xml\" ContentType=\"application/vnd.openxmlformats-officedocument.spreadsheetml.sheet.main+xml\"/></Types>",
        ),
        (
            "_rels/.rels",
            "<?xml version=\"1.0\"?><Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\"><Relationship Id=\"rId1\" Type=\"http://schemas.openxmlformats.org/officeDocument/2006/relationships/officeDocument\" Target=\"xl/workbook.xml\"/></Relationships>",
        ),
        (
            "xl/workbook.xml",
            "<?xml version=\"1.0\"?><workbook xmlns=\"http://schemas.openxmlformats.org/spreadsheetml/2006/main\" xmlns:r=\"http://schemas.openxmlformats.org/officeDocument/2006/relationships\"><sheets><sheet name=\"Log\" sheetId=\"1\" r:id=\"rId1\"/></sheets></workbook>",
        ),
        (
            "xl/_rels/workbook.xml.rels",
            "<?xml version=\"1.0\"?><Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\"><Relationship Id=\"rId1\" Type=\"http://schemas.openxmlformats.org/officeDocument/2006/relationships/worksheet\" Target=\"worksheets/sheet1.xml\"/></Relationships>",
        ),
    ];

    /// Writes a workbook with these rows of inline texts and numbers.
    fn workbook(rows: &str) -> (tempfile::TempDir, std::path::PathBuf) {
        let sheet = format!(
            "<?xml version=\"1.0\"?><worksheet xmlns=\"http://schemas.openxmlformats.org/spreadsheetml/2006/main\"><sheetData>{rows}</sheetData></worksheet>"
        );
        let parts = PARTS.into_iter().chain([("xl/worksheets/sheet1.xml", sheet.as_str())]);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("day.xlsx");
        std::fs::write(&path, zip::tests::stored(parts)).unwrap();
        (directory, path)
    }

    fn row(number: u32, cells: &[&str]) -> String {
        let cell = |(place, text): (usize, &&str)| {
            let column = char::from(b'A' + u8::try_from(place).unwrap());
            match text.parse::<f64>() {
                Ok(_) => format!("<c r=\"{column}{number}\"><v>{text}</v></c>"),
                Err(_) if text.is_empty() => String::new(),
                Err(_) => format!("<c r=\"{column}{number}\" t=\"inlineStr\"><is><t>{text}</t></is></c>"),
            }
        };
        format!("<row r=\"{number}\">{}</row>", cells.iter().enumerate().map(cell).collect::<String>())
    }

    #[test]
    fn the_sheet_of_a_workbook_is_read_as_csv_would_be() {
        let rows = [
            row(1, &["Logger, hall 3"]),
            row(3, &["Datum", "bed", "z_error_um"]),
            row(4, &["", "°C", ""]),
            row(5, &["46090.25", "20.5", "1.125"]),
            row(6, &["46090.5", "21"]),
        ];
        let (_directory, path) = workbook(&rows.concat());
        let split = Split { zone: Some(jiff::tz::TimeZone::UTC), ..Split::default() };
        let found = read(&path, &split, &every_column).unwrap();
        assert_eq!(found.numbers("bed"), Some(&vec![20.5, 21.0].into()));
        assert!(found.numbers("z_error_um").is_some_and(|values| values.at(1).is_nan()));
        assert_eq!(found.times[1].since(found.times[0]), std::time::Duration::from_secs(6 * 3600));
        assert_eq!(found.lines.of(0), 5);
    }

    #[test]
    fn the_stated_decimal_mark_is_that_of_texts() {
        let rows = [
            row(1, &["time", "bed", "air"]),
            row(2, &["0.5", "20.125", "21,250"]),
            row(3, &["60.5", "20", "22,5"]),
        ];
        let (_directory, path) = workbook(&rows.concat());
        let comma = Split { decimal: Some(DecimalMark::Comma), ..Split::default() };
        let found = read(&path, &comma, &every_column).unwrap();
        assert_eq!(found.numbers("bed"), Some(&vec![20.125, 20.0].into()));
        assert_eq!(found.numbers("air"), Some(&vec![21.25, 22.5].into()));
        assert_eq!(found.times[0].as_nanos(), 500_000_000);
        let said = read(&path, &Split::default(), &every_column).unwrap_err().to_string();
        assert!(said.contains("line 2") && said.contains("21,250") && said.contains("--decimal"), "{said}");
        let mark =
            [("1,020", true), ("-21,250 °C", true), ("21,25", false), ("0,250", false), ("1,020.5", false)];
        for (text, expected) in mark {
            assert_eq!(has_two_readings(text), expected, "{text}");
        }
    }

    #[test]
    fn a_sheet_with_a_chart_is_no_log() {
        let sheet = format!(
            "<?xml version=\"1.0\"?><worksheet xmlns=\"http://schemas.openxmlformats.org/spreadsheetml/2006/main\"><sheetData>{}{}</sheetData></worksheet>",
            row(1, &["time", "bed"]),
            row(2, &["0", "20.5"])
        );
        let book =
            PARTS[2].1.replace("</sheets>", "<sheet name=\"Chart\" sheetId=\"2\" r:id=\"rId2\"/></sheets>");
        let relations = PARTS[3].1.replace(
            "</Relationships>",
            "<Relationship Id=\"rId2\" Type=\"http://schemas.openxmlformats.org/officeDocument/2006/relationships/chartsheet\" Target=\"chartsheets/sheet1.xml\"/></Relationships>",
        );
        let chart = "<?xml version=\"1.0\"?><chartsheet xmlns=\"http://schemas.openxmlformats.org/spreadsheetml/2006/main\"/>";
        let parts = [
            PARTS[0],
            PARTS[1],
            (PARTS[2].0, book.as_str()),
            (PARTS[3].0, relations.as_str()),
            ("xl/worksheets/sheet1.xml", sheet.as_str()),
            ("xl/chartsheets/sheet1.xml", chart),
        ];
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("day.xlsx");
        std::fs::write(&path, zip::tests::stored(parts.into_iter())).unwrap();
        let found = read(&path, &Split::default(), &every_column).unwrap();
        assert_eq!(found.numbers("bed"), Some(&vec![20.5].into()));
    }

    #[test]
    fn dates_and_times_are_texts_as_in_csv() {
        let text = |days: f64, kind| date_text(&ExcelDateTime::new(days, kind, false));
        assert_eq!(text(46090.25, ExcelDateTimeType::DateTime), "2026-03-09 06:00:00.000");
        assert_eq!(text(0.25, ExcelDateTimeType::DateTime), "06:00:00.000");
        assert_eq!(text(1.5, ExcelDateTimeType::TimeDelta), "36:00:00.000");
    }

    #[test]
    fn what_is_no_log_is_refused_with_what_there_is() {
        let (_directory, path) = workbook(&row(1, &["Name", "Meier"]));
        let said = read(&path, &Split::default(), &every_column).unwrap_err().to_string();
        assert!(said.contains("no sheet has a time column") && said.contains("Log"), "{said}");
        std::fs::write(&path, "time,bed\n0,20\n").unwrap();
        let said = read(&path, &Split::default(), &every_column).unwrap_err().to_string();
        assert!(said.contains("the file is not a workbook"), "{said}");
    }
}
