//! Keeps the logs and the state on disk, by a thread of its own: a full or slow disk changes nothing on the bus.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use super::disk::Disk;
use super::log::Recorder;
use super::memory::Memory;
use super::output::OutputState;
use crate::observe::events::Journal;
use isotherm_core::compensation::{Compensation, Control, Snapshot};
use isotherm_core::quantity::Moment;
use isotherm_profile::Profile;

mod outputs;
mod thread;

use outputs::OutputsLog;
pub(super) use outputs::{Steady, Stepped};
use thread::StorageThread;

/// The state is written at most this often, and once at the end.
const REMEMBER_EVERY: Duration = Duration::from_secs(10);
/// The logs begin new files at midnight, UTC; in nanoseconds.
const A_DAY: u64 = 86_400_000_000_000;
/// How long the end of a run waits for the disk.
const LAST_PATIENCE: Duration = Duration::from_secs(5);
/// Rows of decisions that may wait for a slow disk; more are dropped, and that is counted.
const QUEUE: usize = 4096;
/// The same of outputs, which take no room from the decisions.
const OUTPUT_QUEUE: usize = 4096;

/// The loop's end of the queue. Without a directory it keeps nothing.
#[derive(Debug, Default)]
pub(super) struct Storage {
    queue: Option<SyncSender<Job>>,
    recorder: Option<Recorder>,
    pub(super) outputs: OutputsLog,
    /// Rows of decisions and states that found the queue full.
    dropped: u64,
    remembered: Option<Moment>,
    /// The day of the file in which the rows of decisions stand.
    day: Option<u64>,
    /// Rows of decisions are missing on disk: what follows them can be replayed only from where the axes stand then.
    torn: Arc<AtomicBool>,
    /// Ends with the thread.
    working: Option<Receiver<()>>,
    /// Without a thread, and without a log: where the state is put at once.
    here: Option<(Arc<dyn Disk>, PathBuf)>,
}

#[derive(Debug)]
enum Job {
    Row(Moment, Vec<u8>),
    OutputRow {
        at: Moment,
        row: Vec<u8>,
        /// How often rows of outputs had been lost before it was made.
        tear: u64,
    },
    State(Box<Memory>),
}

impl Storage {
    /// Keeps the logs and the state of this machine in this directory.
    pub(super) fn start(
        profile: &Profile,
        directory: &Path,
        dry_run: bool,
        journal: Arc<Journal>,
    ) -> Storage {
        let (queue, jobs) = sync_channel(QUEUE + OUTPUT_QUEUE);
        let torn = Arc::new(AtomicBool::new(false));
        let outputs = OutputsLog::new(profile, queue.clone());
        let header = if dry_run { Recorder::dry_header(profile) } else { Recorder::header(profile) };
        let mut thread =
            StorageThread::new(profile, directory, header, (Arc::clone(&torn), outputs.tears()), journal);
        let (ends_with_the_thread, working) = sync_channel(0);
        let work = move || {
            thread.work(&jobs);
            drop(ends_with_the_thread);
        };
        // Without a thread nothing is kept: the queue finds nobody at its other end.
        let _ = std::thread::Builder::new().name("storage".to_owned()).spawn(work);
        let recorder = Some(Recorder::new(profile).of_dry_run(dry_run));
        let (queue, working) = (Some(queue), Some(working));
        Storage { queue, recorder, outputs, torn, working, ..Storage::default() }
    }

    /// Keeps the state alone, at once, on this disk.
    pub(super) fn without_log(disk: Arc<dyn Disk>, state: PathBuf) -> Storage {
        Storage { here: Some((disk, state)), ..Storage::default() }
    }

    /// Before a step: where its row is the first of a file, or rows before it are lost, the row says where the axes
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

    pub(super) fn zeroed(&mut self, at: Moment) {
        if let Some(recorder) = &mut self.recorder {
            recorder.zeroed(at);
        }
    }

    /// Queues the state, if that is urgent or the last time was long enough ago.
    pub(super) fn remember(
        &mut self,
        (now, is_urgent): (Moment, bool),
        compensation: &Compensation,
        profile: &Profile,
        outputs: &[OutputState],
    ) {
        let is_due = is_urgent || self.remembered.is_none_or(|last| now.since(last) >= REMEMBER_EVERY);
        if !is_due || (self.queue.is_none() && self.here.is_none()) {
            return;
        }
        self.remembered = Some(now);
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

    /// The end of a run: waits until everything queued is on disk; not for ever, where the disk hangs.
    pub(super) fn finish(&mut self) {
        (self.queue, self.outputs) = (None, OutputsLog::default());
        if let Some(working) = self.working.take() {
            let _ = working.recv_timeout(LAST_PATIENCE);
        }
    }

    /// Rows of the logs and states that a slow disk has cost since the start.
    pub(super) fn dropped(&self) -> u64 {
        self.dropped + self.outputs.dropped
    }

    fn hand_over(&mut self, job: Job) {
        // A full queue means a disk that has been failing for long, which its own event has reported.
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

#[cfg(test)]
mod tests;
