//! File of `--out`. It is written under another name and renamed when it is complete. After an error, no incomplete
//! file remains, and an older file is unchanged.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;

/// Output file that appears under its name only when it is complete.
#[derive(Debug)]
pub(super) struct WholeFile {
    file: File,
    path: PathBuf,
    /// File that is written; `None` for a device or a pipe, which is written directly.
    part: Option<PathBuf>,
}

impl WholeFile {
    /// Begins the file. `path` must not name `log`, the file that is read.
    pub(super) fn begin(path: &Path, log: &Path) -> anyhow::Result<WholeFile> {
        let why = || format!("cannot write {}", path.display());
        // The target of a link is replaced, not the link.
        let known = path.canonicalize().ok();
        if known.is_some() && known == log.canonicalize().ok() {
            anyhow::bail!("--out names the log {}, which must be kept: name another file", log.display());
        }
        let is_special = std::fs::metadata(path).is_ok_and(|about| !about.is_file());
        if is_special || path.starts_with("/dev") || path.starts_with("/proc") {
            let file = File::create(path).with_context(why)?;
            return Ok(WholeFile { file, path: path.to_owned(), part: None });
        }
        let path = known.unwrap_or_else(|| path.to_owned());
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(".part");
        let part = path.with_file_name(name);
        // The file may remain from a program that was killed, or may be a link that another user made.
        let _ = std::fs::remove_file(&part);
        let file = File::create_new(&part).with_context(why)?;
        Ok(WholeFile { file, path, part: Some(part) })
    }

    /// Completes the file, and renames it to its final name.
    pub(super) fn end(mut self) -> anyhow::Result<()> {
        let Some(part) = &self.part else { return Ok(()) };
        std::fs::rename(part, &self.path).with_context(|| format!("cannot write {}", self.path.display()))?;
        self.part = None;
        Ok(())
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        if let Some(part) = &self.part {
            let _ = std::fs::remove_file(part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_exists_only_if_it_is_complete() {
        let home = tempfile::tempdir().unwrap();
        let (log, path) = (home.path().join("day.csv"), home.path().join("out.csv"));
        std::fs::write(&log, "time,bed\n").unwrap();
        let mut out = WholeFile::begin(&path, &log).unwrap();
        out.write_all(b"half").unwrap();
        drop(out);
        assert_eq!(std::fs::read_dir(home.path()).unwrap().count(), 1, "only the log remains");
        std::fs::write(&path, "older").unwrap();
        let mut out = WholeFile::begin(&path, &log).unwrap();
        out.write_all(b"whole").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "older");
        out.end().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "whole");
        assert_eq!(std::fs::read_dir(home.path()).unwrap().count(), 2);
        let why = WholeFile::begin(&log, &log).unwrap_err().to_string();
        assert!(why.contains("--out names the log"), "{why}");
        assert!(WholeFile::begin(&home.path().join("none").join("out.csv"), &log).is_err());
        WholeFile::begin(Path::new("/dev/null"), &log).unwrap().end().unwrap();
    }
}
