//! Search for the log files that the operator named, also in directories.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::{BadLog, decode, head, spaced};
use isotherm_profile::{FileKind, safe_file};

/// Number of bytes at the start of a text file in which the line with the column names must be.
const SAMPLE: u64 = 1 << 16;

/// Returns the log files in the order of `named`. A directory is replaced by the logs in it, sorted by name. Logs of
/// outputs are left out. Adds a remark about each file of a directory that may contain a log but is not read.
pub(super) fn logs(named: &[PathBuf], wrong: &mut Vec<String>, remarks: &mut Vec<String>) -> Vec<PathBuf> {
    if named.is_empty() {
        wrong.push("no log was given: name one or more CSV or Parquet files".to_owned());
    }
    let mut files: Vec<PathBuf> = Vec::new();
    for name in named {
        if is_of_outputs(name) {
            wrong.push(format!(
                "{} is a log of outputs, which contains no measured values: use the log in the same directory \
                 whose name ends with .csv, without .outputs",
                name.display()
            ));
            continue;
        }
        let found = if name.is_dir() { inside(name, wrong, remarks) } else { vec![name.clone()] };
        for file in found {
            let path = file.canonicalize().ok();
            if path.is_some() && files.iter().any(|known| known.canonicalize().ok() == path) {
                wrong.push(format!(
                    "{} is named twice: the same run would be used to identify the model and to test it; \
                     name each log once",
                    file.display()
                ));
            } else {
                files.push(file);
            }
        }
    }
    files
}

/// Returns whether this file is a log of outputs, which the gateway writes next to the log of its decisions. Such a
/// file contains no measurement.
fn is_of_outputs(path: &Path) -> bool {
    path.to_str().is_some_and(|path| path.ends_with(".outputs.csv") || path.ends_with(".outputs.csv.gz"))
}

/// Extensions of text files that may be logs or notes. Such a file is read only if it has a line with column names.
const TEXTS: [&str; 8] = ["txt", "tsv", "tab", "dat", "asc", "log", "prn", "lvm"];
/// Extensions of files that may contain logs but cannot be read, with advice for the message.
const UNREAD: [(&[&str], &str); 3] = [
    (
        &["xls", "xlsb", "ods"],
        "this kind of workbook is not supported: save the sheet with the log as .xlsx or as CSV",
    ),
    (
        &["zip", "7z", "rar", "tar", "tgz", "bz2", "xz", "zst"],
        "archives are not supported: extract the logs from this file",
    ),
    (
        &["mf4", "mdf", "blf", "tdms", "feather", "arrow", "h5", "hdf5", "mat", "pkl", "sqlite", "db"],
        "this format is not supported: export it as CSV or Parquet",
    ),
];

/// Advice for a file that can only be read by a build with the feature `tables`.
const NO_TABLES: &str = "this program was built without support for workbooks and compressed logs: save the \
                         file as CSV, or install a packaged version of the program";

/// Use of a file that was found in a directory of logs: the file is read as a log, reported as unreadable, or ignored.
#[derive(Debug, PartialEq, Eq)]
enum Use {
    Log,
    /// Possible log that is not read. The text contains the reason and advice.
    Unread(String),
    Nothing,
}

fn use_of(path: &Path) -> Use {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_ascii_lowercase();
    // Spreadsheets and file servers write such files next to a file that is open.
    if name.starts_with(['.', '~']) || is_of_outputs(path) || path.is_dir() {
        return Use::Nothing;
    }
    let needs_tables = || match cfg!(feature = "tables") {
        true => Use::Log,
        false => Use::Unread(NO_TABLES.to_owned()),
    };
    let (stem, ending) = name.rsplit_once('.').unwrap_or((name.as_str(), ""));
    let is_text = |ending: &str| ending == "csv" || TEXTS.contains(&ending);
    match ending {
        "csv" | "parquet" => Use::Log,
        "xlsx" | "xlsm" => needs_tables(),
        "gz" if stem.rsplit_once('.').is_some_and(|(_, inner)| is_text(inner)) => needs_tables(),
        _ if TEXTS.contains(&ending) => match is_log(path) {
            true => Use::Log,
            false => Use::Unread(
                "the file has no header line with a time column, followed by rows of numbers. \
                 `isotherm logs explain` shows how the file is read"
                    .to_owned(),
            ),
        },
        _ => match UNREAD.iter().find(|(endings, _)| endings.contains(&ending)) {
            Some((_, why)) => Use::Unread((*why).to_owned()),
            None => Use::Nothing,
        },
    }
}

/// Returns whether a text file begins like a log: with a line that names a time column, and rows below that line.
fn is_log(path: &Path) -> bool {
    let begin = || -> io::Result<Vec<u8>> {
        let (decoded, _) = decode::utf8(safe_file::open(path)?)?;
        let mut text = Vec::new();
        spaced::columns(decoded)?.take(SAMPLE).read_to_end(&mut text)?;
        Ok(text)
    };
    // A file that cannot be read is named when it is read as a log.
    begin().map_or(true, |text| head::has_rows(&text))
}

