//! State and ledger under a seal: what was changed, damaged, copied from another day or another machine is not believed.
//!
//! ```text
//! { "version": 4,
//!   "seal": { "checksum": "1c291ca3", "kind": "state", "machine": "grinder-1", "since": …, "number": 17, "other": 9 },
//!   "content": { … } }
//! ```
//!
//! - `checksum`: CRC-32 of every byte of the file, with its own digits as zeros.
//! - `since`: when the first of these documents was made here, the same in both; a copy from elsewhere has another.
//! - `number` grows with every writing; `other` is the number of the other document, as it was last seen.
//! - `in_question`: something did not fit, and no person has armed since.
//!
//! How the two are held against each other, and against the log: [`pair`].

use std::cmp::Ordering;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::disk::Disk;
use isotherm_core::quantity::Moment;

pub(super) mod named;
pub(super) mod pair;
#[cfg(test)]
pub(super) mod tests;

pub(super) use pair::{Pair, Which};

/// CRC-32 as in Ethernet and gzip (ITU-T V.42).
const CHECKSUM: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
/// What stands in its place while it is computed.
const UNSEALED: &str = "00000000";
/// What stands before it. No name in a document can hold this: a quotation mark in one is escaped.
const BEFORE: &str = "\"checksum\": \"";

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document<T> {
    version: u32,
    seal: Seal,
    content: T,
}

/// Of a document of any layout.
#[derive(Deserialize)]
struct Versioned {
    version: u32,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Seal {
    pub(super) checksum: String,
    pub(super) kind: Which,
    pub(super) machine: String,
    pub(super) since: Moment,
    pub(super) number: u64,
    pub(super) other: u64,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(super) in_question: bool,
}

/// What stands in the place of a document.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Found {
    /// It is whole.
    Sealed(Seal, Value),
    /// It has no seal of this kind yet: its layout, and its bytes.
    Earlier(u32, Vec<u8>),
}

/// Why a document is not believed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Unfit {
    /// A later version of the program has written it.
    Later(u32),
    /// A clause.
    Because(String),
}

/// The bytes of a document under its seal.
pub(super) fn seal(version: u32, seal: Seal, content: &impl Serialize) -> std::io::Result<Vec<u8>> {
    let seal = Seal { checksum: UNSEALED.to_owned(), ..seal };
    let mut text = serde_json::to_vec_pretty(&Document { version, seal, content })?;
    text.push(b'\n');
    let place = place(&text).ok_or(ErrorKind::InvalidData)?;
    let checksum = checksum(&text);
    text[place..place + UNSEALED.len()].copy_from_slice(checksum.as_bytes());
    Ok(text)
}

/// What these bytes are, to a program that writes this version.
pub(super) fn open(bytes: &[u8], (which, version): (Which, u32), machine: &str) -> Result<Found, Unfit> {
    let because = |why: &str| Err(Unfit::Because(why.to_owned()));
    if bytes.is_empty() {
        return because("it is empty");
    }
    let Ok(Document { version: found, seal, content }) = serde_json::from_slice::<Document<Value>>(bytes)
    else {
        return match serde_json::from_slice(bytes) {
            Ok(Versioned { version: found }) if found > version => Err(Unfit::Later(found)),
            Ok(Versioned { version: found }) if found < version => Ok(Found::Earlier(found, bytes.to_vec())),
            _ => because("it is damaged, or no document of this program"),
        };
    };
    let mut unsealed = bytes.to_vec();
    match place(bytes).and_then(|place| unsealed.get_mut(place..place + UNSEALED.len())) {
        Some(digits) => digits.copy_from_slice(UNSEALED.as_bytes()),
        None => return because("it is damaged"),
    }
    if seal.checksum != checksum(&unsealed) {
        return because("its checksum does not fit: it was changed, or damaged");
    }
    if seal.kind != which {
        return because(&format!("it is the {} under another name", seal.kind.name()));
    }
    if seal.machine != machine {
        return because(&format!("it is of another machine, {}", seal.machine));
    }
    match found.cmp(&version) {
        Ordering::Less => Ok(Found::Earlier(found, bytes.to_vec())),
        Ordering::Equal => Ok(Found::Sealed(seal, content)),
        Ordering::Greater => Err(Unfit::Later(found)),
    }
}

pub(super) fn checksum(bytes: &[u8]) -> String {
    format!("{:08x}", CHECKSUM.checksum(bytes))
}

fn place(text: &[u8]) -> Option<usize> {
    let before = BEFORE.as_bytes();
    text.windows(before.len()).position(|window| window == before).map(|place| place + before.len())
}

/// A document's place on disk.
#[derive(Debug)]
pub(super) struct SealedFile {
    disk: Arc<dyn Disk>,
    which: Which,
    version: u32,
    path: PathBuf,
    pair: Arc<Pair>,
    /// Under which name what stood there at the start is kept before it is replaced.
    aside: Option<(PathBuf, PathBuf)>,
    /// It is never replaced.
    is_of_a_later_version: bool,
}

impl SealedFile {
    /// Puts a document there: it is on disk when this returns.
    pub(super) fn save(&mut self, content: &impl Serialize) -> std::io::Result<()> {
        if self.is_of_a_later_version {
            let text = format!("{} is of a later version of the program", self.path.display());
            return Err(std::io::Error::other(text));
        }
        if let Some((found, aside)) = &self.aside {
            match self.disk.keep(found, aside) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                _ => self.aside = None,
            }
        }
        let next = self.pair.next(self.which);
        let document = seal(self.version, next.clone(), content)?;
        self.disk.replace(&self.path, &document)?;
        self.pair.is_on_disk(self.which, next.number);
        Ok(())
    }

    /// What its content says is nothing that can be: a sentence, and a person arms.
    pub(super) fn is_not_believed(&self, why: &str) -> String {
        self.pair.doubt();
        format!("the {} {} is not believed: {why}", self.which.name(), self.path.display())
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn disk(&self) -> &dyn Disk {
        &*self.disk
    }

    pub(super) fn pair(&self) -> &Arc<Pair> {
        &self.pair
    }
}
