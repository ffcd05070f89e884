//! Which files are meant.

use std::io;
use std::path::{Path, PathBuf};

use super::BadLog;

/// What a gateway did with its decisions, beside the log of these: no measurement.
const OF_OUTPUTS: &str = ".outputs.csv";

/// The files as they are named; of a directory, those that end with .csv or .parquet, by name, but no logs of outputs.
pub(super) fn logs(named: &[PathBuf], wrong: &mut Vec<String>) -> Vec<PathBuf> {
    if named.is_empty() {
        wrong.push("no log is named: give one or more CSV or Parquet files".to_owned());
    }
    let mut files: Vec<PathBuf> = Vec::new();
    for name in named {
        if is_of_outputs(name) {
            wrong.push(format!(
                "{} tells what outputs did, and nothing that was measured: name the log beside it, whose name ends with .csv \
                 alone",
                name.display()
            ));
            continue;
        }
        let found = if name.is_dir() { inside(name, wrong) } else { vec![name.clone()] };
        for file in found {
            if files.iter().any(|known| is_same(known, &file)) {
                wrong.push(format!(
                    "{} is named twice: a run would be judged by a model that had seen it; name each log once",
                    file.display()
                ));
            } else {
                files.push(file);
            }
        }
    }
    files
}

fn is_of_outputs(path: &Path) -> bool {
    path.to_str().is_some_and(|path| path.ends_with(OF_OUTPUTS))
}

fn is_same(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    }
}

fn inside(directory: &Path, wrong: &mut Vec<String>) -> Vec<PathBuf> {
    let is_log = |path: &PathBuf| {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        !is_of_outputs(path) && ["csv", "parquet"].iter().any(|known| ending.eq_ignore_ascii_case(known))
    };
    let entries = match std::fs::read_dir(directory) {
        Ok(entries) => entries,
        Err(why) => {
            wrong.push(format!("{}: {}", directory.display(), cannot_be_read(&why)));
            return Vec::new();
        }
    };
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_log).collect();
    files.sort();
    if files.is_empty() {
        wrong.push(format!(
            "{} is a directory without a log: nothing in it ends with .csv or .parquet; `isotherm record` writes logs",
            directory.display()
        ));
    }
    files
}

/// Opens a log.
pub(super) fn open(file: &Path) -> Result<std::fs::File, BadLog> {
    std::fs::File::open(file)
        .map_err(|why| BadLog(vec![format!("{}: {}", file.display(), cannot_be_read(&why))]))
}

fn cannot_be_read(why: &io::Error) -> String {
    match why.kind() {
        io::ErrorKind::NotFound => "there is no such file".to_owned(),
        _ => format!("it cannot be read: {why}"),
    }
}
