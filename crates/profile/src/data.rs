//! The files beside a profile, as they are written: JSON with a format and a version, unknown keys refused. Each
//! becomes a type of the models, or a sentence that says why not; shapes are checked where they are used.

use serde::Deserialize;
use serde::de::DeserializeOwned;

pub(crate) mod envelope;
pub(crate) mod matrix;
pub mod network;

/// What every file begins with.
#[derive(Deserialize)]
struct Head {
    format: Option<String>,
    version: Option<u64>,
}

/// A file of this format, in the only version there is.
fn read<T: DeserializeOwned>(bytes: &[u8], format: &str) -> Result<T, String> {
    let head: Head = serde_json::from_slice(bytes).map_err(|why| format!("it is no JSON of ours: {why}"))?;
    match head.format {
        Some(found) if found == format => {}
        Some(found) => return Err(format!("its format is \"{found}\", and \"{format}\" is wanted here")),
        None => return Err(format!("it has no \"format\"; \"{format}\" is wanted here")),
    }
    match head.version {
        Some(1) => {}
        Some(other) => return Err(format!("its version is {other}; this program reads version 1")),
        None => return Err("it has no \"version\"; this program reads version 1".to_owned()),
    }
    serde_json::from_slice(bytes).map_err(|why| why.to_string())
}

/// What is wrong where a file's own names and the profile's do not fit each other: their number, or the same names in
/// another order. Other names are fine: a file may call things what it likes.
pub(crate) fn misfit(what: &str, own: &[String], given: &[&str]) -> Option<String> {
    let list = |names: &[&str]| names.join(", ");
    let names: Vec<&str> = own.iter().map(String::as_str).collect();
    if own.len() != given.len() {
        return Some(format!(
            "it has {} {what} ({}), the model names {}: {}",
            own.len(),
            list(&names),
            given.len(),
            list(given)
        ));
    }
    let sorted = |names: &[&str]| {
        let mut names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        names.sort();
        names
    };
    (names != given && sorted(&names) == sorted(given)).then(|| {
        format!("its {what} are {}, and the model names them in another order: {}", list(&names), list(given))
    })
}
