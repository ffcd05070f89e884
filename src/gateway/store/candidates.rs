//! Candidates of learned models, which `isotherm learn` writes for the gateway: one file for each axis, next to the
//! products of its runs.
//!
//! ```text
//! NAME.products/z.candidate.json  { "format": "isotherm-candidate", "version": 1, "sha256": "…", "offer": {…} }
//! ```
//!
//! The gateway reads the file and writes nothing. The gateway rejects a file that is damaged or was changed; the axis
//! then has no candidate. An adopted model does not depend on this file, because it is part of the saved state.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::disk::Disk;
use crate::fieldbus::explain::system;
use isotherm_core::candidate::Offer;
use isotherm_profile::sha256;

const FORMAT: &str = "isotherm-candidate";
const VERSION: u64 = 1;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    version: u64,
    /// SHA-256 of the JSON text of the field `offer`, without spaces.
    sha256: String,
    offer: Offer,
}

/// Returns the directory with the products (results) of the runs of a machine.
pub fn products(directory: &Path, machine: &str) -> PathBuf {
    directory.join(format!("{machine}.products"))
}

/// Returns the path of the file with the candidate of an axis.
pub fn path(directory: &Path, machine: &str, axis: &str) -> PathBuf {
    products(directory, machine).join(format!("{axis}.candidate.json"))
}

fn seal(offer: &Offer) -> Result<String, String> {
    serde_json::to_vec(offer).map(|bytes| sha256(&bytes)).map_err(|why| why.to_string())
}

/// Reads the candidate of an axis. Returns `None` if the file does not exist.
///
/// # Errors
/// The file cannot be read, is damaged, or belongs to another axis. The error is a sentence.
pub fn read(
    disk: &dyn Disk,
    (directory, machine): (&Path, &str),
    axis: &str,
) -> Result<Option<Offer>, String> {
    let path = path(directory, machine, axis);
    let bytes = match disk.read(&path) {
        Ok(bytes) => bytes,
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            return Ok(None);
        }
        Err(error) => return Err(format!("{} cannot be read: {}", path.display(), system(&error))),
    };
    parse(&bytes, axis).map(Some).map_err(|why| format!("{} is rejected: {why}", path.display()))
}

fn parse(bytes: &[u8], axis: &str) -> Result<Offer, String> {
    let file: File =
        serde_json::from_slice(bytes).map_err(|why| format!("the file is not a candidate file: {why}"))?;
    if file.format != FORMAT || file.version != VERSION {
        return Err(format!("the file is not a candidate file of version {VERSION}"));
    }
    if file.sha256 != seal(&file.offer)? {
        return Err("the checksum is wrong: the file was changed or damaged".to_owned());
    }
    if file.offer.axis != axis {
        return Err(format!("the file is the candidate of axis {}", file.offer.axis));
    }
    Ok(file.offer)
}

/// Writes the candidate of an axis. `None` removes the file.
///
/// # Errors
/// The file cannot be written. The error is a sentence.
pub fn write(
    disk: &dyn Disk,
    (directory, machine): (&Path, &str),
    axis: &str,
    offer: Option<&Offer>,
) -> Result<(), String> {
    let path = path(directory, machine, axis);
    let Some(offer) = offer else {
        disk.forget(&path);
        return Ok(());
    };
    let (sha256, offer) = (seal(offer)?, offer.clone());
    let file = File { format: FORMAT.to_owned(), version: VERSION, sha256, offer };
    let bytes = serde_json::to_vec(&file).map_err(|why| why.to_string())?;
    disk.replace(&path, &bytes).map_err(|error| format!("{} cannot be written: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gateway::store::disk::Files;
    use isotherm_core::candidate::{JudgedDay, Judgement, OfferedTerm};
    use isotherm_core::quantity::Moment;

    fn offer() -> Offer {
        let mut judgement = Judgement::default();
        let begins = Moment::from_nanos(1_769_000_000_000_000_000);
        assert!(judgement.judge(JudgedDay { begins, touches: 8, in_use: 48.3, candidate: 14.1 }));
        let term = OfferedTerm { signal: "bed".to_owned(), lag_s: 360.0, squared: false, gain: 0.1 + 0.2 };
        Offer {
            axis: "z".to_owned(),
            name: "learned-2026-01-31-3fa2".to_owned(),
            runs: 5,
            terms: vec![term],
            judgement,
            compared_with: None,
            own: "5f0c".to_owned(),
        }
    }

    #[test]
    fn a_candidate_is_read_as_it_was_written_and_a_changed_one_is_rejected() {
        let home = tempfile::tempdir().unwrap();
        let place = (home.path(), "mill");
        assert_eq!(read(&Files, place, "z"), Ok(None), "no directory");
        write(&Files, place, "z", Some(&offer())).unwrap();
        assert_eq!(read(&Files, place, "z"), Ok(Some(offer())));
        assert_eq!(read(&Files, place, "x"), Ok(None));

        let path = path(home.path(), "mill", "z");
        let text = std::fs::read_to_string(&path).unwrap();
        for (from, to, words) in [
            ("\"runs\":5", "\"runs\":6", "checksum is wrong"),
            ("\"version\":1", "\"version\":2", "not a candidate file of version 1"),
            ("isotherm-candidate", "isotherm-products", "not a candidate"),
            ("{\"format\"", "{\"forma\"", "the file is not a candidate file: "),
        ] {
            assert!(text.contains(from), "{text}");
            std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
            let why = read(&Files, place, "z").unwrap_err();
            assert!(why.contains(words), "`{words}` is not in: {why}");
        }
        std::fs::write(path.with_file_name("x.candidate.json"), &text).unwrap();
        assert!(read(&Files, place, "x").unwrap_err().contains("the candidate of axis z"));
        write(&Files, place, "z", None).unwrap();
        assert_eq!(read(&Files, place, "z"), Ok(None));
    }
}
