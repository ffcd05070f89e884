//! Format of the state document: version, seal (checksum, origin and save number), state and outputs. Each output is
//! on a separate line of the file.

use std::fmt;
use std::io::{ErrorKind, Write};

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Content;
use super::entry::{Entries, misfit};
use isotherm_core::quantity::Moment;

/// Layout number of the documents that this program writes.
pub(super) const VERSION: u32 = 6;
/// Older layout number, which this program can still read. Such documents do not contain registers and addresses.
const WITHOUT_PLACES: u32 = 5;
/// CRC-32 as in Ethernet and gzip (ITU-T V.42).
const CHECKSUM: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);
/// Digits that replace the checksum in the document while the checksum is calculated.
const UNSEALED: &str = "00000000";
/// Key of the checksum in the document. No name can contain it, because a quotation mark in a name is escaped.
const KEY: &[u8] = b"\"checksum\":";

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    version: u32,
    seal: Seal,
    state: Option<Value>,
    outputs: Entries,
}

/// Version field of a document. Documents of every layout contain this field.
#[derive(Deserialize)]
struct Versioned {
    version: u32,
}

/// Seal of a document: checksum, origin and save number. It shows whether the document is damaged or an older copy;
/// see [`super`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::gateway) struct Seal {
    pub(in crate::gateway) checksum: String,
    pub(in crate::gateway) machine: String,
    pub(in crate::gateway) since: Moment,
    pub(in crate::gateway) number: u64,
    pub(in crate::gateway) named: u64,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(in crate::gateway) in_question: bool,
}

/// Reason why a document is rejected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::gateway) enum DocumentRejection {
    /// A later version of isotherm has written the document. The number is the layout of the document.
    Later(u32),
    /// An earlier version of isotherm has written the document. The number is the layout of the document.
    Earlier(u32),
    /// Another reason, as a part of a sentence.
    Because(String),
}

impl fmt::Display for DocumentRejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DocumentRejection::Later(found) => {
                write!(f, "the file has layout {found}, but this program reads layouts up to {VERSION}")
            }
            DocumentRejection::Earlier(found) => write!(
                f,
                "the file has the old layout {found}, which this version cannot read. Let the operator arm the \
                 axes, or first run an intermediate version, which converts the file"
            ),
            DocumentRejection::Because(why) => f.write_str(why),
        }
    }
}

/// Renders a document with its checksum. `state` and the outputs are already JSON.
pub(in crate::gateway) fn render<'a>(
    seal: &Seal,
    state: &[u8],
    outputs: impl IntoIterator<Item = (&'a String, &'a Vec<u8>)>,
) -> std::io::Result<Vec<u8>> {
    let seal = Seal { checksum: UNSEALED.to_owned(), ..seal.clone() };
    let mut text = format!("{{ \"version\": {VERSION},\n\"seal\": ").into_bytes();
    serde_json::to_writer(&mut text, &seal)?;
    text.extend(b",\n\"state\": ");
    text.extend(if state.is_empty() { b"null" } else { state });
    text.extend(b",\n\"outputs\": {");
    for (place, (name, entry)) in outputs.into_iter().enumerate() {
        text.extend(if place == 0 { &b"\n"[..] } else { b",\n" });
        serde_json::to_writer(&mut text, name)?;
        text.extend(b": ");
        text.extend(entry);
    }
    text.write_all(b"\n}}\n")?;
    let digits = digits(&text).ok_or(ErrorKind::InvalidData)?;
    let checksum = checksum(&text);
    text[digits..digits + UNSEALED.len()].copy_from_slice(checksum.as_bytes());
    Ok(text)
}

/// Reads a document of the present layout or of [`WITHOUT_PLACES`], and checks its seal (checksum and machine).
pub(in crate::gateway) fn read(bytes: &[u8], machine: &str) -> Result<(Seal, Content), DocumentRejection> {
    let Document { version, seal, state, outputs } = parse(bytes, VERSION)?;
    check(bytes, &seal.checksum, (&seal.machine, machine))?;
    match version {
        WITHOUT_PLACES..=VERSION => {}
        ..WITHOUT_PLACES => return Err(DocumentRejection::Earlier(version)),
        _ => return Err(DocumentRejection::Later(version)),
    }
    match misfit(&outputs) {
        Some(why) => Err(DocumentRejection::Because(why)),
        None => Ok((seal, Content { state, outputs })),
    }
}

/// Parses a document. If the document cannot be parsed, the error says why: a later layout than `version`, an earlier
/// layout, or damage.
pub(super) fn parse<'a, T: Deserialize<'a>>(bytes: &'a [u8], version: u32) -> Result<T, DocumentRejection> {
    if bytes.is_empty() {
        return Err(DocumentRejection::Because("the file is empty".to_owned()));
    }
    serde_json::from_slice(bytes).map_err(|_| match serde_json::from_slice(bytes) {
        Ok(Versioned { version: found }) if found > version => DocumentRejection::Later(found),
        Ok(Versioned { version: found }) if found < version => DocumentRejection::Earlier(found),
        _ => DocumentRejection::Because("the file is damaged or not a document of this program".to_owned()),
    })
}

/// Checks the checksum of a document, and that the document belongs to `machine`. `found` is the checksum in the
/// document.
pub(super) fn check(bytes: &[u8], found: &str, (of, machine): (&str, &str)) -> Result<(), DocumentRejection> {
    let mut unsealed = bytes.to_vec();
    let place = digits(bytes);
    if let Some(digits) = place.and_then(|place| unsealed.get_mut(place..place + UNSEALED.len())) {
        digits.copy_from_slice(UNSEALED.as_bytes());
    }
    match place.is_some() && found == checksum(&unsealed) {
        false => Err(DocumentRejection::Because(
            "the checksum is wrong: the file was changed or damaged".to_owned(),
        )),
        true if of != machine => {
            Err(DocumentRejection::Because(format!("the file belongs to another machine, {of}")))
        }
        true => Ok(()),
    }
}

/// Returns the CRC-32 as eight hexadecimal digits.
pub(super) fn checksum(bytes: &[u8]) -> String {
    format!("{:08x}", CHECKSUM.checksum(bytes))
}

/// Returns the offset of the first digit of the checksum. `None` if the document has no checksum.
fn digits(text: &[u8]) -> Option<usize> {
    let after = text.windows(KEY.len()).position(|window| window == KEY)? + KEY.len();
    let quote = text[after..].iter().position(|byte| *byte == b'"')?;
    Some(after + quote + 1)
}
