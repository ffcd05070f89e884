//! Backup of the state of a machine: the state document is copied while the gateway runs, and can be restored to a
//! state directory. The module [`products`] copies the files of learning.
//!
//! A backup does not contain the values that the gateway wrote after the backup. Therefore a restored state is "in
//! question": every axis is off until an operator arms it. Until then, the whole value of a shared register counts as
//! the operator offset.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::Path;

use super::disk::{Disk, Files};
use super::documents::document::{Seal, read, render};
use super::documents::{Content, number, path};
use isotherm_core::output::{Doubt, SavedOutput};
use serde_json::Value;

pub mod products;

/// Returns name and content of the state document, or `None` if nothing has been saved yet.
///
/// # Errors
/// The document cannot be read. The error is a sentence.
pub fn take(directory: &Path, machine: &str) -> Result<Option<(String, Vec<u8>)>, String> {
    let path = path(directory, machine);
    match Files.read(&path) {
        Ok(bytes) => Ok(Some((file_name(machine), bytes))),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(format!("{} cannot be read: {error}", path.display())),
    }
}

/// Returns whether a directory contains the saved state of this machine.
pub fn is_in(directory: &Path, machine: &str) -> bool {
    path(directory, machine).exists()
}

/// Converts the files of a backup to the files that are written to a state directory. In these files, the
/// saved state is marked as in question.
///
/// # Errors
/// A file is not a state document of this machine, or the directory contains a newer document. The error is a
/// sentence.
pub fn put_back(
    directory: &Path,
    machine: &str,
    files: &[(String, Vec<u8>)],
) -> Result<Vec<(String, Vec<u8>)>, String> {
    files.iter().map(|(name, bytes)| one_put_back(directory, machine, name, bytes)).collect()
}

fn one_put_back(
    directory: &Path,
    machine: &str,
    name: &str,
    bytes: &[u8],
) -> Result<(String, Vec<u8>), String> {
    let wrong = |why: String| format!("{name} of the backup is rejected: {why}");
    if name != file_name(machine) {
        return Err(wrong(format!(
            "the file is not a state of {machine} that this version can read: restore it with the version \
             that created it"
        )));
    }
    let (seal, content) = read(bytes, machine).map_err(|unfit| wrong(unfit.to_string()))?;
    let path = path(directory, machine);
    let remedy = "restore into another directory (--state DIR), or first move NAME.state.json and \
                  NAME.number of the machine away";
    let there = match Files.read(&path) {
        Err(error) if error.kind() == ErrorKind::NotFound => None,
        Err(error) => return Err(format!("{} cannot be read: {error}", path.display())),
        Ok(bytes) => Some(read(&bytes, machine).map(|(there, _)| (there.since, there.number)).ok()),
    };
    let (_, numbered) = number::read_number(&Files, directory, machine);
    let numbered = numbered.transpose().map(|number| number.map(|known| (known.since, known.number)).ok());
    for known in [there, numbered].into_iter().flatten() {
        match known {
            Some((since, number)) if since == seal.since && number <= seal.number => {}
            Some((since, number)) if since == seal.since => {
                return Err(format!(
                    "{} is newer than the backup (save number {number}, but {} in the backup): {remedy}",
                    path.display(),
                    seal.number
                ));
            }
            _ => {
                return Err(format!(
                    "{} belongs to another series of saved states of this machine, or is damaged: {remedy}",
                    path.display()
                ));
            }
        }
    }
    // Another directory has no number file for this document.
    let seal = Seal { in_question: true, named: 0, ..seal };
    let document = doubted(&seal, content).map_err(|error| wrong(error.to_string()))?;
    Ok((name.to_owned(), document))
}

/// Creates a document in which the whole value of a shared register counts as the operator offset, until the operator
/// confirms the value. Registers that are not shared are treated as after a kill. The records of former registers are
/// removed, because another program may use these registers now.
fn doubted(seal: &Seal, content: Content) -> std::io::Result<Vec<u8>> {
    let Content { mut state, mut outputs } = content.not_in_order();
    let places = state.as_mut().and_then(|state| state.get_mut("places")).and_then(Value::as_object_mut);
    places.into_iter().for_each(|places| places.retain(|key, _| key != "kept" && key != "releases"));
    for entry in outputs.values_mut().filter(|entry| entry.kept.account.is_some()) {
        entry.kept = SavedOutput::in_question(Doubt::Restored);
    }
    let outputs = outputs.iter().map(|(name, entry)| Ok((name.clone(), serde_json::to_vec(entry)?)));
    let outputs: BTreeMap<String, Vec<u8>> = outputs.collect::<serde_json::Result<_>>()?;
    render(seal, &serde_json::to_vec(&state)?, &outputs)
}

fn file_name(machine: &str) -> String {
    path(Path::new(""), machine).display().to_string()
}
