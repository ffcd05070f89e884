//! Data that a gateway saves for its next start: a document, and the save number of the document in a second file.
//! One writer saves both files.
//!
//! ```text
//! NAME.state.json  { "version": 6, "seal": {…, "number": 17, "named": 16}, "state": {…}, "outputs": {…} }
//! NAME.number      17 1795823557453364912 1c291ca3
//! ```
//!
//! `state` contains the time since machine start, and the references and lags by name of signal and axis. It
//! also contains the places (addresses of signals and registers of outputs), the bounds of the outputs, and
//! the releases of former registers. `outputs` contains the values that may still arrive at a register. For a
//! shared register, it also contains the two parts of the value: operator offset and gateway share. Documents
//! of layout 5 contain no places. The seal of the document shows whether the file is complete, and whether it
//! is an older copy. The seal has these fields:
//!
//! - `checksum`: CRC-32 of every byte of the file, with zeros in place of the digits of the checksum.
//! - `since`: time at which the first document of this machine was made on this computer. A document from
//!   another computer has another time.
//! - `number`: number of saves so far. `named`: number in the file `NAME.number` when this document was
//!   saved; 0 if the file did not exist.
//! - `in_question`: the files did not match, and no operator has armed an axis since then.
//!
//! # How an older copy is detected
//! The writer saves the document first, then the number. The number is saved with each state (every 8 s, and
//! at the end of the run), but not with each change of `outputs`. Therefore a write to a register waits only
//! for the document.
//!
//! | event | number in `NAME.number` | result of the next start |
//! |---|---|---|
//! | killed before the document was saved | number of the document | fits |
//! | killed between the two saves | smaller, but at least `named` | fits |
//! | killed after both saves | number of the document | fits |
//! | the document is an older copy | greater than the number of the document | does not fit |
//! | `NAME.number` is an older copy | smaller than `named` | does not fit |
//! | one of the two files is missing or damaged | none | does not fit, unless `named` is 0 |
//!
//! If both files were replaced by an older pair, this program cannot detect the replacement.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::Value;

use super::disk::{Disk, Files, refuse_what_others_may_write};
use crate::fieldbus::explain::system;
use isotherm_core::explained::Cause;
use isotherm_core::quantity::Moment;

pub(super) mod document;
mod earlier;
mod entry;
mod file;
mod names;
pub(super) mod number;
#[cfg(test)]
mod tests;
mod writer;

use document::{DocumentRejection, Seal, VERSION};
pub(in crate::gateway) use entry::{Entries, Entry, fits};
pub(super) use file::StoreFile;
pub(super) use names::{NamedMachine, by_name, by_place};
pub(in crate::gateway) use writer::{SaveResult, Writer};

/// Number of consecutive failures with a new cause, after which this cause is reported.
const CHANGED_AFTER: u32 = 2;

/// Reported cause of a failed save; `None` while saving works.
pub(super) type DiskCause = Option<Cause<(ErrorKind, Option<i32>)>>;

/// Records an error of the disk in `known`. Returns whether the error must be reported: it is the first error, or its
/// cause has changed.
pub(super) fn is_news(known: &mut DiskCause, error: &io::Error) -> bool {
    Cause::is_news(known, (error.kind(), error.raw_os_error()), CHANGED_AFTER)
}

/// Name of the state document in events.
pub(in crate::gateway) const WHAT: &str = "the state";

/// Content of a state document.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::gateway) struct Content {
    /// Saved state as JSON. `None` if no state has been saved yet.
    pub(in crate::gateway) state: Option<Value>,
    /// Entries of the register ledger, by the names of the outputs.
    pub(in crate::gateway) outputs: Entries,
}

