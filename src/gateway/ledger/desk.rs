//! Who keeps the ledger on disk: a thread of its own, so that a slow disk never holds a line up.
//!
//! It always writes the latest accounts, and says which version of them is on disk. A writer that has promised something
//! waits for that, for a short while, and looks again in its next cycle.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;

use super::Account;
use super::book::{self, Accounts, Book};
use crate::clock::{Clock, Patience};
use crate::observe::events::{Event, Journal};
use crate::profile::{Output, Profile, Share};

/// What became of an account that was to be put on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gateway) enum Kept {
    /// It is there.
    Yes,
    /// The disk has not answered.
    NotYet,
    /// It cannot be.
    No,
}

/// The accounts of all outputs that own a share of a register.
#[derive(Debug)]
pub(in crate::gateway) struct Ledger {
    desk: Arc<Desk>,
    done: watch::Receiver<Done>,
    /// The disk did not answer in time when it was last waited for: nobody waits for it again before it has.
    is_slow: AtomicBool,
}

/// The latest version that was put on disk, and the latest that could not be.
#[derive(Clone, Copy, Debug, Default)]
struct Done {
    kept: u64,
    failed: u64,
}

#[derive(Debug, Default)]
struct Desk {
    pages: Mutex<Pages>,
    turned: Condvar,
}

#[derive(Debug, Default)]
struct Pages {
    accounts: Accounts,
    version: u64,
    closed: bool,
}

impl Ledger {
    /// Opens the ledger of a machine; without a directory, or where no output needs one, nothing is ever kept.
    pub(in crate::gateway) fn open(
        profile: &Profile,
        directory: Option<&Path>,
        remembers: impl Fn(&str) -> bool,
        journal: Arc<Journal>,
        clock: &Clock,
    ) -> Ledger {
        let desk = Arc::new(Desk::default());
        let (tell, done) = watch::channel(Done::default());
        if !profile.outputs.iter().any(|output| output.share == Share::Ledger) {
            return Ledger { desk, done, is_slow: AtomicBool::new(false) };
        }
        let not_kept = |why| Event::NotKept { what: "the ledger".to_owned(), why };
        let Some(directory) = directory else {
            journal.tell(
                clock.now(),
                &not_kept("there is no state directory; name one with --state".to_owned()),
            );
            return Ledger { desk, done, is_slow: AtomicBool::new(false) };
        };
        let found = book::open(directory, profile, remembers);
        if let Some(why) = found.trouble {
            journal.tell(clock.now(), &not_kept(why));
        }
        desk.pages().accounts = found.accounts;
        let (place, clock) = (desk.clone(), clock.clone());
        let work = move || place.work(found.book, &tell, &journal, &clock);
        // Without a thread nothing is kept, which is what every writer is then told.
        let _ = std::thread::Builder::new().name("ledger".to_owned()).spawn(work);
        Ledger { desk, done, is_slow: AtomicBool::new(false) }
    }

    /// The account of an output as it was last kept or is to be kept; `None` before its register was first read.
    pub(in crate::gateway) fn account(&self, output: &Output) -> Option<Account> {
        self.desk.pages().accounts.get(&output.name).cloned()
    }

    /// The account of a register that nothing of ours has ever been in.
    pub(in crate::gateway) fn new_account(&self, profile: &Profile, output: &Output, found: i64) -> Account {
        Account::open(book::register(profile, output), found)
    }

    /// Has this account put on disk; the number asks for what became of it.
    pub(in crate::gateway) fn keep(&self, output: &Output, account: Account) -> u64 {
        let mut pages = self.desk.pages();
        pages.accounts.insert(output.name.clone(), account);
        pages.version += 1;
        self.desk.turned.notify_one();
        pages.version
    }

    /// What became of that, waiting for it no longer than `span` of the wall's time, and for a disk that did not answer
    /// the last time not at all.
    pub(in crate::gateway) async fn kept(&self, version: u64, span: Duration) -> Kept {
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

    /// Waits for what is still to be put on disk.
    pub(in crate::gateway) async fn finish(&self, span: Duration) {
        let version = self.desk.pages().version;
        self.is_slow.store(false, Ordering::Relaxed);
        if version > 0 {
            let _ = self.kept(version, span).await;
        }
    }
}

impl Drop for Ledger {
    fn drop(&mut self) {
        self.desk.pages().closed = true;
        self.desk.turned.notify_one();
    }
}

impl Desk {
    fn pages(&self) -> MutexGuard<'_, Pages> {
        self.pages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn work(&self, mut book: Book, tell: &watch::Sender<Done>, journal: &Journal, clock: &Clock) {
        let (mut last, mut failing) = (0, false);
        loop {
            let mut pages = self.pages();
            while pages.version == last && !pages.closed {
                pages = self.turned.wait(pages).unwrap_or_else(PoisonError::into_inner);
            }
            if pages.version == last {
                return;
            }
            last = pages.version;
            let accounts = pages.accounts.clone();
            drop(pages);
            let saved = book.save(&accounts);
            let what = || "the ledger".to_owned();
            match &saved {
                Ok(()) if std::mem::take(&mut failing) => {
                    journal.tell(clock.now(), &Event::KeptAgain { what: what() });
                }
                Ok(()) => {}
                Err(error) => {
                    if !std::mem::replace(&mut failing, true) {
                        let why = format!("{error}; what depends on it is not written");
                        journal.tell(clock.now(), &Event::NotKept { what: what(), why });
                    }
                }
            }
            tell.send_modify(|done| match saved {
                Ok(()) => done.kept = last,
                Err(_) => done.failed = last,
            });
        }
    }
}
