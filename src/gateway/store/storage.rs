//! Access to saved data. The module passes log rows to a separate thread, and the state to the writer of the
//! state document. Therefore a full or slow disk does not delay the bus lines.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use jiff::civil::Date;

use super::documents::Writer;
use super::log::Recorder;
use super::memory::{Memory, UnchangedParts};
use super::places::{Places, remembers_cz};
use crate::clock::{Clock, Correction};
use crate::gateway::state::output::OutputState;
use crate::gateway::state::sign::SignMemory;
use crate::gateway::state::signal_table::SignalTable;
use crate::observe::events::Journal;
use isotherm_core::compensation::{Change, Compensation, Control, Snapshot, Stop};
use isotherm_core::quantity::{Micron, Moment, Shifted};
use isotherm_profile::{Output, OutputId, Profile};

mod events;
mod outputs;
pub(in crate::gateway) mod retention;
mod stamps;
mod thread;

use events::EventsWake;
use outputs::OutputsLog;
pub(in crate::gateway) use outputs::{CountedWrite, OutputTransition, TurnRecord};
use stamps::{Stamped, Stamps};
use thread::StorageThread;

/// Minimum time between two regular saves of the state; a last save follows at the end. The logs are
/// synchronised to disk at the same times. After a power cut, at most the last 10 s of the logs are missing:
/// the sum of this time, one step, and the delay of a slow disk.
const REMEMBER_EVERY: Duration = Duration::from_secs(8);
/// Maximum time for which the gateway waits at its end until all log rows are on disk.
const LAST_PATIENCE: Duration = Duration::from_secs(5);
/// Maximum number of rows of the decision log that wait for a slow disk. Further rows are dropped and counted.
const QUEUE: usize = 4096;
/// Maximum number of rows of the output log that wait for a slow disk. They are counted separately from the rows of
/// the decision log.
const OUTPUT_QUEUE: usize = 4096;

/// Access to the logs and to the saved state. Without a state directory, nothing is saved.
#[derive(Default)]
pub(in crate::gateway) struct Storage {
    queue: Option<SyncSender<QueuedJob>>,
    recorder: Option<Recorder>,
    pub(in crate::gateway) outputs: OutputsLog,
    /// Number of rows of the decision log that were dropped because the queue was full.
    dropped: u64,
    remembered: Option<Moment>,
    /// Results of the sign checks, by axis.
    pub(in crate::gateway) signs: BTreeMap<String, SignMemory>,
    /// Last Cz of each output in the previous run, µm. This run saves the Cz again until it has read the register of
    /// the output.
    pub(in crate::gateway) left_um: BTreeMap<String, f64>,
    /// Cz of each output in the last saved state, in the order of the profile. `None` if that state contains no Cz of
    /// the output.
    handed_over: Vec<Option<Micron>>,
    stamps: Stamps,
    /// Day and file of the rows that are now written to the decision log. `None` before the first row.
    begun: Option<(Date, Stamped)>,
    /// Whether rows of the decision log were lost. A replay can then continue only at a row that contains the state
    /// of the axes.
    torn: Arc<AtomicBool>,
    /// Connection from the event journal to the storage thread. New events wake the thread until the connection is
    /// dropped.
    events: Option<EventsWake>,
    /// Channel that is disconnected when the storage thread has ended.
    working: Option<Receiver<()>>,
    /// Writer of the state document; `None` if nothing is saved.
    writer: Option<Arc<Writer>>,
}

/// Returns a correction of the clock if the present time is earlier than `last`, or more than
/// [`Stop::LONGEST`] later. `last` is the newest time stamp in state and logs. Otherwise returns `None`.
pub(in crate::gateway) fn clock_correction(now: Moment, last: Option<Moment>) -> Option<Correction> {
    let last = last.filter(|last| Stop::between(*last, now).by_the_clock.is_none());
    last.map(|from| Correction { from, to: now })
}

/// Returns the newest time stamp in the logs of this machine; `None` if there is no log. Logs from before a large
/// correction of the clock are ignored.
pub(in crate::gateway) fn newest_stamp(directory: &Path, machine: &str, now: Moment) -> Option<Moment> {
    let newest = retention::newest_of_decisions(directory, machine, now);
    newest.iter().filter_map(|log| thread::last_stamp(log)).max()
}