/// Returns the logs in a directory, sorted by name. Adds a remark about each file that may contain a log but is not
/// read.
fn inside(directory: &Path, wrong: &mut Vec<String>, remarks: &mut Vec<String>) -> Vec<PathBuf> {
    let mut entries: Vec<PathBuf> = match std::fs::read_dir(directory) {
        Ok(entries) => entries.flatten().map(|entry| entry.path()).collect(),
        Err(why) => {
            wrong.extend(cannot_be_read(directory, &why).0);
            return Vec::new();
        }
    };
    entries.sort();
    let (mut files, mut unread) = (Vec::new(), Vec::new());
    for path in entries {
        match use_of(&path) {
            Use::Log => files.push(path),
            Use::Unread(why) => {
                let known = FileKind::mistake(&path, FileKind::Log);
                let line = known.unwrap_or_else(|| format!("{}: {why}", path.display()));
                unread.push(format!("{line} (the file is left out)"));
            }
            Use::Nothing => {}
        }
    }
    if files.is_empty() {
        wrong.push(format!(
            "{} is a directory without a log: nothing in it ends with .csv or .parquet; `isotherm record` writes logs",
            directory.display()
        ));
        wrong.extend(unread);
    } else {
        remarks.extend(unread);
    }
    files
}

/// Opens a log file for reading. Returns an error with the path if the file does not exist, or is not a regular file.
pub(super) fn open(file: &Path) -> Result<File, BadLog> {
    safe_file::open(file).map_err(|why| cannot_be_read(file, &why))
}

pub(super) fn cannot_be_read(path: &Path, why: &io::Error) -> BadLog {
    BadLog(vec![match why.kind() {
        io::ErrorKind::NotFound => format!("{}: there is no such file", path.display()),
        _ => format!("{}: the file cannot be read: {why}", path.display()),
    }])
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOG: &str = "time\tbed\n0\t20\n60\t21\n";

    fn of(files: &[(&str, &str)]) -> (Vec<String>, Vec<String>, Vec<String>) {
        let directory = tempfile::tempdir().unwrap();
        for (name, text) in files {
            std::fs::write(directory.path().join(name), text).unwrap();
        }
        let (mut wrong, mut remarks) = (Vec::new(), Vec::new());
        let found = logs(&[directory.path().to_owned()], &mut wrong, &mut remarks);
        let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
        (found.iter().map(name).collect(), remarks, wrong)
    }

    #[test]
    fn text_logs_of_a_directory_are_read_whatever_their_ending() {
        for ending in ["csv", "CSV", "txt", "TXT", "tsv", "tab", "dat", "asc", "log", "prn", "lvm"] {
            let name = format!("day.{ending}");
            let (found, remarks, wrong) = of(&[(name.as_str(), LOG)]);
            assert_eq!((found, remarks, wrong), (vec![name], Vec::new(), Vec::new()), "{ending}");
        }
    }

    #[test]
    fn files_that_are_no_logs_are_named_with_the_remedy() {
        for (name, text, why) in [
            ("old.xls", "x", "save the sheet with the log as .xlsx or as CSV"),
            ("old.XLS", LOG, "this log is a text file: rename it to a name that ends with .csv"),
            ("day.dat", "PAR1", "rename it to a name that ends with .parquet"),
            ("old.ods", "x", "save the sheet"),
            ("week.zip", "x", "extract the logs"),
            ("can.mf4", "x", "export it as CSV or Parquet"),
            ("notes.txt", "the door was open on Monday\n", "the file has no header line"),
            ("service.log", "2026-01-05 06:00:00 INFO started\n", "isotherm logs explain"),
            ("names.txt", "time\tbed\n", "followed by rows of numbers"),
        ] {
            let (found, remarks, wrong) = of(&[("day.csv", LOG), (name, text)]);
            assert_eq!((found, wrong), (vec!["day.csv".to_owned()], Vec::new()), "{name}");
            assert!(
                remarks.len() == 1 && remarks[0].contains(name) && remarks[0].contains(why),
                "{remarks:?}"
            );
            let (found, _, wrong) = of(&[(name, text)]);
            assert!(found.is_empty() && wrong.len() == 2 && wrong[1].contains(why), "{wrong:?}");
        }
    }

    #[test]
    fn other_files_of_a_directory_are_no_logs() {
        let others = ["z.html", "z.toml", "m.json", "~$day.xlsx", ".day.csv.swp", "d.outputs.csv"];
        let files: Vec<(&str, &str)> =
            others.iter().map(|name| (*name, LOG)).chain([("day.csv", LOG)]).collect();
        assert_eq!(of(&files), (vec!["day.csv".to_owned()], Vec::new(), Vec::new()));
    }
}
