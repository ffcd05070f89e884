//! Selection of the log files.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use super::BadLog;
use isotherm_profile::safe_file;

/// Returns the log files in the order of `named`. A directory is replaced by its .csv and .parquet files, and by those of
/// the feature `tables`, sorted by name, except logs of outputs.
pub(super) fn logs(named: &[PathBuf], wrong: &mut Vec<String>) -> Vec<PathBuf> {
    if named.is_empty() {
        wrong.push("no log is named: give one or more CSV or Parquet files".to_owned());
    }
    let mut files: Vec<PathBuf> = Vec::new();
    for name in named {
        if is_of_outputs(name) {
            wrong.push(format!(
                "{} is a log of outputs, without measured values: name the log in the same directory whose \
                 name ends with .csv only",
                name.display()
            ));
            continue;
        }
        let found = if name.is_dir() { inside(name, wrong) } else { vec![name.clone()] };
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

fn inside(directory: &Path, wrong: &mut Vec<String>) -> Vec<PathBuf> {
    let is_log = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_ascii_lowercase();
        // A spreadsheet writes the second name while a workbook is open.
        let is_workbook = name.ends_with(".xlsx") && !name.starts_with("~$");
        let is_of_tables = cfg!(feature = "tables") && (name.ends_with(".csv.gz") || is_workbook);
        !is_of_outputs(path) && (name.ends_with(".csv") || name.ends_with(".parquet") || is_of_tables)
    };
    let mut files: Vec<PathBuf> = match std::fs::read_dir(directory) {
        Ok(entries) => entries.flatten().map(|entry| entry.path()).filter(is_log).collect(),
        Err(why) => {
            wrong.extend(cannot_be_read(directory, &why).0);
            return Vec::new();
        }
    };
    files.sort();
    if files.is_empty() {
        wrong.push(format!(
            "{} is a directory without a log: nothing in it ends with .csv or .parquet; `isotherm record` writes logs",
            directory.display()
        ));
    }
    files
}

/// Opens a log file.
pub(super) fn open(file: &Path) -> Result<File, BadLog> {
    safe_file::open(file).map_err(|why| cannot_be_read(file, &why))
}

pub(super) fn cannot_be_read(path: &Path, why: &io::Error) -> BadLog {
    BadLog(vec![match why.kind() {
        io::ErrorKind::NotFound => format!("{}: there is no such file", path.display()),
        _ => format!("{}: the file cannot be read: {why}", path.display()),
    }])
}
