//! What of the outputs must outlive the process: the division of a shared register, what may still appear in a
//! register, and whether the last run ended in order. How that is used: [`isotherm_core::output`].
//!
//! One JSON file in the state directory (`file.rs`). A thread of its own puts it on disk; whoever depends on that asks
//! what became of it.

use isotherm_core::quantity::{Counts, Shifted};
use std::sync::Arc;
use std::time::Duration;

use super::Options;
use super::sealed::pair::Opened;
use crate::clock::Clock;
use crate::observe::events::{Event, Journal};
use isotherm_core::explained::Explained;
use isotherm_core::output::{self, Doubt};
use isotherm_profile::{Output, Profile, Share};

pub(super) mod file;
mod writer;

use file::{Entries, Entry, LedgerFile, register};
pub(super) use writer::Kept;
use writer::LedgerWriter;

const WHAT: &str = "the ledger";
/// What of each output is on disk.
pub(super) struct Ledger {
    profile: Arc<Profile>,
    /// On disk there are stamps.
    clock: Clock,
    /// `None` where nothing is ever kept.
    writer: Option<LedgerWriter>,
    found: Entries,
    /// Nothing of ours has ever been in a register of ours alone: no run has left anything here; or whoever runs a
    /// gateway that keeps nothing answers for that.
    is_first: bool,
    /// Nothing on disk says any more that a run ended in order.
    is_unmarked: bool,
}

/// What has to happen before a write that depends on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Keeping {
    /// Nothing: it is not kept, and need not be.
    Needless,
    /// This version must be on disk.
    Version(u64),
    /// It would have to be on disk, and there is none.
    Impossible,
}

impl Ledger {
    /// Opens the ledger of a machine. Without a directory nothing is kept, in a dry run nothing is changed. `remembers`:
    /// whether an offset of this output was verified before; `is_first`: no run before this one has left anything.
    pub(super) fn open(
        profile: &Arc<Profile>,
        options: &Options,
        (opened, is_first): (Option<Opened>, bool),
        remembers: impl Fn(&str) -> bool,
        (journal, clock): (Arc<Journal>, &Clock),
    ) -> Ledger {
        let profile = profile.clone();
        let not_kept = |why| journal.report(clock.now(), &Event::NotKept { what: WHAT.to_owned(), why });
        let Some(opened) = opened else {
            if profile.outputs.iter().any(is_shared) {
                not_kept(Explained::new("there is no state directory", "name one with --state"));
            }
            return Ledger {
                profile,
                clock: clock.clone(),
                writer: None,
                found: Entries::new(),
                is_first: true,
                is_unmarked: true,
            };
        };
        let (mut file, read) = LedgerFile::open(opened);
        let (mut before, is_readable) = match read {
            Ok(entries) => (entries.unwrap_or_default(), true),
            Err(why) => {
                journal.report(clock.now(), &Event::NotBelieved { why });
                (Entries::new(), false)
            }
        };
        let found = found(&profile, &mut before, is_readable, remembers);
        if options.dry_run {
            let clock = clock.clone();
            return Ledger { profile, clock, writer: None, found, is_first, is_unmarked: true };
        }
        let mut entries = found.clone();
        entries.values_mut().for_each(|entry| entry.kept.in_order = false);
        // What cannot be used does not say that anything was in order, and is first kept aside.
        let is_saved = is_readable && file.save(&entries).is_ok();
        let is_unmarked = is_saved || !is_readable || file.is_marked_begun();
        let writer = Some(LedgerWriter::start(entries, file, (journal, clock), options.has_threads));
        let clock = clock.clone();
        Ledger { profile, clock, writer, found, is_first: is_first && is_saved, is_unmarked }
    }

    /// What was on disk of this output at the start; `None` where that says nothing of its register.
    pub(super) fn at_start(&self, output: &Output) -> Option<output::Kept> {
        if self.is_first && !is_shared(output) {
            return Some(output::Kept { in_order: true, ..output::Kept::default() });
        }
        let counted = self.clock.shift().reversed();
        self.found.get(&output.name).map(|entry| entry.kept.shifted(counted))
    }

    /// Has this put on disk. `is_needed`: a register that says itself what stands in it need not wait for the disk, once
    /// nothing there says any more that a run ended in order.
    pub(super) fn keep(&self, output: &Output, kept: output::Kept, is_needed: bool) -> Keeping {
        // What is no number in the register is none here either.
        let stood = kept.stood.filter(|counts| file::fits(*counts));
        let entry = Entry {
            register: register(&self.profile, output),
            kept: output::Kept { stood, ..kept }.shifted(self.clock.shift()),
        };
        match &self.writer {
            None if is_shared(output) => Keeping::Impossible,
            None => Keeping::Needless,
            Some(writer) => {
                let version = writer.keep(output.name.clone(), entry);
                if is_needed || !self.is_unmarked { Keeping::Version(version) } else { Keeping::Needless }
            }
        }
    }

    /// What became of that, waiting for it no longer than `span`: see [`LedgerWriter::kept`].
    pub(super) async fn kept(&self, version: u64, span: Duration) -> Kept {
        match &self.writer {
            Some(writer) => writer.kept(version, span).await,
            None => Kept::Yes,
        }
    }

    pub(super) async fn finish(&self, span: Duration) {
        if let Some(writer) = &self.writer {
            writer.finish(span).await;
        }
    }
}

/// What the file says of the outputs of this profile. Of a shared register it must say something where there may be
/// anything of ours in it: else a person decides.
fn found(
    profile: &Profile,
    before: &mut Entries,
    is_readable: bool,
    remembers: impl Fn(&str) -> bool,
) -> Entries {
    let mut found = Entries::new();
    for output in &profile.outputs {
        let register = register(profile, output);
        let in_question = |doubt| output::Kept::in_question(doubt);
        let kept = match take(before, profile, &output.name, &register) {
            Some(entry) if entry.register == register && is_shared(output) && is_ours(output, &entry) => {
                in_question(Doubt::Lost)
            }
            Some(entry) if entry.register == register => entry.kept,
            _ if !is_shared(output) => continue,
            _ if !is_readable => in_question(Doubt::Unreadable),
            Some(_) => in_question(Doubt::Elsewhere),
            None if remembers(&output.name) => in_question(Doubt::Lost),
            None => continue,
        };
        found.insert(output.name.clone(), Entry { register, kept });
    }
    found
}

/// The register was ours alone before, and held something: whose that is now only a person can say.
fn is_ours(output: &Output, entry: &Entry) -> bool {
    let is_zero = |counts: Counts| counts == Counts(0) || counts == Counts(output.encoding.bias);
    entry.kept.account.is_none() && entry.kept.stood.is_some_and(|stood| !is_zero(stood))
}

/// By its name; an output that was given a new name goes on with what is known of its register.
fn take(entries: &mut Entries, profile: &Profile, name: &str, register: &str) -> Option<Entry> {
    let is_nobodys = |known: &str| profile.outputs.iter().all(|output| output.name != known);
    let former = |(known, entry): &(&String, &Entry)| is_nobodys(known) && entry.register == register;
    let former = || entries.iter().find(former).map(|(known, _)| known.clone());
    let key = if entries.contains_key(name) { name.to_owned() } else { former()? };
    entries.remove(&key)
}

fn is_shared(output: &Output) -> bool {
    output.share == Share::Ledger
}

#[cfg(test)]
mod tests;
