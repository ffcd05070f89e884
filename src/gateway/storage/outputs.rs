//! The log of the outputs, as it is filled: what each output took and asked for, and what is only counted.

use std::fmt::{Display, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::TrySendError;
use std::time::Duration;

use super::{A_DAY, Job, OUTPUT_QUEUE, Storage};
use crate::gateway::log::outputs::{Beginning, OutputRecorder};
use isotherm_core::output::{Action, Fact, Settings, State};
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{OutputId, Profile, SetId};

/// What is written again and again is counted for so long.
const COUNTED_FOR: Duration = Duration::from_secs(60);

/// An output has taken a fact.
#[derive(Debug)]
pub(in crate::gateway) struct Stepped<'a> {
    pub(in crate::gateway) id: OutputId,
    pub(in crate::gateway) settings: &'a Settings,
    pub(in crate::gateway) before: &'a State,
    /// That is what was known after the last fact that was told.
    pub(in crate::gateway) goes_on: bool,
    pub(in crate::gateway) fact: Fact,
    pub(in crate::gateway) action: Action,
    pub(in crate::gateway) after: &'a State,
}

/// What is written again and again, whatever came of the last time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gateway) enum Steady {
    /// A corrected position, or a display.
    Position(OutputId),
    /// The heartbeat and the control word of a set.
    Set(SetId),
    /// The heartbeat in a register of its own.
    Heartbeat,
}

/// What both ends of the queue know of the rows of outputs.
#[derive(Debug, Default)]
pub(super) struct Tears {
    waiting: AtomicUsize,
    count: AtomicU64,
}

impl Tears {
    /// Rows are lost; how often that has happened.
    pub(super) fn tear(&self) -> u64 {
        self.count.fetch_add(1, Ordering::Relaxed) + 1
    }

