//! Time for which the threads of a process wait for a processor, from the kernel's accounting (`schedstat`). A delay by
//! a busy computer is no fault of the program.

#![allow(dead_code, reason = "each of the tests uses its part")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;

/// Pause between two samples of the accounting. A wait is counted when it is over.
const EVERY: Duration = Duration::from_millis(50);

/// Records the waits of one process, until it is dropped.
pub(crate) struct Starved {
    seen: Arc<Mutex<Seen>>,
    ends: Arc<AtomicBool>,
}

/// Waits recorded so far.
struct Seen {
    process: u32,
    clock: Clock,
    last: Moment,
    /// Time that each thread has waited since its start.
    before: BTreeMap<PathBuf, Duration>,
    /// For each sample: its beginning, its end, and the longest wait of one thread in between.
    waits: Vec<(Moment, Moment, Duration)>,
}

impl Starved {
    /// Starts to record the waits of a process.
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

    /// Longest wait of one thread between two samples so far.
    pub(crate) fn longest(&self) -> Duration {
        let mut seen = self.seen.lock().unwrap();
        seen.look();
        seen.waits.iter().map(|(.., wait)| *wait).max().unwrap_or_default()
    }

    /// Sum of the waits between two moments: for each sample, that of the thread that waited longest.
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

/// Time that a thread has waited for a processor since its start. Zero if the kernel does not report it.
fn waited(task: &Path) -> Duration {
    let account = std::fs::read_to_string(task.join("schedstat")).unwrap_or_default();
    let nanos = account.split_whitespace().nth(1).and_then(|nanos| nanos.parse().ok());
    Duration::from_nanos(nanos.unwrap_or_default())
}

/// Time that the calling thread has waited for a processor since its start.
pub(crate) fn this_thread() -> Duration {
    waited(Path::new("/proc/thread-self"))
}

/// Group of a process and its processor time so far, in ticks, from its `/proc/…/stat`. This includes the time of
/// children that it has waited for.
pub(crate) fn worked(stat: &str) -> Option<(u64, u64)> {
    // The format is "1234 (name) S parent group …". The name may contain any character, also a parenthesis.
    let words: Vec<&str> = stat.rsplit_once(") ")?.1.split_whitespace().collect();
    let number = |place: usize| words.get(place).and_then(|word| word.parse::<u64>().ok());
    Some((number(2)?, number(11)? + number(12)? + number(13)? + number(14)?))
}
