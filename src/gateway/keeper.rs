//! Keeps the log and the state on disk, by a thread of its own: a full or slow disk changes nothing on the bus.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use super::disk::{Disk, Files};
use super::log::Recorder;
use super::memory::Memory;
use super::output::OutputState;
use crate::compensation::{Compensation, Control, Snapshot};
use crate::observe::events::{Event, Journal};
use crate::profile::Profile;
use crate::quantity::Moment;

/// The state is written at most this often, and once at the end.
const REMEMBER_EVERY: Duration = Duration::from_secs(10);
/// The log begins a new file at midnight, UTC; in nanoseconds.
const A_DAY: u64 = 86_400_000_000_000;
/// How long the end of a run waits for the disk.
const LAST_PATIENCE: Duration = Duration::from_secs(5);
/// Rows that may wait for a slow disk; more are dropped, and that is told.
const QUEUE: usize = 4096;

/// Whether a log has this header and ends with a whole row: one that a power cut left half-written would swallow the
/// next.
fn continues(path: &Path, header: &[u8]) -> std::io::Result<bool> {
    let mut file = File::open(path)?;
    let mut begins = vec![0; header.len()];
    if file.metadata()?.len() < u64::try_from(header.len()).unwrap_or(u64::MAX) {
        return Ok(false);
    }
    file.read_exact(&mut begins)?;
    let mut last = [0];
    file.seek(SeekFrom::End(-1))?;
    file.read_exact(&mut last)?;
    Ok(begins == header && last == *b"\n")
}

/// The loop's end of the queue. Without a directory it keeps nothing.
#[derive(Debug, Default)]
pub(super) struct Keeper {
    queue: Option<SyncSender<Job>>,
    recorder: Option<Recorder>,
    /// Rows and states that found the queue full.
    dropped: u64,
    remembered: Option<Moment>,
    /// The day of the file in which the rows stand.
    day: Option<u64>,
    /// Rows are missing on disk: what follows them can be replayed only from where the axes stand then.
    torn: Arc<AtomicBool>,
    /// Ends with the thread.
    working: Option<Receiver<()>>,
    /// Without a thread, and without a log: where the state is put at once.
    here: Option<(Arc<dyn Disk>, PathBuf)>,
}

#[derive(Debug)]
enum Job {
    Row(Moment, Vec<u8>),
    State(Box<Memory>),
}

impl Keeper {
    /// Keeps the log and the state of this machine in this directory.
    pub(super) fn start(profile: &Profile, directory: &Path, dry_run: bool, journal: Arc<Journal>) -> Keeper {
        let (queue, jobs) = sync_channel(QUEUE);
        let torn = Arc::new(AtomicBool::new(false));
        let mut desk = Desk {
            torn: Arc::clone(&torn),
            directory: directory.to_owned(),
            machine: profile.name.clone(),
            header: if dry_run { Recorder::dry_header(profile) } else { Recorder::header(profile) },
            state: Memory::path(directory, profile),
            keep: profile.history.keep,
            day: String::new(),
            file: None,
            failing: BTreeMap::new(),
            journal,
        };
        let (ends_with_the_thread, working) = sync_channel(0);
        let work = move || {
            desk.work(&jobs);
            drop(ends_with_the_thread);
        };
        // Without a thread nothing is kept: the queue finds nobody at its other end.
        let _ = std::thread::Builder::new().name("keeper".to_owned()).spawn(work);
        let recorder = Some(Recorder::new(profile).of_dry_run(dry_run));
        Keeper {
            queue: Some(queue),
            recorder,
            dropped: 0,
            remembered: None,
            day: None,
            torn,
            working: Some(working),
            here: None,
        }
    }

    /// Keeps the state alone, at once, on this disk.
    pub(super) fn without_log(disk: Arc<dyn Disk>, state: PathBuf) -> Keeper {
        Keeper { here: Some((disk, state)), ..Keeper::default() }
    }

    /// Before a step: where its row is the first of a file, or rows before it are lost, the row tells where the axes
    /// stood, so that it can be replayed without them.
    pub(super) fn prepare(&mut self, now: Moment, compensation: &Compensation) {
        let Some(recorder) = &mut self.recorder else { return };
        let day = Some(now.as_nanos() / A_DAY);
        if self.day != day || self.torn.load(Ordering::Relaxed) {
            self.day = day;
            self.torn.store(false, Ordering::Relaxed);
            recorder.begin(&compensation.running());
        }
    }

    /// Queues one row of the log.
    pub(super) fn record(
        &mut self,
        snapshot: &Snapshot<'_>,
        controls: &[Control],
        compensation: &Compensation,
    ) {
        if let Some(recorder) = &mut self.recorder {
            let row = recorder.row(snapshot, controls, compensation.decisions()).to_vec();
            self.hand_over(Job::Row(snapshot.now, row));
        }
    }

    /// "Zero" was commanded at this moment.
    pub(super) fn zeroed(&mut self, at: Moment) {
        if let Some(recorder) = &mut self.recorder {
            recorder.zeroed(at);
        }
    }

