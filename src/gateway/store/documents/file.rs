//! State document on disk. Each save renders only the parts that have changed.

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

/// Files of the state document and of its number.
pub(in crate::gateway) struct StoreFile {
    disk: Arc<dyn Disk>,
    document: PathBuf,
    number: PathBuf,
    /// Seal (checksum, origin and save number) of the document that is on disk.
    pub(super) seal: Seal,
    question: OpenQuestion,
    /// State and outputs as JSON. The state is empty until it is saved for the first time.
    state: Vec<u8>,
    outputs: BTreeMap<String, Vec<u8>>,
    /// Files that are renamed before the document is replaced, so that they are not lost: old path and new path.
    aside: Vec<(PathBuf, PathBuf)>,
    /// Files of an earlier version of isotherm, which are removed after the first save.
    former: Vec<PathBuf>,
    /// Whether the number is saved with the next document.
    is_number_due: bool,
    /// Whether the document on disk is of a later version of isotherm. It is then never replaced.
    is_of_a_later_version: bool,
}

impl StoreFile {
    /// Creates the files of a run that has not saved anything yet. `aside`: files to rename before the first save.
    /// `former`: files to remove after the first save.
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

    /// Renders the state for the next save, which also saves the number.
    pub(in crate::gateway) fn set_state(&mut self, state: &impl Serialize) {
        // Numbers and texts always have a JSON form.
        if let Ok(state) = serde_json::to_vec(state) {
            (self.state, self.is_number_due) = (state, true);
        }
    }

    /// Renders the register ledger's entry of an output (saved account of its register) for the next save.
    pub(in crate::gateway) fn set_output(&mut self, name: &str, entry: &Entry) {
        if let Ok(entry) = serde_json::to_vec(entry) {
            self.outputs.insert(name.to_owned(), entry);
        }
    }

    /// Saves the document. When the function returns without an error, the document is on disk.
    pub(in crate::gateway) fn save(&mut self) -> Result<()> {
        if self.is_of_a_later_version {
            let text = format!("{} is of a later version of the program", self.document.display());
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

    /// Saves the number of the document to `NAME.number`, if a state was saved or that file was removed.
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

    /// Renames the file `NAME.number`, as a mark that a run has begun although it can write nothing. Returns whether
    /// the files on disk no longer claim that all writes of the previous run have arrived.
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