/// Job in a box. The queue allocates memory for all its items at the start, and a box is smaller than a job.
type QueuedJob = Box<Job>;

/// Job of the storage thread.
#[derive(Debug)]
enum Job {
    Row {
        at: Moment,
        stamped: Stamped,
        row: Vec<u8>,
    },
    OutputRow {
        at: Moment,
        stamped: Stamped,
        row: Vec<u8>,
        /// Number of losses of output-log rows before this row was created. After a loss, earlier rows that are still
        /// in the queue are not written, because they cannot be replayed.
        tear: u64,
    },
    /// Synchronises the written log rows to disk.
    Sync {
        at: Moment,
    },
    /// Writes the events that are not on disk yet.
    Events,
}

impl Storage {
    /// Starts the thread that writes the logs of this machine. The logs are in the state directory.
    pub(in crate::gateway) fn start(
        profile: &Profile,
        (directory, writer): (&Path, Arc<Writer>),
        dry_run: bool,
        journal: Arc<Journal>,
        (clock, correction): (&Clock, Option<Correction>),
    ) -> Storage {
        // One more place, for events.
        let (queue, jobs) = sync_channel(QUEUE + OUTPUT_QUEUE + 1);
        let torn = Arc::new(AtomicBool::new(false));
        let stamps = || Stamps::by(clock, correction);
        let outputs = OutputsLog::new(profile, queue.clone(), stamps());
        let header = if dry_run { Recorder::dry_header(profile) } else { Recorder::header(profile) };
        let tears = (Arc::clone(&torn), outputs.tears());
        let mut thread = StorageThread::new(profile, directory, header, tears, journal.clone());
        let events = Some(EventsWake::begin(journal, queue.clone(), thread.is_woken()));
        let (ends_with_the_thread, working) = sync_channel(0);
        let work = move || {
            thread.work(&jobs);
            drop(ends_with_the_thread);
        };
        // Without a thread nothing is saved: the queue has no receiver.
        let _ = std::thread::Builder::new().name("storage".to_owned()).spawn(work);
        let recorder = Some(Recorder::new(profile).of_dry_run(dry_run));
        let (queue, working) = (Some(queue), Some(working));
        let (stamps, writer) = (stamps(), Some(writer));
        Storage { queue, recorder, outputs, torn, events, working, stamps, writer, ..Storage::default() }
    }

    /// Creates a `Storage` that saves only the state, and no logs.
    pub(in crate::gateway) fn without_log(writer: Arc<Writer>, clock: &Clock) -> Storage {
        Storage { writer: Some(writer), stamps: Stamps::by(clock, None), ..Storage::default() }
    }

    /// Prepares the log row of a step. If the row is the first row of a file, or if earlier rows were lost, it also
    /// contains the state of the axes. A replay can then begin at this row.
    pub(in crate::gateway) fn prepare(&mut self, now: Moment, compensation: &Compensation) {
        let Some(recorder) = &mut self.recorder else { return };
        let stamped = self.stamps.check(now);
        let begun = Some((retention::day(now.shifted(stamped.shift)), stamped));
        if self.begun != begun || self.torn.load(Ordering::Relaxed) {
            self.begun = begun;
            self.torn.store(false, Ordering::Relaxed);
            recorder.stamp_by(stamped.shift, self.stamps.correction());
            recorder.begin(&compensation.running().counted_until(now));
        }
    }

    pub(in crate::gateway) fn record(
        &mut self,
        snapshot: &Snapshot<'_>,
        controls: &[Control],
        compensation: &Compensation,
    ) {
        if let Some(recorder) = &mut self.recorder {
            let row = recorder.row(snapshot, controls, compensation.decisions()).to_vec();
            let stamped = self.begun.map_or_else(Stamped::default, |(_, stamped)| stamped);
            if self.hand_over(Job::Row { at: snapshot.now, stamped, row }) {
                self.stamps.said();
            }
        }
    }

    /// Records that the operator has armed an axis, and has thereby accepted the saved state. The state is then no
    /// longer in question.
    pub(in crate::gateway) fn answered(&self) {
        if let Some(writer) = &self.writer {
            writer.question().close();
        }
    }

    /// Returns whether the saved state is in question: it was rejected or restored from a backup, and no operator has
    /// armed an axis since.
    pub(in crate::gateway) fn is_in_question(&self) -> bool {
        self.writer.as_ref().is_some_and(|writer| writer.question().is_open())
    }