    /// Queues the state, if the last time was long enough ago.
    pub(super) fn remember(
        &mut self,
        now: Moment,
        compensation: &Compensation,
        profile: &Profile,
        outputs: &[OutputState],
    ) {
        if self.remembered.is_none_or(|last| now.since(last) >= REMEMBER_EVERY) {
            self.remembered = Some(now);
            self.remember_now(now, compensation, profile, outputs);
        }
    }

    /// Queues the state.
    pub(super) fn remember_now(
        &mut self,
        now: Moment,
        compensation: &Compensation,
        profile: &Profile,
        outputs: &[OutputState],
    ) {
        if self.queue.is_none() && self.here.is_none() {
            return;
        }
        let verified = profile.outputs.iter().zip(outputs).filter(|(output, _)| output.writes.is_cz());
        let verified =
            verified.filter_map(|(output, state)| Some((output.name.clone(), state.cz?.get()))).collect();
        let memory = Memory::new(profile, now, compensation.remembered(), verified);
        match &self.here {
            // The next one comes soon.
            Some((disk, state)) => drop(memory.save(&**disk, state)),
            None => self.hand_over(Job::State(Box::new(memory))),
        }
    }

    /// Waits until everything queued is on disk; not for ever, where the disk hangs.
    pub(super) fn finish(&mut self) {
        self.queue = None;
        if let Some(working) = self.working.take() {
            let _ = working.recv_timeout(LAST_PATIENCE);
        }
    }

    /// Rows of the log and states that a slow disk has cost since the start.
    pub(super) fn dropped(&self) -> u64 {
        self.dropped
    }

    fn hand_over(&mut self, job: Job) {
        // A full queue means a disk that has been failing for long, which its own event has told.
        let Some(queue) = &self.queue else { return };
        match queue.try_send(job) {
            Ok(()) => {}
            Err(TrySendError::Full(_)) => {
                self.dropped += 1;
                self.torn.store(true, Ordering::Relaxed);
            }
            Err(TrySendError::Disconnected(_)) => self.queue = None,
        }
    }
}

/// The disk's end of the queue.
struct Desk {
    directory: PathBuf,
    machine: String,
    header: String,
    state: PathBuf,
    keep: Duration,
    day: String,
    file: Option<File>,
    failing: BTreeMap<&'static str, ()>,
    torn: Arc<AtomicBool>,
    journal: Arc<Journal>,
}

impl Desk {
    fn work(&mut self, jobs: &Receiver<Job>) {
        while let Ok(job) = jobs.recv() {
            match job {
                Job::Row(at, row) => {
                    let done = self.write_row(at, &row);
                    if done.is_err() {
                        self.file = None;
                        self.torn.store(true, Ordering::Relaxed);
                    }
                    self.report(at, "the log", done);
                }
                Job::State(memory) => {
                    let done = memory.save(&Files, &self.state);
                    self.report(memory.at, "the state", done);
                }
            }
        }
    }

    fn write_row(&mut self, at: Moment, row: &[u8]) -> std::io::Result<()> {
        let day = at.to_string().chars().take(10).collect::<String>();
        if self.file.is_none() || day != self.day {
            self.file = Some(self.open(&day)?);
            self.day = day;
            self.discard_old(at);
        }
        let Some(file) = &mut self.file else { return Ok(()) };
        file.write_all(row)
    }

    /// The day's file. One that was begun with other columns is left as it is and a new one is begun beside it.
    fn open(&self, day: &str) -> std::io::Result<File> {
        std::fs::create_dir_all(&self.directory)?;
        for part in 1.. {
            let suffix = if part == 1 { String::new() } else { format!(".{part}") };
            let path = self.directory.join(format!("{}-{day}{suffix}.csv", self.machine));
            let mut file = OpenOptions::new().create(true).append(true).open(&path)?;
            if file.metadata()?.len() == 0 {
                file.write_all(self.header.as_bytes())?;
                return Ok(file);
            }
            if continues(&path, self.header.as_bytes())? {
                return Ok(file);
            }
        }
        Err(std::io::Error::other("no free name for the log"))
    }

    fn discard_old(&self, now: Moment) {
        let oldest = Moment::from_nanos(
            now.as_nanos().saturating_sub(u64::try_from(self.keep.as_nanos()).unwrap_or(u64::MAX)),
        );
        let oldest = oldest.to_string().chars().take(10).collect::<String>();
        let Ok(entries) = std::fs::read_dir(&self.directory) else { return };
        for entry in entries.flatten() {
            let name = entry.file_name();
            let day = name.to_str().and_then(|name| name.strip_prefix(&format!("{}-", self.machine)));
            let day = day.filter(|rest| rest.ends_with(".csv")).and_then(|rest| rest.get(..10));
            if day.is_some_and(|day| day.as_bytes()[4] == b'-' && day < oldest.as_str()) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }

    fn report(&mut self, at: Moment, what: &'static str, done: std::io::Result<()>) {
        match done {
            Ok(()) => {
                if self.failing.remove(what).is_some() {
                    self.journal.tell(at, &Event::KeptAgain { what: what.to_owned() });
                }
            }
            Err(error) => {
                if self.failing.insert(what, ()).is_none() {
                    let why = format!("{}: {error}", self.directory.display());
                    self.journal.tell(at, &Event::NotKept { what: what.to_owned(), why });
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
