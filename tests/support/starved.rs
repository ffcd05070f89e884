//! How long the computer keeps the threads of a process from the processor, by the kernel's own account (`schedstat`). What a busy
//! computer delays is no fault of the program.

#![allow(dead_code, reason = "each of the tests uses its part")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;

/// Pause between two looks at the account. A wait is counted when it is over.
const EVERY: Duration = Duration::from_millis(50);

/// The waits of one process, until this is dropped.
pub(crate) struct Starved {
    seen: Arc<Mutex<Seen>>,
    ends: Arc<AtomicBool>,
}

/// Waits that were seen so far.
struct Seen {
    process: u32,
    clock: Clock,
    last: Moment,
    /// Time that each thread has waited since it began.
    before: BTreeMap<PathBuf, Duration>,
    /// By look: its beginning, its end, and the longest wait of one thread in between.
    waits: Vec<(Moment, Moment, Duration)>,
}

impl Starved {
    /// Watches a process from now on.
    pub(crate) fn of(process: u32) -> Starved {
        let clock = Clock::wall();
        let last = clock.now();
        let mut seen = Seen { process, clock, last, before: BTreeMap::new(), waits: Vec::new() };
        seen.look();
        let (seen, ends) = (Arc::new(Mutex::new(seen)), Arc::new(AtomicBool::new(false)));
        let (looks, until) = (seen.clone(), ends.clone());
        std::thread::spawn(move || {
            while !until.load(Ordering::Relaxed) {
                looks.lock().unwrap().look();
                std::thread::sleep(EVERY);
            }
        });
        Starved { seen, ends }
    }

    /// Longest wait so far: of one thread, within one look.
    pub(crate) fn longest(&self) -> Duration {
        let mut seen = self.seen.lock().unwrap();
        seen.look();
        seen.waits.iter().map(|(.., wait)| *wait).max().unwrap_or_default()
    }

    /// Sum of the waits between two moments: of the thread that waited longest within each look.
    pub(crate) fn between(&self, from: Moment, to: Moment) -> Duration {
        let mut seen = self.seen.lock().unwrap();
        seen.look();
        let about = seen.waits.iter().filter(|(begun, ended, _)| *ended >= from && *begun <= to);
        about.map(|(.., wait)| *wait).sum()
    }
}

impl Drop for Starved {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
    }
}

impl Seen {
    fn look(&mut self) {
        let mut longest = Duration::ZERO;
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.process)).into_iter().flatten().flatten();
        for task in tasks.map(|task| task.path()) {
            let waited = waited(&task);
            let before = self.before.insert(task, waited).unwrap_or(waited);
            longest = longest.max(waited.saturating_sub(before));
        }
        let now = self.clock.now();
        self.waits.push((self.last, now, longest));
        self.last = now;
    }
}

/// Time that a thread has waited for a processor since it began. Zero if the kernel does not say it.
fn waited(task: &Path) -> Duration {
    let account = std::fs::read_to_string(task.join("schedstat")).unwrap_or_default();
    let nanos = account.split_whitespace().nth(1).and_then(|nanos| nanos.parse().ok());
    Duration::from_nanos(nanos.unwrap_or_default())
}

/// Time that the calling thread has waited for a processor since it began.
pub(crate) fn this_thread() -> Duration {
    waited(Path::new("/proc/thread-self"))
}

/// Group of a process and its processor time so far, in ticks, by its `/proc/…/stat`. The time of children that it has waited for is
/// part of it.
pub(crate) fn worked(stat: &str) -> Option<(u64, u64)> {
    // "1234 (name) S parent group …": the name may hold anything, a bracket too.
    let words: Vec<&str> = stat.rsplit_once(") ")?.1.split_whitespace().collect();
    let number = |place: usize| words.get(place).and_then(|word| word.parse::<u64>().ok());
    Some((number(2)?, number(11)? + number(12)? + number(13)? + number(14)?))
}
