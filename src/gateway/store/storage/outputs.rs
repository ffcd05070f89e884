//! Producer of the output log. It records the inputs and actions of each output, and counts repeated writes and
//! repeated turns (calls of a controller by the line task).

use std::fmt::{Display, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::Duration;

use jiff::civil::Date;

use super::stamps::{Stamped, Stamps};
use super::{Job, OUTPUT_QUEUE, QueuedJob, retention};
use crate::gateway::store::log::outputs::{
    ControllerSnapshot, ControllerState, OutputRecorder, ResumeState, Turn,
};
use isotherm_core::output::{Action, Controller, Input, Settings};
use isotherm_core::quantity::{Moment, Shifted};
use isotherm_profile::{OutputId, Profile, SetId};

/// Time for which repeated writes are counted. After this time, their number is written to the output log.
const COUNTED_FOR: Duration = Duration::from_secs(60);

/// Input that the controller of an output has received, with the states of the controller before and after the input.
#[derive(Debug)]
pub(in crate::gateway) struct OutputTransition<'a> {
    pub(in crate::gateway) id: OutputId,
    pub(in crate::gateway) settings: &'a Settings,
    pub(in crate::gateway) before: &'a Controller,
    /// Whether all inputs between the last log row and this input were recorded. If not, a row with the state must
    /// come first.
    pub(in crate::gateway) is_continuous: bool,
    pub(in crate::gateway) input: Input,
    pub(in crate::gateway) action: Action,
    pub(in crate::gateway) after: &'a Controller,
}

/// Turn of a controller (one call by the line task), with the states before and after it.
#[derive(Debug)]
pub(in crate::gateway) struct TurnRecord {
    pub(in crate::gateway) before: ControllerState,
    pub(in crate::gateway) turn: Turn,
    pub(in crate::gateway) after: ControllerState,
}

/// Kind of write that the gateway repeats regularly, even after a successful write. The log counts such writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gateway) enum CountedWrite {
    /// Output that writes a position plus Cz, or the value of a display.
    Position(OutputId),
    /// Values of an output set, or only its heartbeat and control word.
    Set(SetId),
    /// Heartbeat in a separate register.
    Heartbeat,
}

/// Number of output-log rows in the queue, and number of losses so far. The producer and the storage thread share
/// these counters.
#[derive(Debug, Default)]
pub(super) struct RowLosses {
    waiting: AtomicUsize,
    count: AtomicU64,
}

impl RowLosses {
    /// Counts a loss of one or more rows of the output log. Returns the number of losses, including this loss.
    pub(super) fn tear(&self) -> u64 {
        self.count.fetch_add(1, Ordering::Relaxed) + 1
    }

