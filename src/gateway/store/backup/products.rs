//! Backup of the directory `NAME.products`, which contains the results of learning. These are the products of
//! each run (sums from which a model is identified), and for each axis the candidate (proposed model) and the
//! learning record. The learning record contains the days on which the candidate was compared with the model
//! in use. A restored machine needs these files to continue learning, because a backup contains no logs.

use std::io::ErrorKind;
use std::path::Path;

use crate::gateway::store::candidates;
use isotherm_profile::safe_file;

/// Maximum size of one file that learning has written, in bytes.
const LARGEST_FILE: u64 = 16 * 1024 * 1024;
/// Maximum length of a file name, in bytes. The names in a backup archive (format ustar) cannot be longer.
const LONGEST_NAME: usize = 100;
/// End of the name of a file with the products (results) of one run.
const RUN: &str = ".products.json";
/// Ends of the names of the other files: the learning record and the candidate. Each axis has one file of
/// each kind.
const OTHERS: [&str; 2] = [".learning.json", ".candidate.json"];

/// Limits for the files in a backup that learning has written: their number and their total size.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Maximum number of files.
    pub files: usize,
    /// Maximum total size of the files, in bytes.
    pub bytes: u64,
}

/// Files that learning has written for a machine, for a backup.
#[derive(Debug, Default)]
pub struct TakenProducts {
    /// Names and contents of the files.
    pub files: Vec<(String, Vec<u8>)>,
    /// Number of runs that the backup does not contain, because the limits are reached. They are the oldest
    /// runs.
    pub older: usize,
    /// Sentences for the operator about files that cannot be part of the backup.
    pub unusable: Vec<String>,
}

/// Reads the files that learning has written for a machine. If the files exceed the limits, only the newest runs are
/// read. `isotherm learn` may run at the same time.
///
/// # Errors
/// The directory cannot be read. The error is a sentence.
pub fn take(directory: &Path, machine: &str, limits: Limits) -> Result<TakenProducts, String> {
    let place = candidates::products(directory, machine);
    let mut taken = TakenProducts::default();
    let mut bytes_left = limits.bytes;
    // First, because a record must not count more runs than the backup contains. New runs may appear meanwhile.
    let others = names(&place)?;
    let others = others.iter().filter(|name| OTHERS.iter().any(|ending| name.ends_with(ending)));
    for name in others {
        if let Some(bytes) = read(&place, name, &mut taken.unusable) {
            bytes_left = bytes_left.saturating_sub(bytes.len() as u64);
            taken.files.push((name.clone(), bytes));
        }
    }
    let mut runs = names(&place)?;
    runs.retain(|name| name.ends_with(RUN));
    runs.sort_by(|one, other| time_of(other).cmp(time_of(one)));
    for (number, name) in runs.iter().enumerate() {
        let Some(bytes) = read(&place, name, &mut taken.unusable) else { continue };
        let size = bytes.len() as u64;
        if size > bytes_left || taken.files.len() >= limits.files {
            taken.older = runs.len() - number;
            break;
        }
        bytes_left -= size;
        taken.files.push((name.clone(), bytes));
    }
    Ok(taken)
}

/// Returns whether a file may have this name in a backup.
pub fn is_name(name: &str) -> bool {
    let is_safe = |c: char| c.is_ascii_alphanumeric() || "-_.:@".contains(c);
    let has_ending = name.ends_with(RUN) || OTHERS.iter().any(|ending| name.ends_with(ending));
    has_ending && name.len() <= LONGEST_NAME && !name.starts_with('.') && name.chars().all(is_safe)
}

/// Returns the names of the files in the directory `place`. The list is empty if the directory does not exist.
fn names(place: &Path) -> Result<Vec<String>, String> {
    let wrong = |error: std::io::Error| format!("{} cannot be read: {error}", place.display());
    let entries = match std::fs::read_dir(place) {
        Ok(entries) => entries,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(wrong(error)),
    };
    let mut names = Vec::new();
    for entry in entries {
        names.extend(entry.map_err(wrong)?.file_name().into_string());
    }
    names.sort();
    Ok(names)
}

/// Returns the part of a file name after the axis name and `@`, which begins with the time of the run. Empty
/// if the name contains no `@`.
fn time_of(name: &str) -> &str {
    name.split_once('@').map_or("", |(_, time)| time)
}

