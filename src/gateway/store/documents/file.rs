//! Files of the state document and of its save number. Each save converts only the changed parts to JSON.

use std::collections::BTreeMap;
use std::io::{Error, ErrorKind, Result};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde::Serialize;

use super::OpenQuestion;
use super::document::{Seal, render};
use super::entry::Entry;
use super::number::{self, Number};
use crate::gateway::store::disk::Disk;

/// File of the state document, and file of its save number.
pub(in crate::gateway) struct StoreFile {
    disk: Arc<dyn Disk>,
    document: PathBuf,
    number: PathBuf,
    /// Seal (checksum, origin and save number) of the document that is on disk.
    pub(super) seal: Seal,
    question: OpenQuestion,
    /// State and outputs as JSON. `state` is empty until a state is saved for the first time.
    state: Vec<u8>,
    outputs: BTreeMap<String, Vec<u8>>,
    /// Files that get a second name (hard link) before the document is replaced: path and second name.
    aside: Vec<(PathBuf, PathBuf)>,
    /// Files of an earlier version of isotherm, which are removed after the first save.
    former: Vec<PathBuf>,
    /// Whether the next save must also write the save number to `NAME.number`.
    is_number_due: bool,
    /// Whether a later version of isotherm has written the document on disk. Such a document is never replaced.
    is_of_a_later_version: bool,
}

impl StoreFile {
    /// Creates the files of a run that has not saved anything yet. `aside`: files that get a second name before
    /// the first save. `former`: files that are removed after the first save.
    pub(super) fn new(
        disk: Arc<dyn Disk>,
        (document, number): (PathBuf, PathBuf),
        seal: Seal,
        (aside, former): (Vec<(PathBuf, PathBuf)>, Vec<PathBuf>),
        (is_in_question, is_of_a_later_version): (bool, bool),
    ) -> StoreFile {
        StoreFile {
            disk,
            document,
            number,
            seal,
            question: OpenQuestion(Arc::new(AtomicBool::new(is_in_question))),
            state: Vec::new(),
            outputs: BTreeMap::new(),
            aside,
            former,
            is_number_due: true,
            is_of_a_later_version,
        }
    }

    /// Converts the state to JSON for the next save. The next save also writes the save number.
    pub(in crate::gateway) fn set_state(&mut self, state: &impl Serialize) {
        // Numbers and texts always have a JSON form.
        if let Ok(state) = serde_json::to_vec(state) {
            (self.state, self.is_number_due) = (state, true);
        }
    }

    /// Converts the register ledger's entry of an output (saved account of its register) to JSON for the next save.
    pub(in crate::gateway) fn set_output(&mut self, name: &str, entry: &Entry) {
        if let Ok(entry) = serde_json::to_vec(entry) {
            self.outputs.insert(name.to_owned(), entry);
        }
    }

    /// Saves the document. If the function returns no error, the document is on disk.
    pub(in crate::gateway) fn save(&mut self) -> Result<()> {
        if self.is_of_a_later_version {
            let text = format!("a later version of the program has written {}", self.document.display());
            return Err(Error::other(text));
        }
        while let Some((path, beside)) = self.aside.last() {
            match self.disk.keep(path, beside) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                _ => self.aside.pop(),
            };
        }
        let number = self.seal.number.saturating_add(1);
        let seal = Seal { number, in_question: self.question.is_open(), ..self.seal.clone() };
        self.disk.replace(&self.document, &render(&seal, &self.state, &self.outputs)?)?;
        self.seal = seal;
        self.former.drain(..).for_each(|path| self.disk.forget(&path));
        Ok(())
    }

    /// Writes the document's save number to `NAME.number`, if a state was saved or that file no longer exists.
    pub(in crate::gateway) fn save_number(&mut self) -> Result<()> {
        if self.is_number_due || !self.disk.has(&self.number) {
            self.is_number_due = true;
            let Seal { number, since, .. } = self.seal;
            self.disk.replace(&self.number, Number { number, since }.line().as_bytes())?;
            self.disk.forget(&number::begun(&self.number));
            (self.seal.named, self.is_number_due) = (number, false);
        }
        Ok(())
    }

    /// Renames the file `NAME.number`, because a run has begun that cannot save files. The files on disk
    /// would otherwise state that all writes have arrived at the registers. Returns true if the files no
    /// longer state this.
    pub(in crate::gateway) fn mark_begun(&self) -> bool {
        let begun = number::begun(&self.number);
        self.disk.rename(&self.number, &begun).is_ok()
            || self.disk.has(&begun)
            || !self.disk.has(&self.document)
    }

    pub(in crate::gateway) fn question(&self) -> OpenQuestion {
        self.question.clone()
    }
}
