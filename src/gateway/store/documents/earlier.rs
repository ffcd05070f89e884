//! Documents of an earlier version of isotherm, which saved state and register ledger separately:
//! `NAME.state.json` of layout 4, and `NAME.ledger.json` of layout 3. Each document contains the last known
//! save number of the other document. Both documents are rejected if the save number of one is smaller than
//! the other document states.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::document::{DocumentRejection, Seal, check, parse};
use super::entry::{Entries, misfit};
use super::{Content, FoundDocuments, by_name, path, read};
use crate::gateway::store::disk::Disk;
use isotherm_core::quantity::Moment;

/// Layout numbers of the state file and of the register ledger's file.
const LAYOUTS: [u32; 2] = [4, 3];
const KINDS: [&str; 2] = ["state", "ledger"];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    version: u32,
    seal: FormerSeal,
    content: Value,
}

#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FormerSeal {
    checksum: String,
    kind: String,
    machine: String,
    since: Moment,
    number: u64,
    other: u64,
    #[serde(default)]
    in_question: bool,
}

/// Returns two possible paths of the register ledger's file. The second path was used after the start of a run that
/// could write nothing.
pub(super) fn ledgers(directory: &Path, machine: &str) -> [PathBuf; 2] {
    ["ledger.json", "ledger.begun.json"].map(|ending| directory.join(format!("{machine}.{ending}")))
}

/// Reads the state file and the register ledger's file, and compares the save numbers in them.
pub(super) fn find_documents(disk: &dyn Disk, directory: &Path, machine: &str) -> FoundDocuments {
    let [ledger, begun] = ledgers(directory, machine);
    let is_begun = !disk.has(&ledger) && disk.has(&begun);
    let paths = [path(directory, machine), if is_begun { begun } else { ledger }];
    let each = |place: usize| read(disk, &paths[place], |bytes| document(bytes, place, machine));
    let both = each(0).and_then(|state| Ok([state, each(1)?]));
    let seals: Vec<FormerSeal> =
        both.iter().flatten().flatten().map(|document| document.seal.clone()).collect();
    let seal = seals.first().map(|first| Seal {
        since: first.since,
        in_question: seals.iter().any(|seal| seal.in_question),
        ..Seal::default()
    });
    let content = both.and_then(|both| {
        let fitting = assess(&both).map_or(Ok(()), |why| Err(DocumentRejection::Because(why.to_owned())));
        fitting.and_then(|()| if seals.is_empty() { Ok(None) } else { content(both).map(Some) })
    });
    let content = content.map(|found| found.map(|found| if is_begun { found.not_in_order() } else { found }));
    let files = paths.into_iter().zip(["v4.json", "v3.json"]).collect();
    FoundDocuments { files, layout: LAYOUTS[0], seal, content }
}

fn document(bytes: &[u8], place: usize, machine: &str) -> Result<Document, DocumentRejection> {
    let document: Document = parse(bytes, LAYOUTS[place])?;
    check(bytes, &document.seal.checksum, (&document.seal.machine, machine))?;
    match document.seal.kind == KINDS[place] && document.version == LAYOUTS[place] {
        true => Ok(document),
        false => Err(DocumentRejection::Because(format!(
            "the file contains a {} instead of a {}",
            document.seal.kind, KINDS[place]
        ))),
    }
}

/// Returns a part of a sentence if the two documents do not match: one is missing, is an older copy, or comes from
/// another computer. `None` if they match.
fn assess(both: &[Option<Document>; 2]) -> Option<&'static str> {
    let seal = |place: usize| both[place].as_ref().map(|document| &document.seal);
    let number = |place: usize| seal(place).map_or(0, |seal| seal.number);
    let known = |place: usize| seal(1 - place).map_or(0, |seal| seal.other);
    match [seal(0), seal(1)] {
        [Some(state), Some(ledger)] if state.since != ledger.since => Some(
            "state file and register ledger in this directory do not match: one of them is a copy from \
             elsewhere",
        ),
        _ if number(0) < known(0) => Some(
            "the state file is older than the register ledger records, or is missing: a file was replaced by \
             an older copy",
        ),
        _ if number(1) < known(1) => Some(
            "the register ledger is older than the state file records, or is missing: a file was replaced by \
             an older copy",
        ),
        _ => None,
    }
}

fn content([state, ledger]: [Option<Document>; 2]) -> Result<Content, DocumentRejection> {
    let wrong = |why: serde_json::Error| DocumentRejection::Because(why.to_string());
    let outputs: Entries =
        ledger.map_or(Ok(Entries::new()), |ledger| serde_json::from_value(ledger.content)).map_err(wrong)?;
    if let Some(why) = misfit(&outputs) {
        return Err(DocumentRejection::Because(why));
    }
    let state = state.map(|state| {
        let mut content = state.content;
        let signals = content.as_object_mut().and_then(|content| content.remove("signals"));
        let signals: Vec<String> = serde_json::from_value(signals.unwrap_or(json!([]))).map_err(wrong)?;
        by_name(&mut content["machine"], &signals);
        Ok(content)
    });
    Ok(Content { state: state.transpose()?, outputs })
}
