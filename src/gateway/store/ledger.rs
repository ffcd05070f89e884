//! Register ledger: the state of the outputs that must survive the process. It contains the operator offset
//! and the gateway share of each shared register, and the values that may still arrive at a register. It also
//! shows whether the last run ended without an exchange in progress. [`isotherm_core::output`] uses the
//! entries.
//!
//! The [store](super::documents) saves the register ledger. A caller that needs the entry on disk waits for the
//! result.

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;

pub(in crate::gateway) use super::documents::SaveResult;
use super::documents::{Content, Entries, Entry, Opened, WHAT, Writer, fits};
use super::places;
use crate::clock::Clock;
use crate::observe::events::{Event, Journal};
use isotherm_core::explained::Explained;
use isotherm_core::output::{self, Doubt};
use isotherm_core::quantity::{Counts, Shifted};
use isotherm_profile::{Output, Profile, Share};

/// Register ledger of a machine: saved account of the values that the gateway has written to each register. The type
/// contains the entries of the last run, and saves new entries.
pub(in crate::gateway) struct Ledger {
    profile: Arc<Profile>,
    /// Clock that converts the time stamps on disk to the monotonic time of this run.
    clock: Clock,
    /// Writer of the state document; `None` if nothing is saved.
    writer: Option<Arc<Writer>>,
    found: Entries,
    /// Whether an earlier run cannot have written to a register. Either no earlier run has left a file, or the
    /// gateway saves nothing and its caller guarantees this.
    is_first: bool,
    /// Whether the files on disk no longer state that all writes have arrived at the registers. Such a
    /// statement would be wrong as soon as this run writes to a register.
    is_unmarked: bool,
}

/// Properties of a run on which the saving of the register ledger depends.
#[derive(Clone, Copy, Debug)]
pub(in crate::gateway) struct LedgerRun {
    /// Whether the run is a dry run, which writes nothing to a register.
    pub(in crate::gateway) dry_run: bool,
    /// Whether the writer of the state document uses a separate thread.
    pub(in crate::gateway) has_threads: bool,
}

/// Condition that must be met before the gateway writes a value to a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gateway) enum SaveCondition {
    /// The gateway may write at once, without waiting for the disk.
    Needless,
    /// The write must wait until the contained version of the document is on disk.
    Version(u64),
    /// The write is not allowed: it requires a saved entry in the register ledger, but this run saves nothing.
    Impossible,
}

impl Ledger {
    /// Creates the register ledger of a gateway that saves nothing.
    pub(in crate::gateway) fn of_nothing(
        profile: &Arc<Profile>,
        (journal, clock): (&Journal, &Clock),
    ) -> Ledger {
        if profile.outputs.iter().any(is_shared) {
            let why = Explained::new("there is no state directory", "set one with --state");
            journal.report(clock.now(), &Event::NotKept { what: WHAT.to_owned(), why });
        }
        let (profile, clock) = (profile.clone(), clock.clone());
        Ledger { profile, clock, writer: None, found: Entries::new(), is_first: true, is_unmarked: true }
    }

    /// Opens the register ledger of a machine, and the writer of its document. A dry run does not change the
    /// entries on disk. If the first run is a dry run, its entries state that no write can still arrive at a
    /// register. `remembers` returns whether an earlier run verified an offset in an output.
    pub(in crate::gateway) fn open(
        profile: &Arc<Profile>,
        run: LedgerRun,
        Opened { found: opened, mut file, is_first, .. }: Opened,
        remembers: impl Fn(&str) -> bool,
        (journal, clock): (Arc<Journal>, &Clock),
    ) -> (Ledger, Arc<Writer>) {
        let is_readable = opened.is_ok();
        let content = opened.ok().flatten().unwrap_or_default();
        let found = found(profile, content.outputs.clone(), is_readable, remembers);
        let ours = || Content { outputs: found.clone(), ..Content::default() }.not_in_order();
        let entries = match (run.dry_run && is_readable, is_first) {
            (true, true) => unwritten_entries(profile),
            (true, false) => content.outputs,
            (false, _) => ours().outputs,
        };
        entries.iter().for_each(|(name, entry)| file.set_output(name, entry));
        // A document that is not accepted does not prove that a run ended in order. It is kept under another name
        // before it is replaced. A start does not wait for that.
        let is_saved = is_readable && !run.dry_run && file.save().is_ok();
        if is_saved {
            // If that fails, the writer tries again and reports it.
            let _ = file.save_number();
        }
        let is_unmarked = is_saved || run.dry_run || !is_readable || file.mark_begun();
        let writer = Arc::new(Writer::start(file, (journal, clock), run.has_threads));
        let (profile, clock) = (profile.clone(), clock.clone());
        let kept = Some(&writer).filter(|_| !run.dry_run).cloned();
        let is_first = is_first && (is_saved || run.dry_run);
        (Ledger { profile, clock, writer: kept, found, is_first, is_unmarked }, writer)
    }

