//! What of the outputs must outlive the process: what may still appear in their registers, and whether the last run ended
//! in order. One JSON file in the state directory, replaced atomically.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::ledger::register;
use super::memory::Memory;
use super::saver::{Kept, Saver};
use crate::clock::Clock;
use crate::observe::events::{Event, Journal};
use crate::output;
use crate::profile::{Output, Profile};

/// The layout of the file.
const VERSION: u32 = 1;
/// The name of it in events.
const WHAT: &str = "what was sent last";
/// Where it cannot be kept.
const OTHERWISE: &str =
    "the next start waits until nothing from before it can arrive; what cannot be read is not written";

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    version: u32,
    outputs: Entries,
}

type Entries = BTreeMap<String, Entry>;

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    /// Which register it speaks of, and what a count is worth there.
    register: String,
    kept: output::Kept,
}

/// What of each output is on disk.
#[derive(Debug)]
pub(super) struct Promises {
    /// `None` without a directory: whoever runs a gateway that keeps nothing answers for what was there before.
    saver: Option<Saver<Entries>>,
    found: Entries,
    /// Nothing of ours has ever been in a register: no run has left anything here.
    is_first: bool,
    /// Nothing on disk says any more that a run ended in order.
    is_unmarked: bool,
}

impl Promises {
    /// What the last run of a machine has left.
    pub(super) fn open(
        profile: &Profile,
        directory: Option<&Path>,
        journal: Arc<Journal>,
        clock: &Clock,
    ) -> Promises {
        let Some(directory) = directory else {
            return Promises { saver: None, found: Entries::new(), is_first: true, is_unmarked: true };
        };
        let path = directory.join(format!("{}.outputs.json", profile.name));
        let is_first = !path.exists() && !Memory::path(directory, profile).exists();
        let found = read(&path).unwrap_or_else(|why| {
            let aside = path.with_extension("json.bad");
            let _ = std::fs::copy(&path, &aside);
            let why = format!(
                "{} cannot be used: {why}; a copy is {}; every register waits until nothing from before can arrive",
                path.display(),
                aside.display()
            );
            journal.tell(clock.now(), &Event::NotKept { what: WHAT.to_owned(), why });
            Entries::new()
        });
        let mut entries = found.clone();
        entries.values_mut().for_each(|entry| entry.kept.in_order = false);
        let is_saved = save(&path, &entries).is_ok();
        let is_unmarked = is_saved || std::fs::remove_file(&path).is_ok() || !path.exists();
        let saver = Saver::start(
            (WHAT, OTHERWISE),
            entries,
            move |entries: &Entries| save(&path, entries),
            journal,
            clock,
        );
        Promises { saver: Some(saver), found, is_first: is_first && is_saved, is_unmarked }
    }

    /// What was on disk of this output at the start; `None` where that says nothing of its register.
    pub(super) fn at_start(&self, profile: &Profile, output: &Output) -> Option<output::Kept> {
        if self.is_first {
            return Some(output::Kept { in_order: true, ..output::Kept::default() });
        }
        let entry = self.found.get(&output.name)?;
        (entry.register == register(profile, output)).then_some(entry.kept)
    }

    /// Nothing on disk says any more that a run ended in order: a register that says itself what stands in it need not
    /// wait for the disk.
    pub(super) fn is_unmarked(&self) -> bool {
        self.is_unmarked
    }

    /// Has this put on disk; the number asks for what became of it. `None` where nothing is ever kept.
    pub(super) fn keep(&self, profile: &Profile, output: &Output, kept: output::Kept) -> Option<u64> {
        let entry = Entry { register: register(profile, output), kept };
        Some(self.saver.as_ref()?.keep(|entries| drop(entries.insert(output.name.clone(), entry))))
    }

    /// What became of that, waiting for it no longer than `span`: see [`Saver::kept`].
    pub(super) async fn kept(&self, version: u64, span: Duration) -> Kept {
        match &self.saver {
            Some(saver) => saver.kept(version, span).await,
            None => Kept::Yes,
        }
    }

    /// Waits for what is still to be put on disk.
    pub(super) async fn finish(&self, span: Duration) {
        if let Some(saver) = &self.saver {
            saver.finish(span).await;
        }
    }
}

/// What a file says; nothing where there is no file.
fn read(path: &Path) -> Result<Entries, String> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        // Whatever keeps a file from being read is told of the state beside it.
        Err(error) if error.kind() != ErrorKind::InvalidData => return Ok(Entries::new()),
        Err(error) => return Err(error.to_string()),
    };
    let document: Document = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    match document.version {
        VERSION => Ok(document.outputs),
        version => Err(format!("it has version {version}, this program writes {VERSION}")),
    }
}

fn save(path: &Path, outputs: &Entries) -> std::io::Result<()> {
    if let Some(directory) = path.parent() {
        std::fs::create_dir_all(directory)?;
    }
    let mut file = atomic_write_file::AtomicWriteFile::open(path)?;
    let document = Document { version: VERSION, outputs: outputs.clone() };
    serde_json::to_writer_pretty(&mut file, &document).map_err(std::io::Error::other)?;
    file.write_all(b"\n")?;
    file.commit()
}
