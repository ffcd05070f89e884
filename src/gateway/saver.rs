//! Keeps the newest version of a document on disk, by a thread of its own: a slow disk never holds a line up.
//!
//! It always writes the newest document, and says which version of it is on disk. Whoever depends on a version waits for
//! that, for a short while, and looks again in its next turn. Where nothing may happen at a time of its own (a simulation),
//! whoever changes the document puts it there at once.

use std::fmt;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;

use crate::clock::{Clock, Patience};
use crate::observe::events::{Event, Journal};

/// What became of a version that was to be put on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kept {
    /// It is there, or a newer one.
    Yes,
    /// The disk has not answered.
    NotYet,
    /// It cannot be.
    No,
}

/// A document of which the newest version is kept on disk.
pub(super) struct Saver<T> {
    hand: Hand<T>,
    done: watch::Receiver<Done>,
    /// The disk did not answer in time when it was last waited for: nobody waits for it again before it has.
    is_slow: AtomicBool,
}

/// Who puts it there.
enum Hand<T> {
    /// A thread, when it comes to it.
    Thread(Arc<Shelf<T>>),
    /// Whoever changes it, at once.
    Here(Mutex<(Newest<T>, Clerk<T>)>),
}

/// The newest version that was put on disk, and the newest that could not be.
#[derive(Clone, Copy, Debug, Default)]
struct Done {
    kept: u64,
    failed: u64,
}

#[derive(Default)]
struct Shelf<T> {
    newest: Mutex<Newest<T>>,
    turned: Condvar,
}

#[derive(Default)]
struct Newest<T> {
    document: T,
    version: u64,
    closed: bool,
}

/// Returns when the document is on disk.
type Save<T> = Box<dyn FnMut(&T) -> io::Result<()> + Send>;

/// Puts versions on disk, and tells what became of them.
struct Clerk<T> {
    what: &'static str,
    otherwise: &'static str,
    save: Save<T>,
    tell: watch::Sender<Done>,
    journal: Arc<Journal>,
    clock: Clock,
    is_failing: bool,
}

impl<T: Clone + Default + Send + 'static> Saver<T> {
    /// Begins with what is on disk. `save` returns when the document is there. Events say what it is, and what
    /// follows where it cannot be kept. `has_thread`: a slow disk holds nobody up.
    pub(super) fn start(
        (what, otherwise): (&'static str, &'static str),
        document: T,
        save: impl FnMut(&T) -> io::Result<()> + Send + 'static,
        (journal, clock): (Arc<Journal>, &Clock),
        has_thread: bool,
    ) -> Saver<T> {
        let (tell, done) = watch::channel(Done::default());
        let (save, clock) = (Box::new(save), clock.clone());
        let mut clerk = Clerk { what, otherwise, save, tell, journal, clock, is_failing: false };
        let newest = Newest { document, version: 0, closed: false };
        let hand = if has_thread {
            let shelf = Arc::new(Shelf { newest: Mutex::new(newest), turned: Condvar::new() });
            let work = {
                let shelf = Arc::clone(&shelf);
                move || shelf.work(&mut clerk)
            };
            // Without a thread nothing is kept, which is what everybody is then told.
            let _ = std::thread::Builder::new().name(what.replace(' ', "-")).spawn(work);
            Hand::Thread(shelf)
        } else {
            Hand::Here(Mutex::new((newest, clerk)))
        };
        Saver { hand, done, is_slow: AtomicBool::new(false) }
    }

    /// Changes the document and has it put on disk; the number asks for what became of that.
    pub(super) fn keep(&self, change: impl FnOnce(&mut T)) -> u64 {
        match &self.hand {
            Hand::Thread(shelf) => {
                let version = shelf.newest().change(change);
                shelf.turned.notify_one();
                version
            }
            Hand::Here(desk) => {
                let (newest, clerk) = &mut *desk.lock().unwrap_or_else(PoisonError::into_inner);
                let version = newest.change(change);
                clerk.put(version, &newest.document);
                version
            }
        }
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

    /// Waits for what is still to be put on disk.
    pub(super) async fn finish(&self, span: Duration) {
        let Hand::Thread(shelf) = &self.hand else { return };
        let version = shelf.newest().version;
        self.is_slow.store(false, Ordering::Relaxed);
        if version > 0 {
            let _ = self.kept(version, span).await;
        }
    }
}

impl<T> Drop for Saver<T> {
    fn drop(&mut self) {
        if let Hand::Thread(shelf) = &self.hand {
            shelf.newest().closed = true;
            shelf.turned.notify_one();
        }
    }
}

impl<T> fmt::Debug for Saver<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Saver").field("done", &*self.done.borrow()).finish_non_exhaustive()
    }
}

impl<T> Newest<T> {
    fn change(&mut self, change: impl FnOnce(&mut T)) -> u64 {
        change(&mut self.document);
        self.version += 1;
        self.version
    }
}

impl<T> Shelf<T> {
    fn newest(&self) -> MutexGuard<'_, Newest<T>> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: Clone> Shelf<T> {
    fn work(&self, clerk: &mut Clerk<T>) {
        let mut last = 0;
        loop {
            let mut newest = self.newest();
            while newest.version == last && !newest.closed {
                newest = self.turned.wait(newest).unwrap_or_else(PoisonError::into_inner);
            }
            if newest.version == last {
                return;
            }
            last = newest.version;
            let document = newest.document.clone();
            drop(newest);
            clerk.put(last, &document);
        }
    }
}

impl<T> Clerk<T> {
    fn put(&mut self, version: u64, document: &T) {
        let saved = (self.save)(document);
        let what = || self.what.to_owned();
        match &saved {
            Ok(()) if std::mem::take(&mut self.is_failing) => {
                self.journal.report(self.clock.now(), &Event::KeptAgain { what: what() });
            }
            Ok(()) => {}
            Err(error) => {
                if !std::mem::replace(&mut self.is_failing, true) {
                    let why = format!("{error}; {}", self.otherwise);
                    self.journal.report(self.clock.now(), &Event::NotKept { what: what(), why });
                }
            }
        }
        self.tell.send_modify(|done| match saved {
            Ok(()) => done.kept = version,
            Err(_) => done.failed = version,
        });
    }
}
