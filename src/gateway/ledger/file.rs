//! The ledger's file: one JSON document beside the state, [sealed](crate::gateway::sealed) as it is: a bit that fell over
//! is not believed to be anybody's part.

use isotherm_core::quantity::Counts;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::gateway::sealed::pair::{BEGUN, Opened};
use crate::gateway::sealed::{Found, SealedFile, checksum};
use isotherm_core::output::Kept;
use isotherm_profile::{Output, Profile};

/// More counts than any register holds: who says more does not speak of one of ours.
const MOST: u64 = 1 << 40;

/// One of the second layout, which had a seal of its own.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Second {
    version: u32,
    seal: SecondSeal,
    outputs: Entries,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SecondSeal {
    number: u64,
    checksum: String,
}

/// What is kept, by output.
pub(in crate::gateway) type Entries = BTreeMap<String, Entry>;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::gateway) struct Entry {
    /// Which register it speaks of, and what a count is worth there.
    pub(in crate::gateway) register: String,
    pub(in crate::gateway) kept: Kept,
}

/// Where it is kept.
#[derive(Debug)]
pub(super) struct LedgerFile(SealedFile);

impl LedgerFile {
    /// The file of a machine, and what it says; `None` where there is none, a sentence where it cannot be used.
    pub(super) fn open(opened: Opened) -> (LedgerFile, Result<Option<Entries>, String>) {
        let Opened { found, file, is_begun, .. } = opened;
        let read = found.and_then(|found| {
            let entries = found.map(entries).transpose();
            entries.map_err(|why| file.is_not_believed(&why))
        });
        let read = read.map(|entries| {
            entries.map(|mut entries| {
                // What a run left that could write nothing when it began.
                entries.values_mut().for_each(|entry| entry.kept.in_order &= !is_begun);
                entries
            })
        });
        (LedgerFile(file), read)
    }

    /// The file says no more that a run ended in order, although nothing can be written: it has another name now, under
    /// which it is still found.
    pub(super) fn is_marked_begun(&self) -> bool {
        let (disk, path) = (self.0.disk(), self.0.path());
        disk.rename(path, &path.with_extension(BEGUN)).is_ok() || !disk.has(path)
    }

    /// Puts the entries on disk: they are there when this returns.
    pub(super) fn save(&mut self, entries: &Entries) -> std::io::Result<()> {
        self.0.save(entries)?;
        self.0.disk().forget(&self.0.path().with_extension(BEGUN));
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

fn entries(found: Found) -> Result<Entries, String> {
    let entries: Entries = match found {
        Found::Sealed(_, content) => serde_json::from_value(content).map_err(|error| error.to_string())?,
        Found::Earlier(_, bytes) => earlier(&bytes)?,
    };
    match entries.iter().find(|(_, entry)| !all_fit(&entry.kept)) {
        Some((name, _)) => Err(format!("no register holds as many counts as it says of {name}")),
        None => Ok(entries),
    }
}

fn earlier(bytes: &[u8]) -> Result<Entries, String> {
    let Second { version, seal, outputs } =
        serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
    let sealed = serde_json::to_vec(&(version, seal.number, &outputs)).map_err(|error| error.to_string())?;
    if version != 2 || seal.checksum != checksum(&sealed) {
        return Err("its checksum does not fit: it was changed, or damaged".to_owned());
    }
    Ok(outputs)
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
