//! File of the number: one line with the number of the document, the time of the first document, and a checksum.
//!
//! If a run can write nothing at its start, it renames this file. The document then still says that the previous run
//! ended in order, and the new name says that this is no longer true.

use std::path::{Path, PathBuf};

use super::document::{DocumentRejection, Seal, checksum};
use super::read;
use crate::gateway::store::disk::Disk;
use isotherm_core::quantity::Moment;

/// Number of a document, as in its own file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gateway) struct Number {
    pub(in crate::gateway) number: u64,
    /// Time at which the first document was made.
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

/// Path of the number.
pub(in crate::gateway) fn path(directory: &Path, machine: &str) -> PathBuf {
    directory.join(format!("{machine}.number"))
}

/// Path of the number after the start of a run that could write nothing.
pub(super) fn begun(path: &Path) -> PathBuf {
    path.with_added_extension("begun")
}

/// Reads the number. Returns the path of its file, and `None` if there is no file. The error is a clause: the number is
/// not accepted.
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
    let found = read(disk, &path, parse).map_err(|why| format!("number file {}: {why}", path.display()));
    (path, found)
}

/// Compares a document with the number. Returns a clause if they do not fit. `has_logs`: a run has left its logs here.
pub(super) fn assess(document: Option<&Seal>, number: Option<Number>, has_logs: bool) -> Option<String> {
    match (document, number) {
        (None, None) => {
            has_logs.then(|| "the file is missing, but the directory contains logs of a run".to_owned())
        }
        (None, Some(Number { number, .. })) => {
            Some(format!("the file is missing, but the number file exists ({number})"))
        }
        (Some(seal), None) => (seal.named > 0).then(|| "the number file is missing".to_owned()),
        (Some(seal), Some(known)) if seal.since != known.since => {
            Some("state and number file do not match: one of them is a copy from elsewhere".to_owned())
        }
        (Some(seal), Some(Number { number, .. })) if seal.number < number => Some(format!(
            "the file is an older copy: it has the number {}, but the number file contains {number}",
            seal.number
        )),
        (Some(seal), Some(Number { number, .. })) if number < seal.named => Some(format!(
            "the number file is an older copy: it contains {number}, but contained {} when the state was \
             saved",
            seal.named
        )),
        (Some(_), Some(_)) => None,
    }
}
