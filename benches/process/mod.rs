//! A measured process.

use std::collections::BTreeMap;
use std::process::{Child, Command};

/// Process that is killed when this value is dropped.
pub(crate) struct Process(Child);

impl Process {
    pub(crate) fn start(command: &mut Command) -> Process {
        Process(command.spawn().unwrap())
    }

    /// Processor time, user and system, of all threads that still exist, in seconds.
    pub(crate) fn busy(&self) -> f64 {
        let spent = |text: &str| -> Option<f64> { text.split_whitespace().next()?.parse().ok() };
        1e-9 * self.of_threads("schedstat", spent).sum::<f64>()
    }

    /// Number of times that its threads have waited and have been woken.
    #[allow(dead_code, reason = "not each benchmark counts them")]
    pub(crate) fn wakes(&self) -> u64 {
        self.wakes_by_thread().values().sum()
    }

    /// Number of times that its threads have waited and have been woken, by the names of the threads.
    #[allow(dead_code, reason = "not each benchmark counts them")]
    pub(crate) fn wakes_by_thread(&self) -> BTreeMap<String, u64> {
        let waited = |text: &str| -> Option<(String, u64)> {
            let name = text.strip_prefix("Name:")?.lines().next()?.trim();
            let count = text.split("\nvoluntary_ctxt_switches:").nth(1)?.split_whitespace().next()?;
            Some((name.to_owned(), count.parse().ok()?))
        };
        let mut wakes: BTreeMap<String, u64> = BTreeMap::new();
        for (name, count) in self.of_threads("status", waited) {
            *wakes.entry(name).or_default() += count;
        }
        wakes
    }

    /// Figure from this file in `/proc`, for each thread.
    fn of_threads<T>(&self, file: &str, figure: impl Fn(&str) -> Option<T>) -> impl Iterator<Item = T> {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.0.id())).unwrap();
        tasks.flatten().filter_map(move |task| figure(&std::fs::read_to_string(task.path().join(file)).ok()?))
    }

    pub(crate) fn memory_mb(&self) -> f64 {
        let text = std::fs::read_to_string(format!("/proc/{}/status", self.0.id())).unwrap();
        let line = text.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
        line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