/// Saved data that a run finds at its start, and the file to which this run saves its data.
pub(in crate::gateway) struct Opened {
    /// Content of the document; `None` if there is no document. If the document is rejected, the error is a sentence
    /// with the reason.
    pub(in crate::gateway) found: Result<Option<Content>, String>,
    /// Layout number of files that an earlier version of isotherm has written, and a part of a sentence about them.
    /// `None` if no such files exist.
    pub(in crate::gateway) earlier: Option<(u32, String)>,
    /// Whether this is the first run in the directory: no earlier run has left a file there.
    pub(in crate::gateway) is_first: bool,
    pub(in crate::gateway) file: StoreFile,
}

/// Documents in a directory, before their save number is compared with the number in the file `NAME.number`.
struct FoundDocuments {
    /// Path of each file, and the extension that is added to its name before a document of this version replaces the
    /// file.
    files: Vec<(PathBuf, &'static str)>,
    layout: u32,
    seal: Option<Seal>,
    content: Result<Option<Content>, DocumentRejection>,
}

/// Returns the path of the state document (file with the saved state) of a machine.
pub(in crate::gateway) fn path(directory: &Path, machine: &str) -> PathBuf {
    directory.join(format!("{machine}.state.json"))
}

/// Returns the content of the state document, without a check of its save number. `None` if the document does not
/// exist or is damaged.
pub(in crate::gateway) fn content(directory: &Path, machine: &str) -> Option<Content> {
    let read = read(&Files, &path(directory, machine), |bytes| document::read(bytes, machine));
    read.ok().flatten().map(|(_, content)| content)
}

/// Opens the saved data of a machine. `has_logs`: whether the directory contains logs of an earlier run.
pub(in crate::gateway) fn open(
    disk: &Arc<dyn Disk>,
    (directory, machine): (&Path, &str),
    has_logs: bool,
    now: Moment,
) -> Opened {
    let document = path(directory, machine);
    let FoundDocuments { mut files, layout, seal, content } = find_documents(&**disk, directory, machine);
    let (number_path, number) = number::read_number(&**disk, directory, machine);
    let known = number.as_ref().ok().copied().flatten();
    let is_first = matches!((&content, &number), (Ok(None), Ok(None))) && !has_logs;
    let content = content.and_then(|content| {
        let seal = seal.as_ref().filter(|_| content.is_some());
        let why = number.map_or_else(Some, |number| number::assess(seal, number, has_logs));
        why.map_or(Ok(content), |why| Err(DocumentRejection::Because(why)))
    });
    let is_of_a_later_version = matches!(content, Err(DocumentRejection::Later(_)));
    let is_earlier = layout < VERSION && matches!(content, Ok(Some(_)));
    if content.is_err() {
        files.push((number_path.clone(), ""));
    }
    let beside = |(path, replaced): (PathBuf, &str)| {
        let first = match &content {
            Err(_) => path.with_added_extension("bad"),
            Ok(_) => path.with_extension(replaced),
        };
        let free = free(&**disk, first);
        (path, free)
    };
    let is_kept_aside = !is_of_a_later_version && (content.is_err() || is_earlier);
    let files = files.into_iter().filter(|(path, _)| is_kept_aside && disk.has(path));
    let aside: Vec<(PathBuf, PathBuf)> = files.map(beside).collect();
    let names: Vec<String> = aside.iter().map(|(_, beside)| beside.display().to_string()).collect();
    let names = names.join(" and ");
    let kept =
        if names.is_empty() { String::new() } else { format!("; the rejected files are kept as {names}") };
    let since = known.map(|known| known.since).or(seal.as_ref().map(|seal| seal.since)).unwrap_or(now);
    let of_here = seal.as_ref().filter(|seal| seal.since == since);
    let named = known.map_or(0, |known| known.number);
    let is_in_question = content.is_err() || seal.as_ref().is_some_and(|seal| seal.in_question);
    let seal = Seal {
        machine: machine.to_owned(),
        since,
        number: of_here.map_or(named, |seal| seal.number.max(named)),
        named,
        ..Seal::default()
    };
    let found = content.map(|content| {
        // A run that could write nothing at its start may have left writes that can still arrive.
        let is_begun = number_path != number::path(directory, machine);
        content.map(|content| if is_begun { content.not_in_order() } else { content })
    });
    let found =
        found.map_err(|why| format!("the saved state {} is rejected: {why}{kept}", document.display()));
    let earlier = is_earlier.then(|| (layout, format!("the earlier files are kept as {names}")));
    let former = if is_earlier { earlier::ledgers(directory, machine).to_vec() } else { Vec::new() };
    let paths = (document, number::path(directory, machine));
    let doubts = (is_in_question, is_of_a_later_version);
    let file = StoreFile::new(Arc::clone(disk), paths, seal, (aside, former), doubts);
    Opened { found, earlier, is_first, file }
}

impl Content {
    /// Marks the content as saved by a run that did not end in the usual way. Its last writes may still arrive at a
    /// register.
    pub(super) fn not_in_order(mut self) -> Content {
        self.outputs.values_mut().for_each(|entry| entry.kept.in_order = false);
        self
    }
}

fn find_documents(disk: &dyn Disk, directory: &Path, machine: &str) -> FoundDocuments {
    let document = path(directory, machine);
    let read = read(disk, &document, |bytes| document::read(bytes, machine));
    let (seal, content) = match read {
        Ok(None) | Err(DocumentRejection::Earlier(_)) => {
            return earlier::find_documents(disk, directory, machine);
        }
        Ok(Some((seal, content))) => (Some(seal), Ok(Some(content))),
        Err(unfit) => (None, Err(unfit)),
    };
    FoundDocuments { files: vec![(document, "")], layout: VERSION, seal, content }
}

/// Reads a file, and parses its content with `of`. Returns `None` if the file does not exist.
fn read<T>(
    disk: &dyn Disk,
    path: &Path,
    of: impl FnOnce(&[u8]) -> Result<T, DocumentRejection>,
) -> Result<Option<T>, DocumentRejection> {
    match disk.read(path) {
        Ok(bytes) => of(&bytes).map(Some),
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
        Err(error) => Err(DocumentRejection::Because(system(&error))),
    }
}

/// Returns the path `first` if no such file exists. Otherwise, appends the smallest number with which no such
/// file exists, from 2 on.
fn free(disk: &dyn Disk, first: PathBuf) -> PathBuf {
    let numbered = |number: u32| match number {
        1 => first.clone(),
        number => first.with_added_extension(number.to_string()),
    };
    // An endless series contains a free path.
    (1..).map(numbered).find(|path| !disk.has(path)).unwrap_or(first.clone())
}

/// Checks that a gateway may start with the content of its state directory.
///
/// # Errors
/// A later version of isotherm has written the content, or every user may write to it. The error is a sentence with the
/// remedy.
pub(in crate::gateway) fn may_start(disk: &dyn Disk, directory: &Path, machine: &str) -> Result<(), String> {
    let document = path(directory, machine);
    let [ledger, begun] = earlier::ledgers(directory, machine);
    for path in [directory, &document, &number::path(directory, machine), &ledger, &begun] {
        refuse_what_others_may_write(path)?;
    }
    match read(disk, &document, |bytes| document::read(bytes, machine)) {
        Err(DocumentRejection::Later(found)) => Err(format!(
            "the saved state {} was written by a later version of this program (layout {found}; this \
             program reads layouts up to {VERSION}). Run that version, or move the file away and let the \
             operator arm the axes",
            document.display()
        )),
        _ => Ok(()),
    }
}

/// Flag that the saved state is in question: it may not be the last state of the machine. Arming by an operator
/// clears the flag. The writer and the axes share the flag.
#[derive(Clone, Debug, Default)]
pub(in crate::gateway) struct OpenQuestion(Arc<AtomicBool>);

impl OpenQuestion {
    pub(in crate::gateway) fn is_open(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    pub(in crate::gateway) fn open(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Clears the flag, because an operator has armed an axis.
    pub(in crate::gateway) fn close(&self) {
        self.0.store(false, Ordering::Relaxed);
    }
}
