//! Rate limit for the log on stderr: at most ten lines of one kind in a second. After that second, one line reports the
//! number of dropped lines.
//!
//! The kind of a line is its location in the source code. All events are logged from one location, so for them the kind
//! of event is also used. Only log lines are dropped: every event is stored, counted and shown.

use std::collections::HashMap;
use std::fmt;
use std::hash::Hash;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tracing::callsite::Identifier;
use tracing::field::{Field, Visit};
use tracing::{Event, Metadata};
use tracing_subscriber::layer::{Context, Filter};

use crate::clock::BootClock;

/// Maximum number of lines of one kind within [`SPAN`].
const MOST: u32 = 10;
const SPAN: Duration = Duration::from_secs(1);

/// Kind of a line: its location in the source code, and the kind of event.
type Kind = (Identifier, String);

/// Counts of the log lines of one kind in a window of one second. The window begins with a line of that kind.
#[derive(Debug)]
struct Window {
    since: Duration,
    written: u32,
    left_out: u64,
    /// Name for the dropped lines: their kind of event, or else the start of their message. The line that reports the
    /// number of dropped lines contains this name.
    name: String,
}

/// Counts of recent log lines in a window of one second, for each kind of line. The functions get the time as an
/// argument.
#[derive(Debug)]
struct Budget<K>(HashMap<K, Window>);

impl<K: Eq + Hash> Budget<K> {
    /// Counts a line, and returns whether it may be written.
    fn take(&mut self, kind: K, name: &str, now: Duration) -> bool {
        let fresh = || Window { since: now, written: 0, left_out: 0, name: name.to_owned() };
        let window = self.0.entry(kind).or_insert_with(fresh);
        // A window with dropped lines stays until they are reported.
        if now >= window.since + SPAN && window.left_out == 0 {
            *window = fresh();
        }
        let is_written = window.written < MOST;
        if is_written {
            window.written += 1
        } else {
            window.left_out += 1
        }
        is_written
    }

    /// Removes every window whose second is over. For each removed window with dropped lines, returns its name and the
    /// number of these lines. Also returns whether a remaining window has dropped lines.
    fn due(&mut self, now: Duration) -> (Vec<(String, u64)>, bool) {
        let over = |window: &Window| now >= window.since + SPAN;
        let reported = self.0.values().filter(|window| over(window) && window.left_out > 0);
        let reported = reported.map(|window| (window.name.clone(), window.left_out)).collect();
        self.0.retain(|_, window| !over(window));
        (reported, self.0.values().any(|window| window.left_out > 0))
    }
}

#[derive(Debug)]
struct Shared {
    budget: Budget<Kind>,
    /// Whether a thread is running that will report dropped lines.
    is_telling: bool,
}

/// Filter that drops lines above the rate limit.
#[derive(Clone, Debug)]
pub(super) struct LogRateLimit(Arc<Mutex<Shared>>);

impl LogRateLimit {
    /// Returns a filter that has not counted any line yet.
    pub(super) fn begin() -> LogRateLimit {
        LogRateLimit(Arc::new(Mutex::new(Shared { budget: Budget(HashMap::new()), is_telling: false })))
    }

    fn takes(&self, kind: Kind, name: &str) -> bool {
        let mut shared = self.shared();
        let is_written = shared.budget.take(kind, name, BootClock::default().passed());
        if !is_written && !std::mem::replace(&mut shared.is_telling, true) {
            drop(shared);
            self.tell();
        }
        is_written
    }

    /// Starts a thread that reports dropped lines after a second. A separate thread is needed, because the
    /// code that handles a log line cannot log another line.
    fn tell(&self) {
        let own = self.clone();
        let telling = move || {
            loop {
                std::thread::sleep(SPAN);
                let (reported, continues) = {
                    let mut shared = own.shared();
                    let due = shared.budget.due(BootClock::default().passed());
                    shared.is_telling = due.1;
                    due
                };
                for (name, count) in reported {
                    tracing::warn!("{count} more lines within a second were left out: {name}");
                }
                if !continues {
                    return;
                }
            }
        };
        if std::thread::Builder::new().name("log".to_owned()).spawn(telling).is_err() {
            self.shared().is_telling = false;
        }
    }

    fn shared(&self) -> MutexGuard<'_, Shared> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<S> Filter<S> for LogRateLimit {
    fn enabled(&self, _: &Metadata<'_>, _: &Context<'_, S>) -> bool {
        true
    }

    fn event_enabled(&self, event: &Event<'_>, _: &Context<'_, S>) -> bool {
        let mut said = EventText::default();
        event.record(&mut said);
        let name = if said.kind.is_empty() { &said.message } else { &said.kind };
        self.takes((event.metadata().callsite(), said.kind.clone()), name)
    }
}

/// Kind of an event, and the beginning of its message, taken from the fields of a log line.
#[derive(Default)]
struct EventText {
    kind: String,
    message: String,
}

impl Visit for EventText {
    fn record_str(&mut self, field: &Field, value: &str) {
        if field.name() == "kind" {
            value.clone_into(&mut self.kind);
        }
    }

    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            self.message = format!("{value:?}").chars().take(60).collect();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn milliseconds(milliseconds: u64) -> Duration {
        Duration::from_millis(1000 + milliseconds)
    }

    #[test]
    fn of_a_flood_ten_lines_a_second_are_written_and_the_others_counted() {
        let mut budget = Budget(HashMap::new());
        let written = (0..5000).filter(|_| budget.take("flood", "flood", milliseconds(10))).count();
        assert_eq!(written, 10);
        assert!(budget.take("else", "else", milliseconds(10)), "another kind has its own ten");
        assert_eq!(budget.due(milliseconds(900)), (vec![], true));
        assert!(!budget.take("flood", "flood", milliseconds(1020)), "before it has been told");
        assert_eq!(budget.due(milliseconds(1030)), (vec![("flood".to_owned(), 4991)], false));
        assert!(budget.take("flood", "flood", milliseconds(1031)));
    }

    #[test]
    fn a_line_now_and_then_is_always_written_and_nothing_is_remembered_of_it() {
        let mut budget = Budget(HashMap::new());
        for number in 0..100 {
            assert!(budget.take("slow", "slow", milliseconds(number * 110)), "{number}");
        }
        assert_eq!(budget.due(milliseconds(20_000)), (vec![], false));
        assert!(budget.0.is_empty());
    }
}
