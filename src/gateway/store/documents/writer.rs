//! Writer of the state document, on a separate thread, so that a slow disk never delays a bus line.
//!
//! The writer always saves the newest version, and reports which version is on disk. If a write to a register depends
//! on a version, the line task waits a short time until this version is on disk. If it is not on disk then, the next
//! turn of the output (work of the line task on it) checks again. A simulation has no such thread: the caller saves
//! the document at once.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;

use super::{DiskCause, Entry, OpenQuestion, StoreFile, WHAT, is_news};
use crate::clock::{Clock, WallTimeout};
use crate::fieldbus::explain::explain_system;
use crate::gateway::store::memory::Memory;
use crate::observe::events::{Event, Journal};

/// Second part of the message that the state cannot be saved: the consequences for the registers.
const OTHERWISE: &str = "shared and unreadable registers are not written; after the next start, the gateway \
                         first waits until no earlier write can arrive";

/// Result of saving one version of the document.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gateway) enum SaveResult {
    /// The requested version, or a newer version, is on disk.
    Yes,
    /// The version is not on disk yet.
    NotYet,
    /// The version cannot be saved, because the disk reports an error.
    No,
}

/// Writer of the state document. A separate thread saves the document. In a simulation, the caller saves it.
pub(in crate::gateway) struct Writer {
    shared: Arc<Shared>,
    /// File to which the caller of the writer saves; `None` if a separate thread saves.
    here: Option<Mutex<Saving>>,
    done: watch::Receiver<SavedVersions>,
    question: OpenQuestion,
    /// Whether the last wait for the disk timed out. If so, further calls do not wait for the disk until it has
    /// answered.
    is_slow: AtomicBool,
}

/// Progress of saving. `kept`: newest version on disk. `failed`: newest version that could not be saved. `settled`:
/// newest version whose document and `NAME.number` were saved, or could not be saved.
#[derive(Clone, Copy, Debug, Default)]
struct SavedVersions {
    kept: u64,
    failed: u64,
    settled: u64,
}

/// State that the writer shares with its thread.
#[derive(Default)]
struct Shared {
    newest: Mutex<PendingChanges>,
    changed: Condvar,
}

/// Changes that are not saved yet.
#[derive(Default)]
struct PendingChanges {
    outputs: BTreeMap<String, Entry>,
    state: Option<Box<Memory>>,
    version: u64,
    closed: bool,
}

/// Part of the writer that saves versions and reports the results.
struct Saving {
    file: StoreFile,
    done: watch::Sender<SavedVersions>,
    journal: Arc<Journal>,
    clock: Clock,
    /// Reported cause of the failure; `None` while saving works.
    failing: DiskCause,
}

impl Writer {
    pub(in crate::gateway) fn start(
        file: StoreFile,
        (journal, clock): (Arc<Journal>, &Clock),
        has_thread: bool,
    ) -> Writer {
        let (sender, done) = watch::channel(SavedVersions::default());
        let shared = Arc::new(Shared::default());
        let question = file.question();
        let mut saving = Saving { file, done: sender, journal, clock: clock.clone(), failing: None };
        let here = if has_thread {
            let shared = Arc::clone(&shared);
            let work = move || shared.work(&mut saving);
            // Without a thread no version is ever on disk, and every caller learns that.
            let _ = std::thread::Builder::new().name("state".to_owned()).spawn(work);
            None
        } else {
            Some(Mutex::new(saving))
        };
        Writer { shared, here, done, question, is_slow: AtomicBool::new(false) }
    }

    /// Saves an output's entry in the register ledger. Returns the version of the document that contains the entry.
    /// The caller can wait for this version with [`kept`](Writer::kept).
    pub(in crate::gateway) fn keep(&self, output: String, entry: Entry) -> u64 {
        self.put(|newest| drop(newest.outputs.insert(output, entry)))
    }

    /// Saves a state of the machine. The call does not wait for the disk.
    pub(in crate::gateway) fn remember(&self, state: Memory) {
        self.put(|newest| newest.state = Some(Box::new(state)));
    }