    /// Returns the saved data of an output's register at the start of the gateway. `None` if nothing is known about
    /// the register.
    pub(in crate::gateway) fn at_start(&self, output: &Output) -> Option<output::SavedOutput> {
        if self.is_first && !is_shared(output) {
            return Some(unwritten());
        }
        let counted = self.clock.shift().reversed();
        self.found.get(&output.name).map(|entry| entry.kept.shifted(counted))
    }

    /// Saves the entry of an output. `is_needed`: whether the next write requires the entry on disk. A write
    /// that does not require the entry must wait only while the files on disk still state that all writes
    /// have arrived. Returns whether and for which version the write must wait.
    pub(in crate::gateway) fn keep(
        &self,
        output: &Output,
        kept: output::SavedOutput,
        is_needed: bool,
    ) -> SaveCondition {
        // A value that no register can hold is not saved either.
        let stood = kept.stood.filter(|counts| fits(*counts));
        let kept = output::SavedOutput { stood, ..kept }.shifted(self.clock.shift());
        let entry = Entry::new(places::of_output(&self.profile, output), kept);
        match &self.writer {
            None if is_shared(output) => SaveCondition::Impossible,
            None => SaveCondition::Needless,
            Some(writer) => {
                let version = writer.keep(output.name.clone(), entry);
                if is_needed || !self.is_unmarked {
                    SaveCondition::Version(version)
                } else {
                    SaveCondition::Needless
                }
            }
        }
    }

    /// Waits until a version of the document is on disk: see [`Writer::kept`].
    pub(in crate::gateway) async fn kept(&self, version: u64, span: Duration, clock: &Clock) -> SaveResult {
        match &self.writer {
            Some(writer) => writer.kept(version, span, clock).await,
            None => SaveResult::Yes,
        }
    }

    pub(in crate::gateway) async fn finish(&self, span: Duration) {
        if let Some(writer) = &self.writer {
            writer.finish(span).await;
        }
    }
}

/// Returns the saved data of a register that no run of the gateway has written.
fn unwritten() -> output::SavedOutput {
    output::SavedOutput { in_order: true, ..output::SavedOutput::default() }
}

/// Returns entries for a machine to which no run has written. A shared register has no entry, because its operator
/// offset is not known.
fn unwritten_entries(profile: &Profile) -> Entries {
    let outputs = profile.outputs.iter().filter(|output| !is_shared(output));
    let entry = |output: &Output| Entry::new(places::of_output(profile, output), unwritten());
    outputs.map(|output| (output.name.clone(), entry(output))).collect()
}

/// Returns the saved entries for the outputs of this profile. If the gateway share of a shared register (part that
/// the gateway added) is not known, its entry is in question. The operator must then decide.
fn found(profile: &Profile, before: Entries, is_readable: bool, remembers: impl Fn(&str) -> bool) -> Entries {
    let mut found = Entries::new();
    let names: HashSet<&str> = profile.outputs.iter().map(|output| output.name.as_str()).collect();
    let (mut named, mut others): (Entries, Entries) =
        before.into_iter().partition(|(name, _)| names.contains(name.as_str()));
    for output in &profile.outputs {
        let (place, in_words) = (places::of_output(profile, output), in_words(profile, output));
        let in_question = |doubt| output::SavedOutput::in_question(doubt);
        let is_of_it = |entry: &Entry| entry.is_of(&place, &in_words);
        let kept = match take(&output.name, (&mut named, &mut others), is_of_it) {
            Some(entry) if is_of_it(&entry) && is_shared(output) && is_ours(output, &entry) => {
                in_question(Doubt::Lost)
            }
            Some(entry) if is_of_it(&entry) => entry.kept,
            _ if !is_shared(output) => continue,
            _ if !is_readable => in_question(Doubt::Unreadable),
            Some(_) => in_question(Doubt::Elsewhere),
            None if remembers(&output.name) => in_question(Doubt::Lost),
            None => continue,
        };
        found.insert(output.name.clone(), Entry::new(place, kept));
    }
    found
}

/// Returns whether the register held an offset of the gateway when it was not yet shared with an operator. Only the
/// operator can then say which part of its value is the operator offset.
fn is_ours(output: &Output, entry: &Entry) -> bool {
    let is_zero = |counts: Counts| counts == Counts(0) || counts == Counts(output.encoding.bias);
    entry.kept.account.is_none() && entry.kept.stood.is_some_and(|stood| !is_zero(stood))
}

/// Removes and returns the saved entry of an output. `named` contains the entries with the name of an output of the
/// profile. If the output was renamed, its entry is in `others`, and is identified by its register.
fn take(
    name: &str,
    (named, others): (&mut Entries, &mut Entries),
    is_of_it: impl Fn(&Entry) -> bool,
) -> Option<Entry> {
    named.remove(name).or_else(|| {
        let (former, _) = others.iter().find(|(_, entry)| is_of_it(entry))?;
        let former = former.clone();
        others.remove(&former)
    })
}

/// Returns the text by which documents of layout 5 identify the register of an output.
fn in_words(profile: &Profile, output: &Output) -> String {
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

fn is_shared(output: &Output) -> bool {
    output.share == Share::Ledger
}

#[cfg(test)]
mod tests;
