//! Daily learning: a thread starts `isotherm learn` as a child process, and passes its candidates (proposed
//! models) to the axes.
//!
//! ```text
//! start ──(10 min)──► learned less than 20 h ago? ──no──► child ──► candidates ──► axes
//!                       │ yes                                ▲
//!                       └──────────(24 h later)──────────────┘
//! ```
//!
//! - The child runs with the lowest priority, and sets a limit for its own memory. The bus lines do not wait for the
//!   child.
//! - The thread reads the candidates when the gateway starts, after each child, and when an operator has run
//!   `isotherm learn`.
//! - A child is killed if it runs for more than an hour, or if the gateway stops.

use std::ffi::OsString;
use std::io::Read;
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::gateway::shared::shared_state::Shared;
use crate::gateway::store::candidates;
use crate::gateway::store::disk::Files;
use crate::observe::events::{Adoption, Event};
use isotherm_profile::one_line;
use isotherm_profile::safe_file::cut;

/// Interval of the checks whether the child process has ended.
const CHECKED_EVERY: Duration = Duration::from_millis(500);
/// Interval of the checks whether an operator has run `isotherm learn`, which writes new candidates (proposed
/// models).
const WATCHED_EVERY: Duration = Duration::from_secs(2);
/// Maximum duration of one run of the child process (`isotherm learn`). After this time, the gateway kills the child.
const LONGEST: Duration = Duration::from_secs(3600);
/// Maximum length of the child's messages that the gateway reads, in bytes.
const MOST_SAID: u64 = 64 * 1024;
/// Maximum length of a message in an event, in characters.
const SHOWN: usize = 300;

/// Program that learns: `isotherm learn` with the arguments of the gateway.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LearnCommand {
    /// Path of the program.
    pub program: PathBuf,
    /// Arguments of the program.
    pub arguments: Vec<OsString>,
    /// Times at which the gateway starts the program.
    pub times: LearnTimes,
}

/// Times at which the gateway starts the learning program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LearnTimes {
    /// Time between the start of the gateway and the first check whether the learning program must run.
    pub first: Duration,
    /// Interval between two starts of the learning program.
    pub every: Duration,
    /// Limit for the age of the last learning. If the last learning is younger at the first check, the gateway does
    /// not start the learning program.
    pub recent: Duration,
}

impl Default for LearnTimes {
    fn default() -> LearnTimes {
        LearnTimes {
            first: Duration::from_mins(10),
            every: Duration::from_hours(24),
            recent: Duration::from_hours(20),
        }
    }
}

