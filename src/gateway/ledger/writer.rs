//! Keeps the newest ledger on disk, by a thread of its own: a slow disk never holds a line up.
//!
//! It always writes the newest one, and says which version of it is on disk. Whoever depends on a version waits for that,
//! for a short while, and looks again in its next turn. Where nothing may happen at a time of its own (a simulation),
//! whoever changes the ledger puts it there at once.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;

use super::WHAT;
use super::file::{Entries, Entry, LedgerFile};
use crate::clock::{Clock, Patience};
use crate::fieldbus::explain::explain_system;
use crate::observe::events::{Event, Journal};

/// The consequence of a ledger that is not on disk.
const OTHERWISE: &str = "a register that is shared or cannot be read is not written; after the next start the gateway \
                         writes no register until no earlier write can still arrive";

/// What became of a version that was to be put on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gateway) enum Kept {
    /// It is there, or a newer one.
    Yes,
    /// The disk has not answered.
    NotYet,
    /// It cannot be.
    No,
}

/// A ledger of which the newest version is kept on disk.
pub(super) struct LedgerWriter {
    shared: Arc<Shared>,
    /// Where there is no thread.
    here: Option<Mutex<Saving>>,
    done: watch::Receiver<Done>,
    /// The disk did not answer in time when it was last waited for: nobody waits for it again before it has.
    is_slow: AtomicBool,
}

/// The newest version that was put on disk, and the newest that could not be.
#[derive(Clone, Copy, Debug, Default)]
struct Done {
    kept: u64,
    failed: u64,
}

/// What the thread and its owner share.
#[derive(Default)]
struct Shared {
    newest: Mutex<Newest>,
    changed: Condvar,
}

#[derive(Default)]
struct Newest {
    entries: Entries,
    version: u64,
    closed: bool,
}

/// Puts versions on disk, and reports what became of them.
struct Saving {
    file: LedgerFile,
    done: watch::Sender<Done>,
    journal: Arc<Journal>,
    clock: Clock,
    is_failing: bool,
}

impl LedgerWriter {
    /// Begins with what is on disk. `has_thread`: a slow disk holds nobody up.
    pub(super) fn start(
        entries: Entries,
        file: LedgerFile,
        (journal, clock): (Arc<Journal>, &Clock),
        has_thread: bool,
    ) -> LedgerWriter {
        let (sender, done) = watch::channel(Done::default());
        let newest = Mutex::new(Newest { entries, ..Newest::default() });
        let shared = Arc::new(Shared { newest, changed: Condvar::new() });
        let mut saving = Saving { file, done: sender, journal, clock: clock.clone(), is_failing: false };
        let here = if has_thread {
            let shared = Arc::clone(&shared);
            let work = move || shared.work(&mut saving);
            // Without a thread nothing is kept, which is what everybody then hears.
            let _ = std::thread::Builder::new().name(WHAT.replace(' ', "-")).spawn(work);
            None
        } else {
            Some(Mutex::new(saving))
        };
        LedgerWriter { shared, here, done, is_slow: AtomicBool::new(false) }
    }

    /// Takes an entry over and has the ledger put on disk; the number asks for what became of that.
    pub(super) fn keep(&self, output: String, entry: Entry) -> u64 {
        let mut newest = self.shared.newest();
        newest.entries.insert(output, entry);
        newest.version += 1;
        match &self.here {
            None => self.shared.changed.notify_one(),
            Some(saving) => {
                let mut saving = saving.lock().unwrap_or_else(PoisonError::into_inner);
                saving.put(newest.version, &newest.entries);
            }
        }
        newest.version
    }

    /// What became of that, waiting for it no longer than `span` of the wall's time, and for a disk that did not answer
    /// the last time not at all.
    pub(super) async fn kept(&self, version: u64, span: Duration) -> Kept {
        let mut done = self.done.clone();
        let is_done = |done: &Done| done.kept >= version || done.failed >= version;
        let span = if self.is_slow.load(Ordering::Relaxed) { Duration::ZERO } else { span };
        let waited = Patience::new().within(span, done.wait_for(is_done)).await;
        if waited.is_some() || !span.is_zero() {
            self.is_slow.store(waited.is_none(), Ordering::Relaxed);
        }
        match waited {
            None => Kept::NotYet,
            Some(Ok(done)) if done.kept >= version => Kept::Yes,
            Some(_) => Kept::No,
        }
    }

    pub(super) async fn finish(&self, span: Duration) {
        let version = self.shared.newest().version;
        self.is_slow.store(false, Ordering::Relaxed);
        if version > 0 {
            let _ = self.kept(version, span).await;
        }
    }
}

impl Drop for LedgerWriter {
    fn drop(&mut self) {
        self.shared.newest().closed = true;
        self.shared.changed.notify_one();
    }
}

impl Shared {
    fn newest(&self) -> MutexGuard<'_, Newest> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn work(&self, saving: &mut Saving) {
        let mut last = 0;
        loop {
            let is_same = |newest: &mut Newest| newest.version == last && !newest.closed;
            let waited = self.changed.wait_while(self.newest(), is_same);
            let newest = waited.unwrap_or_else(PoisonError::into_inner);
            if newest.version == last {
                return;
            }
            last = newest.version;
            let entries = newest.entries.clone();
            drop(newest);
            saving.put(last, &entries);
        }
    }
}

impl Saving {
    fn put(&mut self, version: u64, entries: &Entries) {
        let saved = self.file.save(entries);
        let what = || WHAT.to_owned();
        match &saved {
            Ok(()) if std::mem::take(&mut self.is_failing) => {
                self.journal.report(self.clock.now(), &Event::KeptAgain { what: what() });
            }
            Err(error) if !std::mem::replace(&mut self.is_failing, true) => {
                let why = explain_system(error).within(|cause| format!("{cause}; {OTHERWISE}"));
                self.journal.report(self.clock.now(), &Event::NotKept { what: what(), why });
            }
            _ => {}
        }
        self.done.send_modify(|done| match saved {
            Ok(()) => done.kept = version,
            Err(_) => done.failed = version,
        });
    }
}