    /// Returns whether this run saves nothing.
    pub(in crate::gateway) fn keeps_nothing(&self) -> bool {
        self.writer.is_none()
    }

    pub(in crate::gateway) fn zeroed(&mut self, at: Moment, axis: Option<usize>) {
        if let Some(recorder) = &mut self.recorder {
            recorder.zeroed(at, axis);
        }
    }

    /// Records a request to change the preferred model of an axis.
    pub(in crate::gateway) fn preferred(&mut self, axis: usize, change: Option<&Change>) {
        if let Some(recorder) = &mut self.recorder {
            recorder.preferred(axis, change);
        }
    }

    /// Requests that the next step saves the state.
    pub(in crate::gateway) fn remember_soon(&mut self) {
        self.remembered = None;
    }

    /// Returns whether the Cz of an output in the last saved state is close enough for the next write. The
    /// saved Cz must be equal to `written` (the present Cz), or differ from `decided` (the next Cz) by at
    /// most one step. Always `true` if nothing is saved.
    pub(in crate::gateway) fn is_within_a_step(
        &self,
        id: OutputId,
        (written, decided): (Micron, Micron),
        step: Micron,
    ) -> bool {
        let known = self.handed_over.get(id.0).copied().flatten();
        self.writer.is_none()
            || known.is_some_and(|known| known == written || (decided - known).abs() <= step)
    }

    /// Saves the state if `is_urgent` is true, or if [`REMEMBER_EVERY`] has passed since the last save.
    pub(in crate::gateway) fn remember(
        &mut self,
        (now, is_urgent): (Moment, bool),
        compensation: &Compensation,
        (profile, places): (&Arc<Profile>, &Arc<Places>),
        (board, outputs): (&SignalTable, &[OutputState]),
    ) {
        let is_due = is_urgent || self.remembered.is_none_or(|last| now.since(last) >= REMEMBER_EVERY);
        let Some(writer) = self.writer.as_ref().filter(|_| is_due) else { return };
        self.remembered = Some(now);
        let is_remembered = |output: &Output| remembers_cz(output.writes) && !profile.is_release(output.axis);
        let verified = profile.outputs.iter().zip(outputs).filter(|(output, _)| is_remembered(output));
        let left = |name: &String| self.left_um.get(name).copied();
        let verified = verified.filter_map(|(output, state)| {
            let cz = state.cz.map(Micron::get).or_else(|| left(&output.name))?;
            Some((output.name.clone(), cz))
        });
        let verified = verified.collect();
        self.handed_over.clear();
        self.handed_over.extend(outputs.iter().map(|state| state.cz));
        let (signs, values) = (self.signs.clone(), board.last_good(now));
        let rest = UnchangedParts { signs, places: Arc::clone(places), values };
        let memory = Memory::new(Arc::clone(profile), now, compensation.remembered(), verified, rest);
        writer.remember(memory.stamped(self.stamps.of_the_clock()));
        let _ = self.hand_over(Job::Sync { at: now });
    }

    /// Waits at the end of a run until all queued rows are on disk, for [`LAST_PATIENCE`] at most.
    pub(in crate::gateway) fn finish(&mut self) {
        (self.queue, self.outputs, self.events) = (None, OutputsLog::default(), None);
        if let Some(working) = self.working.take() {
            let _ = working.recv_timeout(LAST_PATIENCE);
        }
    }

    /// Returns the number of log rows that were dropped since the start because the disk was too slow.
    pub(in crate::gateway) fn dropped(&self) -> u64 {
        self.dropped + self.outputs.dropped
    }

    /// Queues a job for the storage thread. Returns `false` if the queue is full. The job is then lost.
    fn hand_over(&mut self, job: Job) -> bool {
        // A full queue means that the disk has failed for a long time, which was reported.
        let Some(queue) = &self.queue else { return false };
        match queue.try_send(Box::new(job)) {
            Ok(()) => return true,
            Err(TrySendError::Full(_)) => {
                self.dropped += 1;
                self.torn.store(true, Ordering::Relaxed);
            }
            Err(TrySendError::Disconnected(_)) => self.queue = None,
        }
        false
    }
}

#[cfg(test)]
mod tests;
