//! Formats of log files, by the file extension.

use std::path::Path;

#[cfg(feature = "tables")]
use super::gzip;
#[cfg(feature = "parquet")]
use super::parquet;
use super::table::Table;
#[cfg(feature = "tables")]
use super::workbook;
use super::{BadLog, Split, Uses, csv};
use isotherm_profile::FileKind;

/// Reads a log file in any format. If the file is not a log but another known kind of file, for example a profile, the
/// error message states that kind.
pub(super) fn read_table(file: &Path, split: &Split, uses: Uses<'_>) -> Result<Table, BadLog> {
    read_by_ending(file, split, uses).map_err(|wrong| named(file, wrong))
}

/// Returns the error for a file that cannot be read as a log. If the file is of another known kind or format, the
/// message states that kind. Otherwise, returns `wrong`, the error of the reader.
pub(super) fn named(file: &Path, wrong: BadLog) -> BadLog {
    FileKind::mistake(file, FileKind::Log).map_or(wrong, |line| BadLog(vec![line]))
}

fn read_by_ending(file: &Path, split: &Split, uses: Uses<'_>) -> Result<Table, BadLog> {
    let ending = file.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    match ending.to_ascii_lowercase().as_str() {
        #[cfg(feature = "parquet")]
        "parquet" => parquet::read(file, split, uses),
        #[cfg(not(feature = "parquet"))]
        "parquet" => Err(not_built(file, "Parquet", "parquet")),
        #[cfg(feature = "tables")]
        "gz" => gzip::read(file, split, uses),
        #[cfg(not(feature = "tables"))]
        "gz" => Err(not_built(file, "compressed logs", "tables")),
        #[cfg(feature = "tables")]
        "xlsx" | "xlsm" => workbook::read(file, split, uses),
        #[cfg(not(feature = "tables"))]
        "xlsx" | "xlsm" => Err(not_built(file, "workbooks", "tables")),
        "xls" | "xlsb" | "ods" => Err(BadLog(vec![format!(
            "{}: this kind of workbook is not supported: save the sheet with the log as .xlsx or as CSV",
            file.display()
        )])),
        _ => csv::read(file, split, uses),
    }
}

/// Returns the error message about a file that only a build with another feature can read.
#[cfg(not(all(feature = "parquet", feature = "tables")))]
fn not_built(file: &Path, what: &str, feature: &str) -> BadLog {
    BadLog(vec![format!(
        "{}: this program was built without support for {what}. Save the file as CSV, install a packaged \
         version, or build the program with {what}: `cargo build --release --features {feature}`",
        file.display()
    )])
}