    pub(super) fn has_left_the_queue(&self) {
        self.waiting.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Rows that belong together: those of one file, without any missing between them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stretch {
    day: u64,
    tear: u64,
}

/// The loop's side of the log of the outputs.
#[derive(Debug)]
pub(super) struct OutputsLog {
    recorder: OutputRecorder,
    tears: Arc<Tears>,
    /// How many outputs and sets there are.
    counts: (usize, usize),
    /// By output, by set, and of the heartbeat.
    lines: Vec<Line>,
    /// What failed, in words, while it is compared with what failed before.
    words: String,
}

#[derive(Debug, Default)]
struct Line {
    name: String,
    /// Where the output has begun, so that its rows can be replayed, or its Cz was told.
    begun: Option<Stretch>,
    /// What is only counted, since when.
    since: Option<Moment>,
    writes: u64,
    failures: u64,
    cz: Option<Micron>,
    /// What failed last, in words, and was told.
    fault: String,
}

impl OutputsLog {
    pub(super) fn new(profile: &Profile) -> OutputsLog {
        let outputs = profile.outputs.iter().map(|output| output.name.clone());
        let sets = profile.sets.iter().map(|set| set.label());
        let names = outputs.chain(sets).chain(["heartbeat".to_owned()]);
        OutputsLog::of(names, (profile.outputs.len(), profile.sets.len()))
    }

    pub(super) fn of(names: impl IntoIterator<Item = String>, counts: (usize, usize)) -> OutputsLog {
        OutputsLog {
            recorder: OutputRecorder::default(),
            tears: Arc::default(),
            counts,
            lines: names.into_iter().map(|name| Line { name, ..Line::default() }).collect(),
            words: String::new(),
        }
    }

    pub(super) fn tears(&self) -> Arc<Tears> {
        Arc::clone(&self.tears)
    }

    fn stretch(&self, now: Moment) -> Stretch {
        Stretch { day: now.as_nanos() / A_DAY, tear: self.tears.count.load(Ordering::Relaxed) }
    }

    fn place(&self, steady: Steady) -> usize {
        let (outputs, sets) = self.counts;
        match steady {
            Steady::Position(id) => id.0,
            Steady::Set(id) => outputs + id.0,
            Steady::Heartbeat => outputs + sets,
        }
    }
}

impl Storage {
    /// What outputs take and ask for is told to a log.
    pub(in crate::gateway) fn logs_outputs(&self) -> bool {
        self.outputs.is_some()
    }

    /// Queues what an output took and asked for; where rows before it are in another file or lost, after what it goes on
    /// from.
    pub(in crate::gateway) fn stepped(&mut self, stepped: &Stepped<'_>, now: Moment) {
        let Some(log) = &mut self.outputs else { return };
        let stretch = log.stretch(now);
        let Some(line) = log.lines.get_mut(stepped.id.0) else { return };
        line.begun = line.begun.filter(|begun| stepped.goes_on && *begun == stretch);
        if matches!(stepped.action, Action::Nothing { .. }) && stepped.before == stepped.after {
            return;
        }
        let begins = line.begun.replace(stretch).is_none();
        if begins {
            let beginning = Beginning { settings: *stepped.settings, state: *stepped.before };
            let row = log.recorder.begin(now, &line.name, &beginning).to_vec();
            if !self.hand_over_output(now, row, stretch.tear) {
                return;
            }
        }
        let Some(log) = &mut self.outputs else { return };
        let Some(line) = log.lines.get(stepped.id.0) else { return };
        let row = log.recorder.step(now, &line.name, stepped.fact, stepped.action).to_vec();
        self.hand_over_output(now, row, stretch.tear);
    }

    /// A write of what is only counted was answered as done, with this Cz in it.
    pub(in crate::gateway) fn wrote(&mut self, steady: Steady, cz: Option<Micron>, now: Moment) {
        self.count(steady, now);
        let Some(log) = &mut self.outputs else { return };
        let (place, stretch) = (log.place(steady), log.stretch(now));
        let Some(line) = log.lines.get_mut(place) else { return };
        line.writes += 1;
        line.fault.clear();
        let Some(cz) = cz else { return };
        if line.begun.replace(stretch) != Some(stretch) || line.cz.replace(cz) != Some(cz) {
            line.cz = Some(cz);
            let row = log.recorder.cz(now, &line.name, cz).to_vec();
            self.hand_over_output(now, row, stretch.tear);
        }
    }

    /// It failed.
    pub(in crate::gateway) fn not_written(&mut self, steady: Steady, why: &dyn Display, now: Moment) {
        self.count(steady, now);
        let Some(log) = &mut self.outputs else { return };
        let (place, stretch) = (log.place(steady), log.stretch(now));
        let Some(line) = log.lines.get_mut(place) else { return };
        line.failures += 1;
        log.words.clear();
        // Writing to a string never fails.
        let _ = write!(log.words, "{why}");
        if line.fault != log.words {
            line.fault.clone_from(&log.words);
            let row = log.recorder.fault(now, &line.name, &line.fault).to_vec();
            self.hand_over_output(now, row, stretch.tear);
        }
    }

    /// The end of a run: what was counted until then.
    pub(in crate::gateway) fn count_for_the_last_time(&mut self, now: Moment) {
        let places = self.outputs.as_ref().map_or(0, |log| log.lines.len());
        (0..places).for_each(|place| self.tell_counts(place, now));
    }

    /// Something that is counted happens.
    fn count(&mut self, steady: Steady, now: Moment) {
        let Some(log) = &mut self.outputs else { return };
        let place = log.place(steady);
        let Some(line) = log.lines.get_mut(place) else { return };
        let since = *line.since.get_or_insert(now);
        if now.since(since) >= COUNTED_FOR {
            self.tell_counts(place, now);
        }
    }

    fn tell_counts(&mut self, place: usize, now: Moment) {
        let Some(log) = &mut self.outputs else { return };
        let tear = log.stretch(now).tear;
        let Some(line) = log.lines.get_mut(place) else { return };
        let Some(since) = line.since.replace(now) else { return };
        let (writes, failures) = (std::mem::take(&mut line.writes), std::mem::take(&mut line.failures));
        let told = (writes > 0).then(|| log.recorder.writes(now, &line.name, writes, since).to_vec());
        let failed = (failures > 0).then(|| log.recorder.failures(now, &line.name, failures, since).to_vec());
        for row in told.into_iter().chain(failed) {
            self.hand_over_output(now, row, tear);
        }
    }

    /// Whether there was room for it.
    fn hand_over_output(&mut self, at: Moment, row: Vec<u8>, tear: u64) -> bool {
        let (Some(queue), Some(log)) = (&self.queue, &self.outputs) else { return false };
        if log.tears.waiting.fetch_add(1, Ordering::Relaxed) < OUTPUT_QUEUE {
            match queue.try_send(Job::OutputRow { at, row, tear }) {
                Ok(()) => return true,
                Err(TrySendError::Full(_)) => {}
                Err(TrySendError::Disconnected(_)) => {
                    self.queue = None;
                    return false;
                }
            }
        }
        log.tears.has_left_the_queue();
        log.tears.tear();
        self.dropped += 1;
        false
    }
}
