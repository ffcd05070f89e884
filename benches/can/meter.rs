//! Processor time and number of sleeps of a process.
//!
//! Processor time is the time in nanoseconds that the kernel's scheduler has counted for the process. A user-mode
//! kernel counts in steps of 10 ms, which is too coarse. However, it runs each of its processes as a process of the
//! host, and its own kernel work in another one. On a user-mode kernel, the runner of these benchmarks therefore reads
//! the times on the host. Both exchange files in the directory `ISOTHERM_METER`: an empty file `ask.N` is the request,
//! and `answer.N` the reply. The reply has one line `process nanoseconds` for each process on the host.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::time::Duration;

/// A process whose processor time and sleeps are measured.
pub(crate) struct Meter {
    /// Process id here.
    process: u32,
    /// Process id on the host of the user-mode kernel; `None` without one.
    around: Option<(Around, u32)>,
}

impl Meter {
    /// Starts a process. No other process may start or end during the call.
    pub(crate) fn on(start: impl FnOnce() -> Child) -> (Child, Meter) {
        let Some(directory) = std::env::var_os("ISOTHERM_METER") else {
            let child = start();
            let process = child.id();
            return (child, Meter { process, around: None });
        };
        let mut around = Around { directory: directory.into(), asked: 0 };
        let before = around.ask();
        let child = start();
        // Between fork and exec, the new process has two processes on the host.
        std::thread::sleep(Duration::from_secs(1));
        let new: Vec<u32> =
            around.ask().into_keys().filter(|process| !before.contains_key(process)).collect();
        let [outside] = new[..] else { panic!("one process has started, around it there are new: {new:?}") };
        let process = child.id();
        (child, Meter { process, around: Some((around, outside)) })
    }

    /// Returns the processor time so far. On a user-mode kernel it does not include the time of the kernel.
    pub(crate) fn busy(&mut self) -> Duration {
        let nanoseconds = match &mut self.around {
            Some((around, outside)) => around.ask()[outside],
            None => {
                let text = std::fs::read_to_string(format!("/proc/{}/schedstat", self.process)).unwrap();
                text.split(' ').next().unwrap().parse().unwrap()
            }
        };
        Duration::from_nanos(nanoseconds)
    }

    /// Returns how often the process has gone to sleep so far.
    pub(crate) fn sleeps(&self) -> u64 {
        let text = std::fs::read_to_string(format!("/proc/{}/status", self.process)).unwrap();
        let line = text.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
        line.unwrap().trim().parse().unwrap()
    }
}

struct Around {
    directory: PathBuf,
    asked: u32,
}

impl Around {
    fn ask(&mut self) -> BTreeMap<u32, u64> {
        self.asked += 1;
        std::fs::write(self.file("ask"), "").unwrap();
        let answer = self.file("answer");
        let mut patience = 1000;
        while !Path::exists(&answer) {
            patience -= 1;
            assert!(patience > 0, "nobody answers {}", self.file("ask").display());
            std::thread::sleep(Duration::from_millis(10));
        }
        let text = std::fs::read_to_string(answer).unwrap();
        let pairs = text.lines().filter_map(|line| line.split_once(' '));
        pairs.map(|(process, spent)| (process.parse().unwrap(), spent.parse().unwrap())).collect()
    }

    fn file(&self, name: &str) -> PathBuf {
        self.directory.join(format!("{name}.{}", self.asked))
    }
}
