//! State of a machine, taken out of its directory while a gateway writes there, and put back into one.
//!
//! A backup is of another day, and nobody knows what was written since. The state comes back in question: every axis is off
//! until a person arms, and before that no share of a register that an operator writes to is taken to be ours.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::Path;

use super::disk::{Disk, Files};
use super::store::document::{Seal, read, render};
use super::store::{Content, number, path};
use isotherm_core::output::{Doubt, Kept};
use serde_json::Value;

/// Name and bytes of the document; none if nothing was kept yet.
///
/// # Errors
/// A sentence: it cannot be read.
pub fn take(directory: &Path, machine: &str) -> Result<Option<(String, Vec<u8>)>, String> {
    let path = path(directory, machine);
    match Files.read(&path) {
        Ok(bytes) => Ok(Some((file_name(machine), bytes))),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(format!("{} cannot be read: {error}", path.display())),
    }
}

/// Files to be put into a directory for these of a backup, in question.
///
/// # Errors
/// A sentence: one of them is no document of this machine, or the directory has a newer one.
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
    let wrong = |why: String| format!("{name} of the backup is not believed: {why}");
    if name != file_name(machine) {
        return Err(wrong(format!(
            "it is no state of {machine} that this program reads: restore it with the version that made it"
        )));
    }
    let (seal, content) = read(bytes, machine).map_err(|unfit| wrong(unfit.to_string()))?;
    let path = path(directory, machine);
    let remedy = "restore into another directory (--state DIR), or move state and number away together";
    let there = match Files.read(&path) {
        Err(error) if error.kind() == ErrorKind::NotFound => None,
        Err(error) => return Err(format!("{} cannot be read: {error}", path.display())),
        Ok(bytes) => Some(read(&bytes, machine).map(|(there, _)| (there.since, there.number)).ok()),
    };
    let (_, numbered) = number::look(&Files, directory, machine);
    let numbered = numbered.transpose().map(|number| number.map(|known| (known.since, known.number)).ok());
    for known in [there, numbered].into_iter().flatten() {
        match known {
            Some((since, number)) if since == seal.since && number <= seal.number => {}
            Some((since, number)) if since == seal.since => {
                return Err(format!(
                    "{} is newer than the backup (its number is {number}, not {}): {remedy}",
                    path.display(),
                    seal.number
                ));
            }
            _ => {
                return Err(format!(
                    "{} is not of the same machine's history, or not whole: {remedy}",
                    path.display()
                ));
            }
        }
    }
    // Another directory has no number of it.
    let seal = Seal { in_question: true, named: 0, ..seal };
    let document = doubted(&seal, content).map_err(|error| wrong(error.to_string()))?;
    Ok((name.to_owned(), document))
}

/// Document in which no share is ours before a person says so, and a whole register waits as after a kill. What was known of former
/// registers may be another's since.
fn doubted(seal: &Seal, content: Content) -> std::io::Result<Vec<u8>> {
    let Content { mut state, mut outputs } = content.not_in_order();
    let places = state.as_mut().and_then(|state| state.get_mut("places")).and_then(Value::as_object_mut);
    places.into_iter().for_each(|places| places.retain(|key, _| key != "kept" && key != "releases"));
    for entry in outputs.values_mut().filter(|entry| entry.kept.account.is_some()) {
        entry.kept = Kept::in_question(Doubt::Restored);
    }
    let outputs = outputs.iter().map(|(name, entry)| Ok((name.clone(), serde_json::to_vec(entry)?)));
    let outputs: BTreeMap<String, Vec<u8>> = outputs.collect::<serde_json::Result<_>>()?;
    render(seal, &serde_json::to_vec(&state)?, &outputs)
}

fn file_name(machine: &str) -> String {
    path(Path::new(""), machine).display().to_string()
}
