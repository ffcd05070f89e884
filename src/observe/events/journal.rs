//! Event journal of a run of the gateway. The journal logs, counts and shows each event, and stores it in memory until
//! it is on disk.

use std::borrow::Cow;
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::alarms::{Acknowledgement, Alarm, Alarms, Change};
use super::event::Event;
use crate::clock::Clock;
use isotherm_core::events::Level;
use isotherm_core::quantity::Moment;

/// Maximum number of events that the status and the web page show.
const SHOWN: usize = 200;
/// Maximum number of events that wait for a slow disk. Further events are lost and counted.
const UNKEPT: usize = 10_000;

/// Event with its time, in the form in which it is shown and stored.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[schemars(rename = "Event")]
pub struct Entry {
    /// Time as RFC 3339.
    pub at: String,
    /// Kind of the event as one word for programs, for example `device-lost`. The event counter has this word
    /// as its label.
    pub kind: Cow<'static, str>,
    /// Severity of the event.
    #[schemars(schema_with = "super::data::level_schema")]
    pub level: Level,
    /// Text of the event for people.
    pub text: String,
    /// Values that the sentence contains, for programs.
    #[serde(default, skip_serializing_if = "serde_json::Value::is_null")]
    pub data: serde_json::Value,
}

/// Event that has just been reported, for a listener.
#[derive(Clone, Copy, Debug)]
pub struct ReportedEvent<'a> {
    /// Event as a variant of the enum, with its fields.
    pub event: &'a Event,
    /// Event in the form in which it is shown and stored.
    pub entry: &'a Entry,
    /// Alarms that the event has raised or ended.
    pub change: &'a Change,
}

/// Function that receives every event at once, in order. The function must not block, because it runs under
/// the lock of the event journal. It delays the code that reports the event, possibly the task of a bus line.
pub type EventListener = Arc<dyn Fn(ReportedEvent<'_>) + Send + Sync>;

/// Parts of an event's text that the log of the program contains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LoggedText {
    /// The log contains subject, cause and hint.
    #[default]
    WithHint,
    /// The log contains subject and cause. A command that prints the hints itself uses this variant.
    WithoutHint,
}

/// Events of this run, and the last events of earlier runs.
pub struct Journal {
    /// Clock for the time stamps of events and acknowledgements.
    clock: Clock,
    pages: Mutex<Pages>,
    listener: Option<EventListener>,
    logged_text: LoggedText,
}

impl fmt::Debug for Journal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Journal").field("pages", &self.pages).finish_non_exhaustive()
    }
}

#[derive(Debug, Default)]
struct Pages {
    last: VecDeque<Entry>,
    counts: BTreeMap<&'static str, u64>,
    alarms: Alarms,
    /// Number of events in `last` that earlier runs of the gateway have reported.
    restored: usize,
    unkept: Option<UnsavedEvents>,
}

/// Events that are not on disk yet, the number of lost events, and the callback that wakes the writer.
struct UnsavedEvents {
    entries: VecDeque<Entry>,
    lost: u64,
    wake: Option<Box<dyn Fn() + Send>>,
}

impl fmt::Debug for UnsavedEvents {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "UnsavedEvents({} waiting, {} lost)", self.entries.len(), self.lost)
    }
}

impl UnsavedEvents {
    fn push(&mut self, at: Moment, entry: Entry) {
        // If events were lost, the first entry after them reports their number.
        let is_full = self.entries.len() + 2 > UNKEPT;
        if !is_full && self.lost > 0 {
            let lost = Event::EventsLost { count: std::mem::take(&mut self.lost) };
            self.entries.push_back(lost.entry(at));
        }
        if is_full {
            self.lost += 1;
        } else {
            self.entries.push_back(entry);
        }
        self.wake.iter().for_each(|wake| wake());
    }
}

impl Journal {
    /// Creates an empty event journal.
    pub fn by(clock: &Clock) -> Journal {
        Journal {
            clock: clock.clone(),
            pages: Mutex::default(),
            listener: None,
            logged_text: LoggedText::default(),
        }
    }

    /// Adds a listener, which receives every event from now on. With `None`, there is no listener.
    #[must_use]
    pub fn heard_by(self, listener: Option<EventListener>) -> Journal {
        Journal { listener, ..self }
    }

    /// Sets which parts of an event's text the log contains.
    #[must_use]
    pub fn logging(self, logged_text: LoggedText) -> Journal {
        Journal { logged_text, ..self }
    }