    fn put(&self, change: impl FnOnce(&mut PendingChanges)) -> u64 {
        let mut newest = self.shared.newest();
        change(&mut newest);
        newest.version += 1;
        match &self.here {
            None => self.shared.changed.notify_one(),
            Some(saving) => {
                let mut saving = saving.lock().unwrap_or_else(PoisonError::into_inner);
                saving.save(newest.version, newest.take());
            }
        }
        newest.version
    }

    /// Waits until a version is on disk, for at most `span` of wall-clock time. If the last wait timed out,
    /// this call does not wait. With a virtual clock, such a call still waits for a part of `span`, because
    /// simulated time passes faster than the disk works.
    pub(in crate::gateway) async fn kept(&self, version: u64, span: Duration, clock: &Clock) -> SaveResult {
        let mut done = self.done.clone();
        let is_done = |done: &SavedVersions| done.kept >= version || done.failed >= version;
        let span = match (self.is_slow.load(Ordering::Relaxed), clock.is_virtual()) {
            (false, _) => span,
            (true, true) => span / WallTimeout::SLICES,
            (true, false) => Duration::ZERO,
        };
        let waited = WallTimeout::by(clock).within(span, done.wait_for(is_done)).await;
        if waited.is_some() || !span.is_zero() {
            self.is_slow.store(waited.is_none(), Ordering::Relaxed);
        }
        match waited {
            None => SaveResult::NotYet,
            Some(Ok(done)) if done.kept >= version => SaveResult::Yes,
            Some(_) => SaveResult::No,
        }
    }

    /// Waits until the document and its save number are saved at the end of a run, for at most `span`.
    pub(in crate::gateway) async fn finish(&self, span: Duration) {
        let version = self.shared.newest().version;
        let mut done = self.done.clone();
        let _ = WallTimeout::new().within(span, done.wait_for(|done| done.settled >= version)).await;
    }

    pub(in crate::gateway) fn question(&self) -> &OpenQuestion {
        &self.question
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        self.shared.newest().closed = true;
        self.shared.changed.notify_one();
    }
}

impl PendingChanges {
    fn take(&mut self) -> (BTreeMap<String, Entry>, Option<Box<Memory>>) {
        (std::mem::take(&mut self.outputs), self.state.take())
    }
}

impl Shared {
    fn newest(&self) -> MutexGuard<'_, PendingChanges> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn work(&self, saving: &mut Saving) {
        let mut last = 0;
        loop {
            let is_same = |newest: &mut PendingChanges| newest.version == last && !newest.closed;
            let waited = self.changed.wait_while(self.newest(), is_same);
            let mut newest = waited.unwrap_or_else(PoisonError::into_inner);
            if newest.version == last {
                return;
            }
            last = newest.version;
            let taken = newest.take();
            drop(newest);
            saving.save(last, taken);
        }
    }
}

impl Saving {
    fn save(&mut self, version: u64, (outputs, state): (BTreeMap<String, Entry>, Option<Box<Memory>>)) {
        outputs.iter().for_each(|(name, entry)| self.file.set_output(name, entry));
        if let Some(mut state) = state
            && let Ok(state) = state.saved()
        {
            self.file.set_state(&state);
        }
        let saved = self.file.save();
        self.done.send_modify(|done| match saved {
            Ok(()) => done.kept = version,
            Err(_) => done.failed = version,
        });
        // Only the end of a run waits for the number.
        let numbered = saved.and_then(|()| self.file.save_number());
        self.done.send_modify(|done| done.settled = version);
        let event = match numbered {
            Ok(()) if self.failing.take().is_some() => Event::KeptAgain { what: WHAT.to_owned() },
            Err(error) if is_news(&mut self.failing, &error) => {
                let why = explain_system(&error).within(|cause| format!("{cause}; {OTHERWISE}"));
                Event::NotKept { what: WHAT.to_owned(), why }
            }
            _ => return,
        };
        self.journal.report(self.clock.now(), &event);
    }
}
