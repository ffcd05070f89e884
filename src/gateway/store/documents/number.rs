//! File `NAME.number` next to the state document: one line with the save number of the document, the time of the first
//! document, and a checksum.
//!
//! If a run cannot write files at its start, it renames this file. The new name shows that the document is out of
//! date, because writes of that run may still arrive at a register.

use std::path::{Path, PathBuf};

use super::document::{DocumentRejection, Seal, checksum};
use super::read;
use crate::gateway::store::disk::Disk;
use isotherm_core::quantity::Moment;

/// Content of the file `NAME.number`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gateway) struct Number {
    pub(in crate::gateway) number: u64,
    /// Time at which the first document of the machine was made.
    pub(in crate::gateway) since: Moment,
}

impl Number {
    pub(super) fn line(self) -> String {
        let line = format!("{} {} ", self.number, self.since.as_nanos());
        format!("{line}{}\n", checksum(line.as_bytes()))
    }

    fn parse(text: &str) -> Option<Number> {
        let mut words = text.split(' ');
        let number = words.next()?.parse().ok()?;
        let since = Moment::from_nanos(words.next()?.parse().ok()?);
        Some(Number { number, since }).filter(|number| number.line() == text)
    }
}

/// Returns the path of `NAME.number`, the file with the save number of the state document.
pub(in crate::gateway) fn path(directory: &Path, machine: &str) -> PathBuf {
    directory.join(format!("{machine}.number"))
}

/// Returns the path to which a run renames `NAME.number` if it cannot write files at its start.
pub(super) fn begun(path: &Path) -> PathBuf {
    path.with_added_extension("begun")
}

/// Reads `NAME.number`, the file with the save number of the state document. Returns the path of the file and the
/// number; `None` if the file does not exist. If the number is rejected, the error is a part of a sentence.
pub(in crate::gateway) fn read_number(
    disk: &dyn Disk,
    directory: &Path,
    machine: &str,
) -> (PathBuf, Result<Option<Number>, String>) {
    let path = path(directory, machine);
    let begun = begun(&path);
    let is_begun = !disk.has(&path) && disk.has(&begun);
    let path = if is_begun { begun } else { path };
    let parse = |bytes: &[u8]| {
        let number = std::str::from_utf8(bytes).ok().and_then(Number::parse);
        number.ok_or_else(|| DocumentRejection::Because("the file was changed or damaged".to_owned()))
    };
    let found = read(disk, &path, parse).map_err(|why| format!("save number in {}: {why}", path.display()));
    (path, found)
}

/// Compares a document with the save number in `NAME.number`. Returns a part of a sentence if they do not match.
/// `has_logs`: whether the directory contains logs of an earlier run.
pub(super) fn assess(document: Option<&Seal>, number: Option<Number>, has_logs: bool) -> Option<String> {
    match (document, number) {
        (None, None) => {
            has_logs.then(|| "the file is missing, but the directory contains logs of a run".to_owned())
        }
        (None, Some(Number { number, .. })) => {
            Some(format!("the file is missing, but the file with its save number exists ({number})"))
        }
        (Some(seal), None) => (seal.named > 0).then(|| "the file with its save number is missing".to_owned()),
        (Some(seal), Some(known)) if seal.since != known.since => Some(
            "the state file and the file with its save number do not match: one of them is a copy from \
                  elsewhere"
                .to_owned(),
        ),
        (Some(seal), Some(Number { number, .. })) if seal.number < number => Some(format!(
            "the file is an older copy: it has the save number {}, but the file with the save number \
             contains {number}",
            seal.number
        )),
        (Some(seal), Some(Number { number, .. })) if number < seal.named => Some(format!(
            "the file with the save number is an older copy: it contains {number}, but contained {} when the \
             state was \
             saved",
            seal.named
        )),
        (Some(_), Some(_)) => None,
    }
}
