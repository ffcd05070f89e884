//! Reads JSON files that belong to a model and are next to the profile. Each file states its format and version.
//! Unknown keys are rejected. The result is a value of the requested type, or a sentence that describes the mistake.
//! The caller checks the lengths of the lists in the file.

use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::seals::RawSeals;
use crate::file_kind::FileKind;
use crate::tables::KeyContext;

/// Keys that every file of a model has.
#[derive(Deserialize)]
struct Head {
    format: Option<String>,
    version: Option<u64>,
}

/// Parses a file of the format `format`, version 1. Returns a sentence if the file is invalid.
pub(super) fn read<T: DeserializeOwned>(bytes: &[u8], format: &str) -> Result<T, String> {
    // The parser's message may quote a file of another kind, so only the position is reported.
    let foreign = |why: serde_json::Error| {
        let other = FileKind::of(bytes).and_then(|kind| kind.instead_of(FileKind::Json));
        match other {
            Some(other) => format!("{}; a file in the format \"{format}\" is required", other.message),
            None => format!(
                "the file is not JSON in a format of isotherm (line {}, column {})",
                why.line(),
                why.column()
            ),
        }
    };
    let head: Head = serde_json::from_slice(bytes).map_err(foreign)?;
    match head.format {
        Some(found) if found == format => {}
        Some(found) => return Err(format!("the format is \"{found}\", but \"{format}\" is required")),
        None => return Err(format!("the file has no \"format\"; \"{format}\" is required")),
    }
    match head.version {
        Some(1) => serde_json::from_slice(bytes).map_err(|why| why.to_string()),
        Some(other) => Err(format!("the version of the file is {other}; this program reads version 1")),
        None => Err("the file has no \"version\"; this program reads version 1".to_owned()),
    }
}

/// Compares the number and the order of the names in a file (`own`) with the names in the profile (`given`). `what` is
/// the noun for messages, for example "inputs".
///
/// # Errors
/// The numbers of names differ, or the file has the same names in another order. A file with other names is accepted.
pub(super) fn fit(what: &str, own: &[String], given: &[&str]) -> Result<(), String> {
    let list = |names: &[&str]| names.join(", ");
    let names: Vec<&str> = own.iter().map(String::as_str).collect();
    if own.len() != given.len() {
        let (own, given_names, count) = (list(&names), list(given), given.len());
        return Err(format!(
            "the file has {} {what} ({own}), but the model names {count}: {given_names}",
            names.len()
        ));
    }
    let sorted = |names: &[&str]| {
        let mut names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        names.sort();
        names
    };
    if names != given && sorted(&names) == sorted(given) {
        let (own, given) = (list(&names), list(given));
        return Err(format!(
            "the {what} of the file are {own}, but the model names them in another order: {given}"
        ));
    }
    Ok(())
}

/// Reads the file that a key of the model names, and checks its SHA-256. `at` is the context of this key.
pub(super) fn bytes(seals: Option<&RawSeals>, key: &str, at: &KeyContext<'_>, name: &str) -> Option<Vec<u8>> {
    let bytes = at.file(name, "a relative path begins in the directory of the profile")?;
    seals.is_none_or(|seals| seals.fits(key, at, name, &bytes)).then_some(bytes)
}

/// Returns the parsed content of a file. If the content is invalid, reports the reason with the name of the file and
/// returns `None`.
pub(super) fn taken<T>(at: &KeyContext<'_>, name: &str, result: Result<T, String>) -> Option<T> {
    let report = |why| at.error(at.report.spans.at_value(&at.path, format!("{name}: {why}"), None));
    result.map_err(report).ok()
}
