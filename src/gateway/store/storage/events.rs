//! Writer of events to disk. Events wait in the event journal in memory until they are written.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::SyncSender;

use super::{Job, QueuedJob};
use crate::gateway::store::disk::{append as append_to, make_directory};
use crate::observe::events::file::{self, End, LARGEST};
use crate::observe::events::{Entry, Event, Journal};
use isotherm_core::quantity::Moment;

/// Maximum number of events that are read from the event journal at once.
const BATCH: usize = 64;

/// Connection from the event journal to the storage thread. New events wake the thread until the connection is
/// dropped.
#[derive(Debug)]
pub(super) struct EventsWake(Arc<Journal>);

impl EventsWake {
    /// Connects the event journal with the queue of the thread that writes to disk. `is_woken`: whether the queue
    /// already contains a wakeup, so that another one is not needed.
    pub(super) fn begin(
        journal: Arc<Journal>,
        queue: SyncSender<QueuedJob>,
        is_woken: Arc<AtomicBool>,
    ) -> EventsWake {
        journal.keep(move || {
            // If the queue is full, the thread has other jobs, and checks for events after each.
            if !is_woken.swap(true, Ordering::Relaxed) && queue.try_send(Box::new(Job::Events)).is_err() {
                is_woken.store(false, Ordering::Relaxed);
            }
        });
        EventsWake(journal)
    }
}

impl Drop for EventsWake {
    fn drop(&mut self) {
        self.0.wake_nobody();
    }
}

/// Writer of the event files, one for each day.
pub(super) struct EventsFile {
    directory: PathBuf,
    machine: String,
    journal: Arc<Journal>,
    open: Option<(String, File, End)>,
    /// Number of events that were not written because the file of their day was full.
    skipped: u64,
}

impl EventsFile {
    pub(super) fn new(directory: &Path, machine: &str, journal: Arc<Journal>) -> EventsFile {
        let (directory, machine) = (directory.to_owned(), machine.to_owned());
        EventsFile { directory, machine, journal, open: None, skipped: 0 }
    }

    /// Writes the waiting events. If an event cannot be written, it waits for the next call.
    pub(super) fn write_all(&mut self) -> std::io::Result<()> {
        loop {
            let entries = self.journal.unkept(BATCH);
            if entries.is_empty() {
                return Ok(());
            }
            for entry in &entries {
                self.write(entry)?;
                self.journal.kept();
            }
        }
    }

    fn write(&mut self, entry: &Entry) -> std::io::Result<()> {
        let day = file::day(entry);
        let (mut file, end) = match self.open.take().filter(|(open, ..)| open == day) {
            Some((_, file, end)) => (file, end),
            None => {
                let (mut file, mut end) = self.open_day(day)?;
                let lost = Event::EventsLost { count: self.skipped };
                if self.skipped > 0 && end.length() < LARGEST {
                    end = append(&mut file, end, &beside(entry, &lost))?;
                    self.skipped = 0;
                }
                (file, end)
            }
        };
        let end = if end.length() >= LARGEST {
            self.skipped += 1;
            end
        } else {
            let end = append(&mut file, end, entry)?;
            if end.length() >= LARGEST {
                let full = Event::EventsFull { bytes: LARGEST };
                append(&mut file, end, &beside(entry, &full))?
            } else {
                end
            }
        };
        self.open = Some((day.to_owned(), file, end));
        Ok(())
    }

    fn open_day(&self, day: &str) -> std::io::Result<(File, End)> {
        make_directory(&self.directory)?;
        let path = file::path(&self.directory, &self.machine, day);
        let end = file::read(&path, |_| {})?;
        Ok((append_to(&path)?, end))
    }
}

/// Creates an entry of the event journal for `event`, with the time of `entry`.
fn beside(entry: &Entry, event: &Event) -> Entry {
    Entry { at: entry.at.clone(), ..event.entry(Moment::default()) }
}

/// Appends an entry to the file. After a failure, the file may end with an incomplete line. The caller must then open
/// the file again.
fn append(file: &mut File, end: End, entry: &Entry) -> std::io::Result<End> {
    let (line, end) = end.line(entry);
    file.write_all(line.as_bytes())?;
    Ok(end)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Clock;
    use crate::observe::events::file::FileItem;
    use std::time::Duration;

    #[test]
    fn what_a_disk_did_not_take_waits_and_stands_in_the_file_once_and_in_order() {
        let home = tempfile::tempdir().unwrap();
        let directory = home.path().join("state");
        std::fs::write(&directory, "not a directory").unwrap();
        let journal = Arc::new(Journal::by(&Clock::simulated(Moment::default(), None)));
        journal.keep(|| {});
        let mut file = EventsFile::new(&directory, "m", journal.clone());
        let mut report = |number: u64| {
            let at = Moment::default().after(Duration::from_hours(number * 5));
            journal.report(at, &Event::KeptAgain { what: format!("number {number}") });
            file.write_all().is_ok()
        };
        assert!(!report(1) && !report(2));
        std::fs::remove_file(&directory).unwrap();
        assert!(report(3) && report(4));
        // The directory is moved away and created again. The events of an open file move with it.
        std::fs::rename(&directory, home.path().join("aside")).unwrap();
        assert!((5..8).all(&mut report));

        let mut texts = Vec::new();
        for directory in [home.path().join("aside"), directory] {
            let read = file::since(&directory, "m", Moment::default(), |found| {
                match found {
                    FileItem::Event(entry) => texts.push(entry.text),
                    FileItem::Damage(what) => panic!("{what}"),
                }
                true
            });
            read.unwrap();
        }
        let wanted: Vec<String> = (1..8).map(|number| format!("number {number} is saved again")).collect();
        assert_eq!(texts, wanted);
    }
}
