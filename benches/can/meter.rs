//! What a process costs: processor time, and how often it sleeps.
//!
//! Processor time is what the kernel's scheduler has counted for the process, in nanoseconds. The user-mode kernel counts
//! its processes in steps of 10 ms, which is too coarse; but each of them runs in a process of the machine around it,
//! with the kernel's own work in another. There the runner of these benches looks it up (`ISOTHERM_METER`, a directory that
//! both see): an empty file `ask.N` is answered by `answer.N`, a line `process nanoseconds` for each that there is.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::time::Duration;

/// A process that is measured.
pub(crate) struct Meter {
    /// Here.
    process: u32,
    /// In the machine around the user-mode kernel.
    around: Option<(Around, u32)>,
}

impl Meter {
    /// Starts a process; nothing else may start or end meanwhile.
    pub(crate) fn on(start: impl FnOnce() -> Child) -> (Child, Meter) {
        let Some(directory) = std::env::var_os("ISOTHERM_METER") else {
            let child = start();
            let process = child.id();
            return (child, Meter { process, around: None });
        };
        let mut around = Around { directory: directory.into(), asked: 0 };
        let before = around.ask();
        let child = start();
        // Between its fork and its exec it has two.
        std::thread::sleep(Duration::from_secs(1));
        let new: Vec<u32> =
            around.ask().into_keys().filter(|process| !before.contains_key(process)).collect();
        let [outside] = new[..] else { panic!("one process has started, around it there are new: {new:?}") };
        let process = child.id();
        (child, Meter { process, around: Some((around, outside)) })
    }

    /// Processor time so far, without the kernel's own where it is the user-mode kernel.
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

    /// How often it has gone to sleep so far.
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