    /// Reports an event to the log, the counter, the web page and the disk.
    pub fn report(&self, at: Moment, event: &Event) {
        let at = self.clock.stamp(at);
        let entry = event.entry(at);
        let kind = event.kind();
        let text: Cow<'_, str> = match self.logged_text {
            LoggedText::WithHint => entry.text.as_str().into(),
            LoggedText::WithoutHint => event.text_without_hint().into(),
        };
        let name = kind.name();
        match entry.level {
            Level::Info => tracing::info!(kind = name, "{text}"),
            Level::Warning => tracing::warn!(kind = name, "{text}"),
            Level::Error => tracing::error!(kind = name, "{text}"),
        }
        let mut pages = self.pages();
        *pages.counts.entry(name).or_default() += 1;
        let change = pages.alarms.note(kind, &entry);
        if let Some(listener) = &self.listener {
            listener(ReportedEvent { event, entry: &entry, change: &change });
        }
        if let Some(unkept) = &mut pages.unkept {
            unkept.push(at, entry.clone());
        }
        pages.show(entry);
    }

    /// Returns the last events, oldest first, and the number of events of each kind since the start.
    pub fn read(&self) -> (Vec<Entry>, BTreeMap<&'static str, u64>) {
        let pages = self.pages();
        (pages.last.iter().cloned().collect(), pages.counts.clone())
    }

    /// Returns the active alarms, newest first.
    pub fn alarms(&self) -> Vec<Alarm> {
        self.pages().alarms.all()
    }

    /// Acknowledges one alarm, or all active alarms if `id` is `None`. Returns the number of alarms that were not
    /// acknowledged before. Returns `None` if the alarm does not exist.
    pub fn acknowledge(&self, at: Moment, id: Option<&str>, by: String) -> Option<usize> {
        let seen = Acknowledgement { at: self.clock.stamp(at).to_string(), by };
        self.pages().alarms.acknowledge(id, &seen)
    }

    /// Adds events that were reported before the start, oldest first. They are shown, but neither counted nor written
    /// to disk again.
    pub fn recall(&self, before: Vec<Entry>) {
        let mut pages = self.pages();
        let since = std::mem::take(&mut pages.last);
        pages.restored = before.len();
        before.into_iter().chain(since).for_each(|entry| pages.show(entry));
    }

    /// Begins to keep events in memory until they are on disk, including the events that were reported before this
    /// call. Calls `wake` when there are events to write.
    pub fn keep(&self, wake: impl Fn() + Send + 'static) {
        let mut pages = self.pages();
        let entries: VecDeque<Entry> = pages.last.iter().skip(pages.restored).cloned().collect();
        if !entries.is_empty() {
            wake();
        }
        pages.unkept = Some(UnsavedEvents { entries, lost: 0, wake: Some(Box::new(wake)) });
    }

    /// Removes the callback that [`Journal::keep`] has set, because the writer of the event files ends.
    pub fn wake_nobody(&self) {
        if let Some(unkept) = &mut self.pages().unkept {
            unkept.wake = None;
        }
    }

    /// Returns the oldest events that are not on disk yet, at most `most`.
    pub fn unkept(&self, most: usize) -> Vec<Entry> {
        let pages = self.pages();
        pages.unkept.iter().flat_map(|unkept| &unkept.entries).take(most).cloned().collect()
    }

    /// Removes the oldest unsaved event, because it was written to disk.
    pub fn kept(&self) {
        if let Some(unkept) = &mut self.pages().unkept {
            unkept.entries.pop_front();
        }
    }

    fn pages(&self) -> MutexGuard<'_, Pages> {
        self.pages.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Pages {
    fn show(&mut self, entry: Entry) {
        if self.last.len() == SHOWN {
            self.last.pop_front();
            self.restored = self.restored.saturating_sub(1);
        }
        self.last.push_back(entry);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(journal: &Journal, second: u64) {
        let at = Moment::from_nanos(second * 1_000_000_000);
        journal.report(at, &Event::KeptAgain { what: format!("number {second}") });
    }

    #[test]
    fn what_happened_before_the_disk_was_there_is_kept_and_what_a_hanging_disk_costs_is_reported() {
        let journal = Journal::by(&Clock::simulated(Moment::default(), None));
        report(&journal, 1);
        journal.keep(|| {});
        let many = u64::try_from(UNKEPT).unwrap() + 5;
        (2..=many).for_each(|second| report(&journal, second));
        let texts = |journal: &Journal| -> Vec<String> {
            journal.unkept(usize::MAX).into_iter().map(|entry| entry.text).collect()
        };
        assert_eq!(texts(&journal)[0], "number 1 is saved again");
        assert_eq!(texts(&journal).len(), UNKEPT - 1);
        (0..10).for_each(|_| journal.kept());
        report(&journal, many + 1);
        let left = texts(&journal);
        assert_eq!(
            left[left.len() - 2],
            "the disk did not save 6 events in time: the saved events have a gap; check whether the \
             disk is full, slow or broken"
        );
        assert_eq!(left[left.len() - 1], format!("number {} is saved again", many + 1));
    }

    #[test]
    fn what_happened_before_the_start_is_shown_before_the_rest_and_not_counted() {
        let (before, journal) = (
            Journal::by(&Clock::simulated(Moment::default(), None)),
            Journal::by(&Clock::simulated(Moment::default(), None)),
        );
        (1..=SHOWN as u64).for_each(|second| report(&before, second));
        report(&journal, 1000);
        journal.recall(before.read().0);
        let (shown, counts) = journal.read();
        assert_eq!((shown.len(), counts["kept-again"]), (SHOWN, 1));
        assert_eq!(shown[0].text, "number 2 is saved again");
        assert_eq!(shown[SHOWN - 1].text, "number 1000 is saved again");
    }
}
