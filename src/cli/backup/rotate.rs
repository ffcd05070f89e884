//! Backups in a directory, of which the newest are kept. Their names contain machine and time.

use std::path::{Path, PathBuf};

use anyhow::Context;

/// Ending of the name of a backup.
const ENDING: &str = ".tar";
/// Form of the time in a name: a digit for each 0, and the other characters as they are.
const TIME: &str = "0000-00-00T00-00-00Z";

/// Returns the path of a new backup in this directory. `time` is its time in UTC, RFC 3339.
pub(super) fn path(directory: &Path, machine: &str, time: &str) -> PathBuf {
    let time = time.get(..TIME.len() - 1).unwrap_or(time).replace(':', "-");
    directory.join(format!("{machine}-{time}Z{ENDING}"))
}

/// Checks that the directory exists. It is not created: a drive that is not mounted has no directory.
pub(super) fn check(directory: &Path) -> anyhow::Result<()> {
    anyhow::ensure!(
        directory.is_dir(),
        "the directory {} does not exist: create it, or mount its drive",
        directory.display()
    );
    Ok(())
}

/// Removes the backups of this machine except the newest `copies`, and returns the removed files. Other files in the
/// directory are not touched.
pub(super) fn remove_old(directory: &Path, machine: &str, copies: usize) -> anyhow::Result<Vec<PathBuf>> {
    let shown = directory.display();
    let mut names = Vec::new();
    for entry in std::fs::read_dir(directory).with_context(|| format!("{shown} cannot be read"))? {
        let entry = entry.with_context(|| format!("{shown} cannot be read"))?;
        names.extend(entry.file_name().into_string());
    }
    let old: Vec<PathBuf> =
        expired(names, machine, copies).into_iter().map(|name| directory.join(name)).collect();
    for file in &old {
        std::fs::remove_file(file).with_context(|| format!("{} cannot be removed", file.display()))?;
    }
    Ok(old)
}

/// Returns the names of the backups of this machine except the newest `copies`. Names in the order of the alphabet are
/// in the order of time.
fn expired(names: Vec<String>, machine: &str, copies: usize) -> Vec<String> {
    let mut own: Vec<String> = names.into_iter().filter(|name| is_backup(name, machine)).collect();
    own.sort();
    own.truncate(own.len().saturating_sub(copies));
    own
}

fn is_backup(name: &str, machine: &str) -> bool {
    let time = name.strip_prefix(machine).and_then(|rest| rest.strip_prefix('-'));
    let Some(time) = time.and_then(|rest| rest.strip_suffix(ENDING)) else { return false };
    let fits = |(one, form): (u8, u8)| if form == b'0' { one.is_ascii_digit() } else { one == form };
    time.len() == TIME.len() && time.bytes().zip(TIME.bytes()).all(fits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_has_machine_and_time_and_is_recognised_again() {
        for time in ["2026-11-23T02:15:00Z", "2026-11-23T02:15:00.250Z"] {
            let path = path(Path::new("/mnt/backup"), "mill-7", time);
            assert_eq!(path, Path::new("/mnt/backup/mill-7-2026-11-23T02-15-00Z.tar"));
            assert!(is_backup(path.file_name().unwrap().to_str().unwrap(), "mill-7"));
        }
    }

    #[test]
    fn only_older_backups_of_this_machine_expire() {
        let of = |machine: &str, day: u32| format!("{machine}-2026-11-{day:02}T02-15-00Z.tar");
        let mut names: Vec<String> = (1..=5).rev().map(|day| of("mill", day)).collect();
        let others = [
            of("mill-7", 1),
            of("other", 1),
            "mill-notes.tar".to_owned(),
            "mill-2026-11-01.tar".to_owned(),
            format!("{}.part", of("mill", 1)),
            "mill-2026-11-01T02-15-0xZ.tar".to_owned(),
        ];
        names.extend(others);
        assert_eq!(expired(names.clone(), "mill", 3), [of("mill", 1), of("mill", 2)]);
        assert_eq!(expired(names.clone(), "mill", 5), [""; 0]);
        assert_eq!(expired(names.clone(), "mill", 100), [""; 0]);
        assert_eq!(expired(names, "mill-7", 1), [""; 0]);
    }
}
