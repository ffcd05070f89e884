//! Rotation of backups in a directory: the newest backups are kept, older backups are removed. The file name of a
//! backup contains machine and time.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::Context;

use super::write_new;

/// File extension of a backup.
const ENDING: &str = ".tar";
/// Additional file extension of an incomplete backup: `.tar.part`.
const PART: &str = "part";
/// Format of the time in a file name. Each 0 stands for a digit; the other characters are literal.
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

/// Writes a new backup under a temporary name, and renames the file when it is complete. An incomplete file would
/// otherwise count as one of the copies.
pub(super) fn write(file: &Path, archive: &[u8], mode: u32) -> std::io::Result<()> {
    if file.exists() {
        return Err(ErrorKind::AlreadyExists.into());
    }
    let part = file.with_added_extension(PART);
    write_new(&part, archive, mode, None)?;
    std::fs::rename(&part, file)
}

/// Removes old backups of this machine until `copies` backups are left: `new` and the newest other backups. Returns the
/// removed files. Other files in the directory are not changed.
pub(super) fn remove_old(new: &Path, machine: &str, copies: usize) -> anyhow::Result<Vec<PathBuf>> {
    let directory = new.parent().unwrap_or(Path::new("."));
    let new = new.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    remove(directory, expired(names(directory)?, machine, copies, new))
}

/// Removes the incomplete backups of this machine, which remain after a kill or a power cut. Returns the removed files.
pub(super) fn remove_incomplete(directory: &Path, machine: &str) -> anyhow::Result<Vec<PathBuf>> {
    let mut incomplete = names(directory)?;
    incomplete.retain(|name| {
        let complete = name.strip_suffix(PART).and_then(|rest| rest.strip_suffix('.'));
        complete.is_some_and(|name| is_backup(name, machine))
    });
    remove(directory, incomplete)
}

/// Returns the names in a directory that are valid UTF-8 text.
fn names(directory: &Path) -> anyhow::Result<Vec<String>> {
    let shown = directory.display();
    let mut names = Vec::new();
    for entry in std::fs::read_dir(directory).with_context(|| format!("{shown} cannot be read"))? {
        let entry = entry.with_context(|| format!("{shown} cannot be read"))?;
        names.extend(entry.file_name().into_string());
    }
    Ok(names)
}

fn remove(directory: &Path, names: Vec<String>) -> anyhow::Result<Vec<PathBuf>> {
    let files: Vec<PathBuf> = names.into_iter().map(|name| directory.join(name)).collect();
    for file in &files {
        std::fs::remove_file(file).with_context(|| format!("{} cannot be removed", file.display()))?;
    }
    Ok(files)
}

/// Returns the names of the backups to remove. `copies` backups of this machine are kept: `new` and the
/// newest other backups. The alphabetical order of the names is the order of time. If the computer's clock
/// was set back, `new` may have the oldest name. This function keeps `new` even then.
fn expired(names: Vec<String>, machine: &str, copies: usize, new: &str) -> Vec<String> {
    let mut old: Vec<String> =
        names.into_iter().filter(|name| name != new && is_backup(name, machine)).collect();
    old.sort();
    old.truncate((old.len() + 1).saturating_sub(copies));
    old
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
        let new = of("mill", 5);
        assert_eq!(expired(names.clone(), "mill", 3, &new), [of("mill", 1), of("mill", 2)]);
        assert_eq!(expired(names.clone(), "mill", 5, &new), [""; 0]);
        assert_eq!(expired(names.clone(), "mill", 100, &new), [""; 0]);
        assert_eq!(expired(names, "mill-7", 1, &of("mill-7", 1)), [""; 0]);
    }

    #[test]
    fn a_backup_never_removes_itself_whatever_the_clock_says() {
        let new = "mill-1970-01-01T00-00-07Z.tar".to_owned();
        let later = ["mill-2026-11-01T02-15-00Z.tar", "mill-2037-01-01T00-00-00Z.tar"].map(str::to_owned);
        let names = [later.as_slice(), std::slice::from_ref(&new)].concat();
        assert_eq!(expired(names.clone(), "mill", 2, &new), [later[0].clone()]);
        assert_eq!(expired(names, "mill", 1, &new), later);
    }

    #[test]
    fn an_incomplete_backup_is_not_one_of_the_copies_and_is_removed_by_the_next_one() {
        let home = tempfile::tempdir().unwrap();
        let [old, new] = [1, 2].map(|day| path(home.path(), "mill", &format!("2026-11-0{day}T02:15:00Z")));
        std::fs::write(&old, "old").unwrap();
        // The computer was switched off while this one was written.
        let torn = path(home.path(), "mill", "2026-11-01T12:00:00Z").with_added_extension("part");
        std::fs::write(&torn, "ha").unwrap();
        write(&new, b"new", 0o640).unwrap();
        assert_eq!(write(&new, b"another", 0o640).unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert!(remove_old(&new, "mill", 2).unwrap().is_empty());
        assert_eq!(remove_old(&new, "mill", 1).unwrap(), [old]);
        assert_eq!((std::fs::read(&new).unwrap(), torn.exists()), (b"new".to_vec(), true));
        let others = ["mill-7-2026-11-01T12-00-00Z.tar.part", "mill-notes.tar.part", "mill.part"];
        let others = others.map(|name| home.path().join(name));
        others.iter().for_each(|other| std::fs::write(other, "ha").unwrap());
        assert_eq!(remove_incomplete(home.path(), "mill").unwrap(), [torn]);
        assert!(remove_incomplete(home.path(), "mill").unwrap().is_empty());
        assert!(others.iter().all(|other| other.exists()) && new.exists());
    }
}