/// Reads a file. `None` if the file no longer exists, or cannot be part of a backup. In the second case, a sentence
/// is added to `unusable`.
fn read(place: &Path, name: &str, unusable: &mut Vec<String>) -> Option<Vec<u8>> {
    let path = place.join(name);
    let why = if is_name(name) {
        match safe_file::read(&path, LARGEST_FILE) {
            Ok(bytes) => return Some(bytes),
            Err(error) if error.kind() == ErrorKind::NotFound => return None,
            Err(error) => error.to_string(),
        }
    } else {
        format!(
            "a file name in a backup may have at most {LONGEST_NAME} characters: letters, digits and any of - _ . : @"
        )
    };
    unusable.push(format!("{} is left out of the backup: {why}", path.display()));
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: Limits = Limits { files: 100, bytes: 1_000 };

    fn names_of(taken: &TakenProducts) -> Vec<&str> {
        taken.files.iter().map(|(name, _)| name.as_str()).collect()
    }

    #[test]
    fn the_newest_runs_of_all_axes_are_kept_within_the_limits() {
        let home = tempfile::tempdir().unwrap();
        assert!(take(home.path(), "mill", ALL).unwrap().files.is_empty(), "no directory");
        let place = candidates::products(home.path(), "mill");
        std::fs::create_dir(&place).unwrap();
        let write = |name: &str| std::fs::write(place.join(name), [b'x'; 100]).unwrap();
        let runs = ["x@2026-01-02", "z@2026-01-01", "x@2026-01-03", "z@2026-01-04"];
        for run in runs {
            write(&format!("{run}T06:00:00Z.products.json"));
        }
        ["x.learning.json", "z.candidate.json", "z.learning.json.new", "notes.txt"]
            .iter()
            .for_each(|name| write(name));

        let taken = take(home.path(), "mill", ALL).unwrap();
        let records = ["x.learning.json", "z.candidate.json"];
        let newest = ["z@2026-01-04", "x@2026-01-03", "x@2026-01-02", "z@2026-01-01"];
        let newest = newest.map(|run| format!("{run}T06:00:00Z.products.json"));
        let expected = |runs: usize| [&records[..], &newest.each_ref().map(String::as_str)[..runs]].concat();
        assert_eq!((names_of(&taken), taken.older), (expected(4), 0));
        assert!(taken.unusable.is_empty() && taken.files.iter().all(|(_, bytes)| bytes.len() == 100));

        let taken = take(home.path(), "mill", Limits { bytes: 450, ..ALL }).unwrap();
        assert_eq!((names_of(&taken), taken.older), (expected(2), 2));
        let taken = take(home.path(), "mill", Limits { files: 5, ..ALL }).unwrap();
        assert_eq!((names_of(&taken), taken.older), (expected(3), 1));
    }

    #[test]
    fn a_file_that_cannot_be_saved_is_named_and_the_others_are_saved() {
        let home = tempfile::tempdir().unwrap();
        let place = candidates::products(home.path(), "mill");
        std::fs::create_dir(&place).unwrap();
        let long = format!("z@2026-01-02T06:00:00Z@{}.products.json", "a".repeat(80));
        let folder = "z@2026-01-03T06:00:00Z.products.json";
        std::fs::create_dir(place.join(folder)).unwrap();
        for name in [long.as_str(), "z@2026-01-01T06:00:00Z.products.json"] {
            std::fs::write(place.join(name), "x").unwrap();
        }
        let taken = take(home.path(), "mill", ALL).unwrap();
        assert_eq!(names_of(&taken), ["z@2026-01-01T06:00:00Z.products.json"]);
        assert!(taken.unusable.len() == 2, "{:?}", taken.unusable);
        assert!(taken.unusable[0].contains(folder) && taken.unusable[1].contains("at most 100"), "{taken:?}");
    }

    #[test]
    fn only_names_that_learning_gives_are_in_a_backup() {
        for name in ["z@2026-01-01T06:00:00Z@run-2_b.products.json", "z.learning.json", "z-2.candidate.json"]
        {
            assert!(is_name(name), "{name}");
        }
        for name in [
            "z.state.json",
            "../z.learning.json",
            "a/z.learning.json",
            ".learning.json",
            "",
            "z\n.learning.json",
        ] {
            assert!(!is_name(name), "{name:?}");
        }
    }
}
