//! The ledger's file: one JSON document beside the state, sealed, replaced atomically and synced.
//!
//! The seal is a number that grows with every writing and a checksum of all the rest: a bit that fell over is not
//! believed to be anybody's part.

use isotherm_core::quantity::Counts;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::gateway::disk::Disk;
use isotherm_core::output::Kept;
use isotherm_profile::{Output, Profile};

/// The layout of the file.
const VERSION: u32 = 2;
/// More counts than any register holds: who says more does not speak of one of ours.
const MOST: u64 = 1 << 40;
/// What the name ends with of one that could not be written when a run began.
const BEGUN: &str = "begun.json";
/// CRC-32 as in Ethernet and gzip (ITU-T V.42).
const CHECKSUM: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    version: u32,
    seal: Seal,
    outputs: Entries,
}

/// Of a document of any layout.
#[derive(Deserialize)]
struct Versioned {
    version: u32,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Seal {
    number: u64,
    checksum: String,
}

/// What is kept, by output.
pub(super) type Entries = BTreeMap<String, Entry>;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Entry {
    /// Which register it speaks of, and what a count is worth there.
    pub(super) register: String,
    pub(super) kept: Kept,
}

/// Where it is kept.
#[derive(Debug)]
pub(super) struct LedgerFile {
    disk: Arc<dyn Disk>,
    path: PathBuf,
    /// Of the last writing.
    number: u64,
    /// The file that stands there cannot be used: it is kept aside before it is replaced.
    is_spoilt: bool,
}

impl LedgerFile {
    /// The file of a machine in a state directory, and what it says; `None` where there is none, a sentence where it
    /// cannot be used.
    pub(super) fn open(
        disk: Arc<dyn Disk>,
        directory: &Path,
        profile: &Profile,
    ) -> (LedgerFile, Result<Option<Entries>, String>) {
        let path = directory.join(format!("{}.ledger.json", profile.name));
        let mut read = read(&*disk, &path);
        if let Ok(None) = read {
            read = begun(&*disk, &path);
        }
        let (number, read) = match read {
            Ok(found) => {
                (found.as_ref().map_or(0, |(number, _)| *number), Ok(found.map(|(_, entries)| entries)))
            }
            Err(why) => (0, Err(format!("{} cannot be used: {why}", path.display()))),
        };
        (LedgerFile { disk, path, number, is_spoilt: read.is_err() }, read)
    }

    /// The file says no more that a run ended in order, although nothing can be written: it has another name now, under
    /// which it is still found.
    pub(super) fn is_marked_begun(&self) -> bool {
        self.disk.rename(&self.path, &self.path.with_extension(BEGUN)).is_ok() || !self.disk.has(&self.path)
    }

    /// Puts the entries on disk: they are there when this returns.
    pub(super) fn save(&mut self, entries: &Entries) -> std::io::Result<()> {
        if self.is_spoilt {
            // A copy: between two renames there would be no file at all, which means that nothing is ours.
            match self.disk.copy(&self.path, &self.path.with_extension("json.bad")) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                _ => self.is_spoilt = false,
            }
        }
        let number = self.number + 1;
        let seal = Seal { number, checksum: checksum(number, entries)? };
        let document = Document { version: VERSION, seal, outputs: entries.clone() };
        let mut text = serde_json::to_vec_pretty(&document).map_err(std::io::Error::other)?;
        text.push(b'\n');
        self.disk.replace(&self.path, &text)?;
        self.number = number;
        self.disk.forget(&self.path.with_extension(BEGUN));
        Ok(())
    }
}

/// What the entries of an output must speak of to be its own.
pub(super) fn register(profile: &Profile, output: &Output) -> String {
    let encoding = &output.encoding;
    let device = &profile.device(output.device).name;
    format!(
        "{} of {device}, {} {}{}, {} per count, bias {}",
        output.address,
        encoding.data_type.name(),
        encoding.word_order,
        if encoding.byte_swap { " byte-swapped" } else { "" },
        encoding.scale.get(),
        encoding.bias
    )
}

fn checksum(number: u64, entries: &Entries) -> std::io::Result<String> {
    let bytes = serde_json::to_vec(&(VERSION, number, entries)).map_err(std::io::Error::other)?;
    Ok(format!("{:08x}", CHECKSUM.checksum(&bytes)))
}

/// What a run left that could write nothing when it began.
fn begun(disk: &dyn Disk, path: &Path) -> Result<Option<(u64, Entries)>, String> {
    let found = read(disk, &path.with_extension(BEGUN))?;
    Ok(found.map(|(number, mut entries)| {
        entries.values_mut().for_each(|entry| entry.kept.in_order = false);
        (number, entries)
    }))
}

fn read(disk: &dyn Disk, path: &Path) -> Result<Option<(u64, Entries)>, String> {
    let text = match disk.read(path) {
        Ok(text) => text,
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            return Ok(None);
        }
        Err(error) => return Err(error.to_string()),
    };
    let Versioned { version } = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    if version != VERSION {
        return Err(format!("it has version {version}, this program writes {VERSION}"));
    }
    let document: Document = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    let (number, entries) = (document.seal.number, document.outputs);
    if document.seal.checksum != checksum(number, &entries).map_err(|error| error.to_string())? {
        return Err("its checksum does not fit: it was changed, or damaged".to_owned());
    }
    match entries.iter().find(|(_, entry)| !all_fit(&entry.kept)) {
        Some((name, _)) => Err(format!("no register holds as many counts as it says of {name}")),
        None => Ok(Some((number, entries))),
    }
}

/// So many counts can stand in a register of ours.
pub(super) fn fits(counts: Counts) -> bool {
    counts.unsigned_abs() <= MOST
}

fn all_fit(kept: &Kept) -> bool {
    let account = kept.account.iter().flat_map(|account| [account.base, account.share]);
    let promises = kept.promises.iter().map(|promise| promise.value);
    account.chain(promises).chain(kept.stood).all(fits)
}