/// Thread that starts the learning program. Dropping it ends the thread and a running child.
#[derive(Debug)]
pub(in crate::gateway) struct Learner {
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for Learner {
    fn drop(&mut self) {
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Learner {
    /// Starts the learning thread, and reads the candidates (proposed models) at once. Returns `None` if no axis
    /// learns, no program is given, or the thread cannot be started.
    pub(in crate::gateway) fn start(
        shared: Arc<Shared>,
        command: Option<LearnCommand>,
        directory: PathBuf,
    ) -> Option<Learner> {
        let axes: Vec<usize> = (0..shared.profile.axes.len())
            .filter(|axis| shared.profile.axes[*axis].learning.is_some())
            .collect();
        if axes.is_empty() {
            return None;
        }
        let (stop, stopped) = channel();
        let mut work = Work { shared, axes, directory, stopped, read: Vec::new() };
        work.take_candidates();
        let command = command?;
        let run = move || work.run(&command);
        // Without a thread no model is learned, and the axes keep theirs.
        let thread = std::thread::Builder::new().name("learner".to_owned()).spawn(run).ok()?;
        Some(Learner { stop: Some(stop), thread: Some(thread) })
    }
}

/// Work of the learning thread: starts the learning program, and passes its candidates to the axes.
struct Work {
    shared: Arc<Shared>,
    /// Indices of the axes that learn a model.
    axes: Vec<usize>,
    directory: PathBuf,
    /// Channel that is closed when the gateway stops.
    stopped: Receiver<()>,
    /// Version of the candidate file that was read last, for each axis that learns. `None` if the file did not exist.
    read: Vec<Option<Version>>,
}

/// Version of a file: its inode, and the time of its last change in s and ns.
type Version = (u64, i64, i64);

impl Work {
    fn run(mut self, command: &LearnCommand) {
        let LearnTimes { first, every, recent } = command.times;
        if !self.watches(first) {
            return;
        }
        loop {
            let wait = match self.age().filter(|age| *age < recent) {
                Some(age) => every.saturating_sub(age),
                None => {
                    match self.learn(command) {
                        Ok(()) => self.take_candidates(),
                        Err(LearnFailure::Stopped) => return,
                        Err(LearnFailure::Failed(why)) => {
                            self.shared.report(&Event::Adoption(Adoption::Failed { why }));
                        }
                    }
                    every
                }
            };
            if !self.watches(wait) {
                return;
            }
        }
    }

    /// Waits for `span`. Meanwhile, passes each new candidate (proposed model) that `isotherm learn` writes to its
    /// axis. Returns `false` if the gateway stops.
    fn watches(&mut self, span: Duration) -> bool {
        let mut rest = span;
        loop {
            let part = rest.min(WATCHED_EVERY);
            if !self.waits(part) {
                return false;
            }
            if self.versions() != self.read {
                self.take_candidates();
            }
            rest = rest.saturating_sub(part);
            if rest.is_zero() {
                return true;
            }
        }
    }

    /// Returns the version of each axis' candidate file; `None` if the file does not exist.
    fn versions(&self) -> Vec<Option<Version>> {
        let version = |axis: &usize| {
            let profile = &self.shared.profile;
            let path = candidates::path(&self.directory, &profile.name, &profile.axes[*axis].settings.name);
            let file = std::fs::metadata(path).ok()?;
            Some((file.ino(), file.mtime(), file.mtime_nsec()))
        };
        self.axes.iter().map(version).collect()
    }

    /// Waits for `span`. Returns `false` if the gateway stops.
    fn waits(&self, span: Duration) -> bool {
        self.stopped.recv_timeout(span) == Err(RecvTimeoutError::Timeout)
    }

    /// Returns the age of the oldest learning record of these axes, by the computer's clock. `None` if an axis has no
    /// record, or if the clock was set back.
    fn age(&self) -> Option<Duration> {
        let products = candidates::products(&self.directory, &self.shared.profile.name);
        let modified = |axis: &usize| {
            let name = &self.shared.profile.axes[*axis].settings.name;
            let record = std::fs::metadata(products.join(format!("{name}.learning.json"))).ok()?;
            u64::try_from(record.mtime()).ok()
        };
        // The oldest record counts, because each axis must be learned.
        let oldest = self.axes.iter().map(modified).collect::<Option<Vec<u64>>>()?.into_iter().min()?;
        let now = self.shared.clock.stamp(self.shared.clock.now()).as_nanos() / 1_000_000_000;
        now.checked_sub(oldest).map(Duration::from_secs)
    }

    /// Reads the candidate (proposed model) of each axis, and passes the candidate to the axis.
    fn take_candidates(&mut self) {
        self.read = self.versions();
        let place = (self.directory.as_path(), self.shared.profile.name.as_str());
        for axis in &self.axes {
            let name = &self.shared.profile.axes[*axis].settings.name;
            let offer = candidates::read(&Files, place, name).unwrap_or_else(|why| {
                self.shared.report(&Event::Adoption(Adoption::Failed { why }));
                None
            });
            self.shared.core().take_candidate(*axis, offer);
        }
        self.shared.wake();
    }

    /// Runs the learning program until it ends. An error means that the program failed, or that the gateway stops.
    fn learn(&self, command: &LearnCommand) -> Result<(), LearnFailure> {
        let shown = command.program.display();
        let cannot =
            |error: std::io::Error| LearnFailure::Failed(format!("{shown} cannot be started: {error}"));
        let mut started = Command::new(&command.program);
        started.args(&command.arguments).env_remove("NOTIFY_SOCKET").env("RAYON_NUM_THREADS", "1");
        started.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).process_group(0);
        let mut child = started.spawn().map_err(cannot)?;
        let said = child.stderr.take().map(|stderr| {
            std::thread::spawn(move || {
                let mut text = Vec::new();
                let _ = stderr.take(MOST_SAID).read_to_end(&mut text);
                String::from_utf8_lossy(&text).into_owned()
            })
        });
        let ended = self.ended(&mut child);
        if ended.is_err() {
            kill(&mut child);
        }
        let said = said.and_then(|thread| thread.join().ok()).unwrap_or_default();
        match ended? {
            status if status.success() => Ok(()),
            status => Err(LearnFailure::Failed(cause(status, &said))),
        }
    }

    /// Waits until the child process has ended, and returns its exit status. An error means that the child runs for
    /// too long, or that the gateway stops.
    fn ended(&self, child: &mut Child) -> Result<ExitStatus, LearnFailure> {
        let mut waited = Duration::ZERO;
        loop {
            match child.try_wait() {
                Ok(Some(status)) => return Ok(status),
                Ok(None) => {}
                Err(error) => return Err(LearnFailure::Failed(error.to_string())),
            }
            if !self.waits(CHECKED_EVERY) {
                return Err(LearnFailure::Stopped);
            }
            waited += CHECKED_EVERY;
            if waited >= LONGEST {
                return Err(LearnFailure::Failed(
                    "the learning program ran for more than an hour and was killed".to_owned(),
                ));
            }
        }
    }
}

/// Returns why the child failed, from its exit status and its messages. The kernel kills a child that uses too much
/// memory, and then the child has no message.
fn cause(status: ExitStatus, said: &str) -> String {
    if status.signal() == Some(rustix::process::Signal::KILL.as_raw()) {
        return "the learning program was killed, probably because it took more memory than this computer or the \
                service (`MemoryMax`) allows"
            .to_owned();
    }
    match said.lines().rev().find(|line| !line.trim().is_empty()) {
        Some(last) => format!("{status}: {}", cut(&one_line(last), SHOWN)),
        None => format!("{status}, without a message"),
    }
}

/// Kills the child and all processes that the child has started.
fn kill(child: &mut Child) {
    let group = i32::try_from(child.id()).ok().and_then(rustix::process::Pid::from_raw);
    if let Some(group) = group {
        let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
    }
    let _ = child.kill();
    let _ = child.wait();
}

/// Reason why the learning program has written no candidate.
enum LearnFailure {
    /// The gateway stops.
    Stopped,
    /// The program failed. Contains the cause, as a part of a sentence.
    Failed(String),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_end_of_the_learning_program_has_a_cause() {
        // The low seven bits of a raw status are the signal, the next byte is the exit code.
        let exit = ExitStatus::from_raw;
        assert_eq!(cause(exit(1 << 8), "begin\nno touch\n \n"), "exit status: 1: no touch");
        assert_eq!(cause(exit(1 << 8), "\n"), "exit status: 1, without a message");
        let aborted = cause(exit(6), "memory allocation of 9 bytes failed");
        assert!(aborted.ends_with("memory allocation of 9 bytes failed"), "{aborted}");
        for said in ["", "learning"] {
            let killed = cause(exit(9), said);
            assert!(killed.contains("memory") && killed.contains("`MemoryMax`"), "{killed}");
        }
    }
}
