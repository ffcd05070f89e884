//! Learning record of an axis: the results of the days on which a candidate was compared with the model in use. A
//! checksum protects its file.

use serde::{Deserialize, Serialize};

use isotherm_core::candidate::Judgement;
use isotherm_core::quantity::Moment;
use isotherm_profile::sha256;

const FORMAT: &str = "isotherm-learning";
const VERSION: u64 = 1;

/// Learning record: the results of the compared days, and the models that were compared.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Record {
    /// SHA-256 of the model that was in use on the compared days.
    pub(super) in_use: String,
    /// SHA-256 of the candidate that was offered to the gateway after the last run. Empty if no candidate was offered.
    pub(super) offered: String,
    pub(super) judgement: Judgement,
    /// Time of the last log row of the processed runs with touches. Runs with touches whose datum (zero
    /// point) is before this time are not processed again.
    pub(super) until: Moment,
    /// Number of runs whose products are stored.
    pub(super) runs: usize,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    version: u64,
    /// SHA-256 of `record` as JSON without spaces.
    sha256: String,
    record: Record,
}

impl Record {
    /// Returns the content of the file with the learning record: JSON with a checksum.
    ///
    /// # Errors
    /// Returns a message if a number cannot be written as JSON.
    pub(super) fn to_json(&self) -> Result<String, String> {
        let record = self.clone();
        let file = File { format: FORMAT.to_owned(), version: VERSION, sha256: seal(&record)?, record };
        serde_json::to_string(&file).map_err(|why| why.to_string())
    }
}

fn seal(record: &Record) -> Result<String, String> {
    serde_json::to_vec(record).map(|bytes| sha256(&bytes)).map_err(|why| why.to_string())
}

/// Reads the content of the file with the learning record, and verifies its checksum.
///
/// # Errors
/// Returns a message if the file is invalid or was changed.
pub(super) fn read_record(bytes: &[u8]) -> Result<Record, String> {
    let file: File = serde_json::from_slice(bytes).map_err(|why| format!("not a learning record: {why}"))?;
    if file.format != FORMAT || file.version != VERSION {
        return Err(format!("the file is not a learning record of version {VERSION}"));
    }
    if file.sha256 != seal(&file.record)? {
        return Err("the checksum is wrong: the file was changed or damaged".to_owned());
    }
    Ok(file.record)
}