    pub(super) fn has_left_the_queue(&self) {
        self.waiting.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Identity of a series of log rows without a gap: the file, and the number of losses before these rows (`tear`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct RowSequence {
    day: Date,
    stamped: Stamped,
    tear: u64,
}

/// Producer of the rows of the output log. Without a queue, nothing is saved.
#[derive(Debug, Default)]
pub(in crate::gateway) struct OutputsLog {
    queue: Option<SyncSender<QueuedJob>>,
    recorder: OutputRecorder,
    stamps: Stamps,
    tears: Arc<RowLosses>,
    counts: (usize, usize),
    /// Latest time of a row of the output log, which determines the file of the row. A turn that began before
    /// midnight and ended after it is in the file of the new day.
    latest: Moment,
    /// Series of log rows without a gap to which the last row belongs; `None` before the first row.
    stretch: Option<RowSequence>,
    /// Counters of each output, then of each output set, then of the heartbeat.
    lines: Vec<Line>,
    /// Buffer for the message of a failed write, which is compared with the previous message.
    message: String,
    /// Number of log rows that were dropped because the queue was full.
    pub(super) dropped: u64,
}

/// Counters and last turn of one output, output set or heartbeat in the output log.
#[derive(Debug, Default)]
struct Line {
    name: String,
    /// Series of log rows that contains a row with the state of this controller. `None` if no such row was written
    /// yet.
    begun: Option<RowSequence>,
    last: Option<LastTurn>,
    /// Number of turns (calls of the controller) that repeated the last recorded turn.
    repetitions: u64,
    /// Time at which counting of the present `writes` and `failures` began; `None` before the first write.
    since: Option<Moment>,
    writes: u64,
    failures: u64,
    /// Message of the last failure that was recorded. Empty after a confirmed write.
    fault: String,
}

/// Last turn of a controller (call by the line task).
#[derive(Debug)]
struct LastTurn {
    turn: Turn,
    /// State of the controller after its last turn.
    state: ControllerState,
    at: Moment,
    /// Time at which a call of the controller was last written as a row of the log, instead of only being counted.
    recorded: Moment,
}

impl OutputsLog {
    pub(super) fn new(profile: &Profile, queue: SyncSender<QueuedJob>, stamps: Stamps) -> OutputsLog {
        let outputs = profile.outputs.iter().map(|output| output.name.clone());
        let sets = profile.sets.iter().map(|set| set.label());
        let names = outputs.chain(sets).chain(["heartbeat".to_owned()]);
        let counts = (profile.outputs.len(), profile.sets.len());
        OutputsLog { stamps, ..OutputsLog::of(names, counts, queue) }
    }

    pub(super) fn of(
        names: impl IntoIterator<Item = String>,
        counts: (usize, usize),
        queue: SyncSender<QueuedJob>,
    ) -> OutputsLog {
        let lines = names.into_iter().map(|name| Line { name, ..Line::default() }).collect();
        OutputsLog { queue: Some(queue), counts, lines, ..OutputsLog::default() }
    }

    /// Returns the counters that this producer shares with the storage thread.
    pub(super) fn tears(&self) -> Arc<RowLosses> {
        Arc::clone(&self.tears)
    }

    pub(in crate::gateway) fn is_kept(&self) -> bool {
        self.queue.is_some()
    }

    /// Records an input and an action of an output. If the last row of this output was lost or is in another file, a
    /// row with the state is written first.
    pub(in crate::gateway) fn stepped(&mut self, stepped: &OutputTransition<'_>, now: Moment) {
        let stretch = self.stretch(now);
        let Some(line) = self.lines.get_mut(stepped.id.0) else { return };
        line.begun = line.begun.filter(|begun| stepped.is_continuous && *begun == stretch);
        if matches!(stepped.action, Action::Nothing { .. }) && stepped.before == stepped.after {
            return;
        }
        if line.begun.replace(stretch).is_none() {
            let (state, policy) = (*stepped.before.state(), *stepped.before.policy());
            let beginning = ResumeState { settings: *stepped.settings, state, policy };
            let row = self.recorder.begin(now, &line.name, &beginning).to_vec();
            if !self.hand_over(row, stretch) {
                return;
            }
        }
        let name = &self.lines[stepped.id.0].name;
        let row = self.recorder.step(now, name, stepped.input, stepped.action).to_vec();
        self.hand_over(row, stretch);
    }

    /// Records a turn of a controller (call by the line task), or only counts the turn if it repeats the last one. If
    /// the last row of this controller was lost or is in another file, a row with the state is written first.
    pub(in crate::gateway) fn turned(
        &mut self,
        steady: CountedWrite,
        TurnRecord { before, turn, after }: TurnRecord,
        snapshot: impl FnOnce() -> ControllerSnapshot,
        now: Moment,
    ) {
        if !self.is_kept() {
            return;
        }
        let (stretch, place) = (self.stretch(now), self.place(steady));
        let Some(line) = self.lines.get_mut(place) else { return };
        if turn.is_idle() && before.is_like(&after) {
            return;
        }
        let continues = |last: &&LastTurn| last.state == before || last.state.is_like(&before);
        let last = line.last.as_ref().filter(|_| line.begun == Some(stretch)).filter(continues);
        let (is_continuous, recorded) = (last.is_some(), last.map_or(now, |last| last.recorded));
        if last.is_some_and(|last| turn.repeats(&last.turn, &last.state, &after)) {
            line.repetitions += 1;
            line.last = Some(LastTurn { turn, state: after, at: now, recorded });
            if now.since(recorded) >= COUNTED_FOR {
                self.record_repetitions(place, stretch);
            }
            return;
        }
        if !is_continuous {
            self.record_repetitions(place, stretch);
            self.lines[place].begun = Some(stretch);
            let row = self.recorder.resume(now, &self.lines[place].name, &snapshot()).to_vec();
            if !self.hand_over(row, stretch) {
                return;
            }
        }
        let line = &mut self.lines[place];
        let repetitions = std::mem::take(&mut line.repetitions);
        let row = self.recorder.turn(now, &line.name, &turn, repetitions).to_vec();
        line.last = Some(LastTurn { turn, state: after, at: now, recorded: now });
        self.hand_over(row, stretch);
    }

    /// Writes a log row for the last turn of a controller (call by the line task), if that turn was only counted. The
    /// row contains the number of repeated turns before it.
    fn record_repetitions(&mut self, place: usize, stretch: RowSequence) {
        let line = &mut self.lines[place];
        let repetitions = std::mem::take(&mut line.repetitions);
        let Some(last) = line.last.as_mut().filter(|_| repetitions > 0 && line.begun == Some(stretch)) else {
            return;
        };
        last.recorded = last.at;
        let row = self.recorder.turn(last.at, &line.name, &last.turn, repetitions - 1).to_vec();
        self.hand_over(row, stretch);
    }

    /// Counts a write that was confirmed.
    pub(in crate::gateway) fn wrote(&mut self, steady: CountedWrite, now: Moment) {
        if let Some(line) = self.counted(steady, now) {
            line.writes += 1;
            line.fault.clear();
        }
    }

    pub(in crate::gateway) fn not_written(&mut self, steady: CountedWrite, why: &dyn Display, now: Moment) {
        let stretch = self.stretch(now);
        let mut message = std::mem::take(&mut self.message);
        message.clear();
        // Writing to a string never fails.
        let _ = write!(message, "{why}");
        if let Some(line) = self.counted(steady, now) {
            line.failures += 1;
            if line.fault != message {
                line.fault.clone_from(&message);
                let name = &self.lines[self.place(steady)].name;
                let row = self.recorder.fault(now, name, &message).to_vec();
                self.hand_over(row, stretch);
            }
        }
        self.message = message;
    }

    /// Writes log rows with all counts at the end of a run.
    pub(in crate::gateway) fn count_for_the_last_time(&mut self, now: Moment) {
        let stretch = self.stretch(now);
        for place in 0..self.lines.len() {
            self.record_repetitions(place, stretch);
            self.record_counts(place, now);
        }
    }

    /// Returns the series of log rows for a row that is written now. If a new series begins, the turns that were only
    /// counted are first recorded in the old series. If the clock was set, the new file begins with a row about the
    /// correction.
    fn stretch(&mut self, now: Moment) -> RowSequence {
        let (stamped, latest) = (self.stamps.check(now), self.latest.max(now));
        let day = retention::day(latest.shifted(stamped.shift));
        let stretch = RowSequence { day, stamped, tear: self.tears.count.load(Ordering::Relaxed) };
        if let Some(before) = self.stretch.replace(stretch).filter(|before| *before != stretch) {
            (0..self.lines.len()).for_each(|place| self.record_repetitions(place, before));
        }
        (self.latest, self.recorder.shift) = (latest, stamped.shift);
        if let Some(correction) = self.stamps.correction() {
            let row = self.recorder.clock(now, correction).to_vec();
            if self.hand_over(row, stretch) {
                self.stamps.said();
            }
        }
        stretch
    }

    fn place(&self, steady: CountedWrite) -> usize {
        let (outputs, sets) = self.counts;
        match steady {
            CountedWrite::Position(id) => id.0,
            CountedWrite::Set(id) => outputs + id.0,
            CountedWrite::Heartbeat => outputs + sets,
        }
    }

    /// Returns the counters of an output for a write at `now`. If the counting time is over, the old counts are first
    /// written to the log.
    fn counted(&mut self, steady: CountedWrite, now: Moment) -> Option<&mut Line> {
        let place = self.place(steady);
        let since = *self.lines.get_mut(place)?.since.get_or_insert(now);
        if now.since(since) >= COUNTED_FOR {
            self.record_counts(place, now);
        }
        self.lines.get_mut(place)
    }

    fn record_counts(&mut self, place: usize, now: Moment) {
        let stretch = self.stretch(now);
        let line = &mut self.lines[place];
        let Some(since) = line.since.replace(now) else { return };
        let (writes, failures) = (std::mem::take(&mut line.writes), std::mem::take(&mut line.failures));
        let recorder = &mut self.recorder;
        let wrote = (writes > 0).then(|| recorder.writes(now, &line.name, writes, since).to_vec());
        let failed = (failures > 0).then(|| recorder.failures(now, &line.name, failures, since).to_vec());
        for row in wrote.into_iter().chain(failed) {
            self.hand_over(row, stretch);
        }
    }

    /// Queues a log row. Returns `false` if the queue is full. The row is then lost.
    fn hand_over(&mut self, row: Vec<u8>, RowSequence { stamped, tear, .. }: RowSequence) -> bool {
        let at = self.latest;
        let Some(queue) = &self.queue else { return false };
        if self.tears.waiting.fetch_add(1, Ordering::Relaxed) < OUTPUT_QUEUE {
            match queue.try_send(Box::new(Job::OutputRow { at, stamped, row, tear })) {
                Ok(()) => return true,
                Err(TrySendError::Full(_)) => {}
                Err(TrySendError::Disconnected(_)) => {
                    self.queue = None;
                    return false;
                }
            }
        }
        self.tears.has_left_the_queue();
        self.tears.tear();
        self.dropped += 1;
        false
    }
}
