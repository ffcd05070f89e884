//! A process that is measured.

use std::process::{Child, Command};

/// Killed at the end.
pub(crate) struct Process(Child);

impl Process {
    pub(crate) fn start(command: &mut Command) -> Process {
        Process(command.spawn().unwrap())
    }

    /// Seconds of the processor, user and system, of all its threads: those that are still there.
    pub(crate) fn busy(&self) -> f64 {
        let spent = |text: &str| -> Option<f64> { text.split_whitespace().next()?.parse().ok() };
        1e-9 * self.of_threads("schedstat", spent).sum::<f64>()
    }

    /// How often its threads have waited for something, and were woken.
    #[allow(dead_code, reason = "one of the benches counts them")]
    pub(crate) fn wakes(&self) -> u64 {
        let waited = |text: &str| -> Option<u64> {
            let count = text.split("\nvoluntary_ctxt_switches:").nth(1)?;
            count.split_whitespace().next()?.parse().ok()
        };
        self.of_threads("status", waited).sum()
    }

    /// What this file says of each of its threads.
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
