//! Task of one bus line. The task works in *turns*. A turn is one action. Examples are one request of a read, the
//! work on one output, the heartbeat, or a step of the axes (calculation of their Cz). The task takes the turns one
//! at a time, in the order in which they are due. It steps the axes as soon as their inputs have been read.
//!
//! ```text
//! sleep ─► turn ─► the heartbeat, when it is due
//!   ▲       │      the axes, when their inputs were read (or are late)
//!   │       │      a corrected position, when its position was read
//!   └───────┘      what is due first: one request of a device's reads · one verified write · one check of a device
//! ```
//!
//! After a unit behind a Modbus gateway has not answered, the device that answered last is read before the others,
//! see [`DeviceLine::first_after_miss`]. While the Modbus gateway waits for such a unit, no device behind it is read,
//! see [`DeviceLine::occupied_until`]. The axes are then stepped (calculated) without these reads.
//!
//! A series of writes cannot make the readings of a sensor stale. A device whose readings have reached half of their
//! `max_age` is read before every output, a limited number of times in a row. A slow device delays a corrected
//! position, or an axis that is due, at most by one request to the device.

use std::sync::Arc;
use std::time::Duration;

use self::outputs::OutputTask;
use self::read::Poll;
use super::can::{Can, CanListener};
use super::inspector::Inspector;
use crate::clock::Sleeper;
use crate::fieldbus::kinds;
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::Request;
use crate::gateway::output::LineTurn;
use crate::gateway::shared::line_handle::LineHandle;
use crate::gateway::shared::shared_state::LineWork;
use crate::gateway::state::device_health::JITTER_MS;
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, DeviceId};

mod heartbeat_task;
mod outputs;
mod read;
mod stamps;
#[cfg(test)]
mod tests;

use heartbeat_task::HeartbeatTask;

/// Longest sleep of a line task if no action is due.
const IDLE: Duration = Duration::from_secs(1);
/// Delay after which a due read becomes urgent. After the same delay, the task steps the axes (calculates their Cz)
/// although inputs are missing. A fast line never reaches this delay.
const SLOW: Duration = Duration::from_millis(20);
/// Maximum number of consecutive urgent reads. After them, the line task carries out the action that has been due for
/// the longest time.
const PRESSED: u32 = 8;

/// Task of one bus line. The task owns the connection, and carries out all reads and writes on the line.
pub(in crate::gateway) struct LineTask {
    shared: LineHandle,
    bus: BusId,
    line: DeviceLine,
    sleeper: Sleeper,
    can: Option<Arc<Can>>,
    inspector: Inspector,
    polls: Vec<Poll>,
    jobs: Vec<OutputTask>,
    heartbeat_task: Option<HeartbeatTask>,
    /// Whether this task steps (calculates) axes, because inputs of an axis are read on this line. If the profile has
    /// no axis, one line task reports the changes of the signals instead.
    steps_axes: bool,
    /// Whether another line needs values that are read on this line. Such a value is a position for an output that
    /// writes position plus Cz, or the result of a probing cycle.
    feeds_others: bool,
    step_due: Option<Moment>,
    pending: Pending,
    work: LineWork,
    /// Number of wakeups of this line that the task has processed (`news`), and number of pauses of the computer that
    /// it has processed (`pauses`).
    news: u64,
    pauses: u64,
    /// Number of consecutive urgent reads up to now; 0 after any other action.
    pressed: u32,
    overruns: Overruns,
}

/// Work that remains for the next turns (actions of the line task).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Pending {
    /// Whether the task must step the axes, because a device was read or another task has woken the line since the
    /// last step.
    has_news: bool,
    /// Whether this task must wake the tasks of other lines, because it has read a value that they need.
    wakes_others: bool,
    /// Whether checks of devices may be due.
    inspects: bool,
}

/// Next action of the line task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    Sleep(Moment),
    Beat,
    /// Read of the device checks that are due.
    Inspect,
    /// One request of the reads of a device. Contains the index in `polls`.
    Read(usize),
    Step,
    /// Work on one output or output set. Contains the index in `jobs`.
    Output(usize),
}

/// Rounds of reads that began at least one period later than planned, since the last report.
#[derive(Debug, Default)]
struct Overruns {
    count: u64,
    /// Largest delay of a round, and the device of this round.
    worst: Option<(Duration, DeviceId)>,
}

impl Overruns {
    fn note(&mut self, late: Duration, device: DeviceId) {
        self.count += 1;
        if self.worst.is_none_or(|(worst, _)| late > worst) {
            self.worst = Some((late, device));
        }
    }
}

impl LineTask {
    pub(in crate::gateway) fn new(
        shared: LineHandle,
        bus: BusId,
        (line, sleeper): (DeviceLine, Sleeper),
        can: Option<Arc<Can>>,
        start: Moment,
    ) -> LineTask {
        let profile = &shared.profile;
        let dependents = &shared.dependents;
        let steps_axes = dependents.stepping.contains(&bus);
        let feeds_others = dependents.corrected_elsewhere.contains(&bus)
            || (!steps_axes && !dependents.probed_on[bus.0].is_empty());
        LineTask {
            bus,
            line,
            sleeper,
            can,
            inspector: Inspector::new(profile, bus, start),
            polls: read::polls(profile, bus, &dependents.corrected, start),
            jobs: outputs::jobs(&shared, bus, start),
            heartbeat_task: HeartbeatTask::of(profile, bus, start),
            steps_axes,
            feeds_others,
            step_due: steps_axes.then_some(start),
            pending: Pending { has_news: true, wakes_others: false, inspects: true },
            work: LineWork::All,
            news: 0,
            pauses: shared.pauses(),
            pressed: 0,
            overruns: Overruns::default(),
            shared,
        }
    }

    pub(in crate::gateway) fn requests(&self) -> usize {
        self.polls.iter().map(Poll::requests).sum()
    }

    /// Takes turns (actions of the line task) until the gateway has stopped. Then closes the connection to an OPC UA
    /// server, because the server stores a state for the connection. With a `listener`, the task also receives CAN
    /// frames.
    ///
    /// A gateway may have 500 line tasks. State for one turn, or for CAN only, is therefore allocated separately.
    pub(in crate::gateway) async fn run(mut self: Box<Self>, listener: Option<Box<CanListener>>) {
        match listener {
            None => self.turns().await,
            Some(listener) => {
                tokio::join!(Box::pin(listener.listen()), self.turns());
            }
        }
    }

    /// Takes turns (actions of the line task) until the gateway has stopped. The state of a turn is allocated only
    /// for this turn, so that all lines use the same memory one after the other. Thousands of lines then need little
    /// memory, and this memory is in the cache of the processor.
    async fn turns(&mut self) {
        let mut now = self.line.sample();
        loop {
            self.take_note(now);
            // A server may keep a state for this line until the connection is closed in order.
            let kind = kinds::of(self.shared.profile.bus(self.bus).transport);
            if self.work == LineWork::Leave && kind.is_closed_in_order {
                return Box::pin(self.line.close()).await;
            }
            let turn = self.next(now);
            // A step wakes the other lines itself, after the decision: their outputs then follow it at once.
            if turn != Turn::Step && std::mem::take(&mut self.pending.wakes_others) {
                self.shared.wake_others(self.bus);
            }
            match turn {
                Turn::Sleep(due) => {
                    let due = due.min(now.after(IDLE));
                    self.line.idle_for(due.since(now));
                    let began = self.sleeper.sleep_from(now, due).await;
                    self.line.send_guard.record_sample(began);
                    self.account(began.since(due));
                    self.pending.inspects = true;
                    self.shared.turned(self.bus);
                    now = began;
                    continue;
                }
                Turn::Beat => {
                    if let Some(heartbeat_task) = &mut self.heartbeat_task {
                        Box::pin(heartbeat_task.beat(&mut self.line, &self.shared, now)).await;
                    }
                }
                Turn::Inspect => {
                    self.pending.inspects = false;
                    let inspected = self.inspector.inspect(&mut self.line, &self.shared, self.can.as_deref());
                    Box::pin(inspected).await;
                    let now = self.line.last_sample();
                    self.polls.iter_mut().for_each(|poll| poll.make_up(&self.shared, now));
                }
                Turn::Read(place) => Box::pin(self.read(place, now)).await,
                Turn::Step => self.step(now),
                Turn::Output(place) => {
                    let along =
                        self.line.follow_up_until(now).filter(|_| self.jobs[place].corrects.is_some());
                    if let Some(by) = along {
                        self.line.set_follow_up(self.reads_next(by));
                    }
                    let turn = &mut LineTurn { line: &mut self.line, shared: &self.shared, now };
                    Box::pin(self.jobs[place].turn(turn)).await;
                    if along.is_some() {
                        self.line.set_follow_up(None);
                    }
                    self.pressed = 0;
                }
            }
            // A line that is always busy must not keep the others from their turns.
            tokio::task::coop::consume_budget().await;
            self.shared.turned(self.bus);
            now = self.line.last_sample();
        }
    }

    /// Processes the wakeups and pauses that other tasks have reported since the last action of this line task.
    fn take_note(&mut self, now: Moment) {
        if let Some(since) = self.line.send_guard.stalled_at() {
            self.shared.stalled_at(since);
        }
        if self.shared.news(self.bus) == self.news {
            return;
        }
        // Wakeups are cleared before the news is read: a later event wakes the task again.
        self.sleeper.forget_wakeups();
        self.news = self.shared.news(self.bus);
        (self.pending.has_news, self.pending.inspects) = (true, true);
        for revived in self.can.iter().flat_map(|can| can.revived()) {
            self.line.revive(revived);
        }
        let before = std::mem::replace(&mut self.work, self.shared.line_work());
        if before == LineWork::All && self.work != LineWork::All {
            self.shared.outputs_idle();
        }
        let pauses = self.shared.pauses();
        if std::mem::replace(&mut self.pauses, pauses) != pauses {
            // An exchange that is under way belongs to the time before the pause.
            self.line.hang_up();
            self.polls.iter_mut().for_each(|poll| poll.restart(now));
        }
        self.wake_outputs(now);
    }

    /// Steps (calculates) the axes that are due. Makes all outputs due, because each output may have a new value to
    /// write.
    fn step(&mut self, now: Moment) {
        self.pending.has_news = false;
        // Signals in CAN frames are in no device's reads.
        self.shared.check_for_restarts(now);
        self.shared.take_probings(now);
        if self.steps_axes {
            self.step_due = self.shared.advance(now);
        }
        if std::mem::take(&mut self.pending.wakes_others) {
            self.shared.wake_others(self.bus);
        }
        self.wake_outputs(now);
    }

    /// Marks each output of the line for a check whether a write is due. Called after each event that may require a
    /// write: a decision of an axis, a read, or a command.
    fn wake_outputs(&mut self, now: Moment) {
        self.jobs.iter_mut().for_each(|job| job.wake(now));
    }

    /// Executes one request of the reads of a device. If the request completes a round, each output that corrects a
    /// position of this device becomes due. The output may be on another line.
    async fn read(&mut self, place: usize, now: Moment) {
        let poll = &mut self.polls[place];
        let presses = poll.reads_position || poll.grows_stale(now);
        self.pressed = if presses { self.pressed + 1 } else { 0 };
        let is_over = poll.read(&mut self.line, &self.shared, &mut self.overruns, now).await;
        if !is_over {
            return;
        }
        let now = self.line.last_sample();
        // This check must not wait for a step: a line that is always busy may never complete the reads that are due.
        self.shared.check_for_restarts(now);
        self.shared.take_probings(now);
        self.pending = Pending { has_news: true, wakes_others: self.feeds_others, inspects: true };
        if poll.reads_position {
            let corrections = self.jobs.iter_mut().filter(|job| job.corrects == Some(poll.device));
            corrections.for_each(|job| job.due = job.due.min(now));
        }
    }

    /// Chooses the next turn (action of the line task) among the actions that are due. If no action is due, the turn
    /// is a sleep.
    fn next(&self, now: Moment) -> Turn {
        if self.heartbeat_task.as_ref().is_some_and(|heartbeat_task| heartbeat_task.due <= now) {
            return Turn::Beat;
        }
        let read = self.reads_due(now).min().map(|(due, _, place)| (due, place));
        if self.may_step(now) {
            return Turn::Step;
        }
        let jobs = || self.working_jobs().map(|(place, job)| (job.due, place));
        if let Some((_, place)) =
            jobs().filter(|(due, place)| *due <= now && self.jobs[*place].corrects.is_some()).min()
        {
            return Turn::Output(place);
        }
        if self.pending.inspects && !self.inspector.is_empty() {
            return Turn::Inspect;
        }
        let output = jobs().min();
        let read = read.filter(|(due, _)| *due <= now);
        match (read, output.filter(|(due, _)| *due <= now)) {
            (None, None) => Turn::Sleep(self.idle_until(now)),
            (None, Some((_, output))) => Turn::Output(output),
            (Some((due, first)), output) => {
                let others_wait =
                    output.is_some_and(|(since, _)| since < due) || self.polls[first].is_under_way();
                match self.pressing(now).filter(|_| others_wait && self.pressed < PRESSED) {
                    Some(pressing) => Turn::Read(pressing),
                    None => match output {
                        Some((since, output)) if since < due => Turn::Output(output),
                        _ => Turn::Read(first),
                    },
                }
            }
        }
    }

    /// Returns the outputs on which the task still works, with their indices. While the work of the line is limited,
    /// these are only the corrected positions (position plus Cz); otherwise all outputs.
    fn working_jobs(&self) -> impl Iterator<Item = (usize, &OutputTask)> {
        let works = |job: &OutputTask| self.work == LineWork::All || job.corrects.is_some();
        self.jobs.iter().enumerate().filter(move |(_, job)| works(job))
    }

    /// Returns the request of the next read, if the request is due at the time `by`. The line can send this request
    /// directly after the write of a corrected position (position plus Cz).
    fn reads_next(&self, by: Moment) -> Option<(DeviceId, Request<'static>)> {
        self.polls.iter().min_by_key(|poll| poll.due())?.asks_next(by)
    }

    /// Returns whether the axes may be stepped (calculated) now. An axis that is due waits for its inputs
    /// until the end of a round of reads. The axis does not wait for a slow device, or for a device that is
    /// due again directly after its last read.
    fn may_step(&self, now: Moment) -> bool {
        // Reads that must wait for the Modbus gateway do not delay the axes.
        let is_outstanding = |by: Moment| {
            self.reads_due(now).any(|(due, _, place)| due <= by && self.polls[place].is_outstanding(by))
        };
        let is_due = self.step_due.filter(|due| *due <= now);
        let is_late =
            |due: &Moment| now.since(*due) >= SLOW && self.polls.iter().all(|poll| poll.has_been_read);
        is_due.is_some_and(|due| !is_outstanding(due) || is_late(&due))
            || (self.pending.has_news && !is_outstanding(now))
    }

    /// Returns the index of the device with the most urgent read; `None` if no read is urgent. The read of a position
    /// that an output corrects is urgent if it has waited for too long. A read is also urgent if the readings of the
    /// device have reached half of their `max_age`.
    fn pressing(&self, now: Moment) -> Option<usize> {
        let due = self.reads_due(now).filter(|(due, ..)| *due <= now);
        let polls = due.map(|(.., place)| (place, &self.polls[place]));
        let pressing = polls.filter(|(_, poll)| {
            (poll.reads_position && now.since(poll.due()) >= SLOW) || poll.grows_stale(now)
        });
        pressing.map(|(place, poll)| (!poll.reads_position, poll.due(), place)).min().map(|(.., place)| place)
    }

    /// Returns a tuple for each device: the earliest time of its next read, whether another device must be
    /// read first, and the index of the device in `polls`.
    fn reads_due(&self, now: Moment) -> impl Iterator<Item = (Moment, bool, usize)> {
        let may_begin = move |poll: &Poll| {
            let occupied_until = self.line.occupied_until(poll.device, now);
            occupied_until.map_or(poll.due(), |until| until.max(poll.due()))
        };
        let first = self.line.first_after_miss(now);
        let first = first.and_then(|device| self.polls.iter().find(|poll| poll.device == device));
        let first = first.map(|poll| (poll.device, may_begin(poll)));
        self.polls.iter().enumerate().map(move |(place, poll)| {
            let begins = may_begin(poll);
            match first {
                // From now on, the device waits for at most one period.
                Some((device, other))
                    if poll.device != device && other <= begins.max(now).after(poll.every) =>
                {
                    (begins.max(other), true, place)
                }
                _ => (begins, false, place),
            }
        })
    }

    /// Returns the time at which the next action of the line task is due.
    fn idle_until(&self, now: Moment) -> Moment {
        let polls = self.reads_due(now).map(|(due, ..)| due);
        let jobs = self.working_jobs().map(|(_, job)| job.due);
        let heartbeat_task = self.heartbeat_task.iter().map(|heartbeat_task| heartbeat_task.due);
        polls.chain(jobs).chain(heartbeat_task).chain(self.step_due).min().unwrap_or(Moment::END)
    }

    /// Records the jitter of a sleep, which ended `late` after its planned end. Counts the rounds of reads
    /// that were late before the sleep. Also updates the due time of the axes, because another line may have
    /// stepped the axes during the sleep.
    fn account(&mut self, late: Duration) {
        let Overruns { count: overruns, worst } = std::mem::take(&mut self.overruns);
        if let Some((late, device)) = worst {
            let what = || format!("a poll of {}", self.shared.profile.device(device).name);
            self.shared.overrun(self.bus, overruns, late, what);
        }
        // The listener records whether a CAN interface is up.
        let is_connected = self.can.is_none().then(|| self.line.is_connected());
        let mut core = self.shared.core();
        if self.steps_axes {
            self.step_due = self.step_due.max(core.next_due);
        }
        let count = &mut core.device_health.buses[self.bus.0];
        count.cycles += 1;
        count.connected = is_connected.unwrap_or(count.connected);
        let late_ms = late.as_secs_f64() * 1000.0;
        let bucket = JITTER_MS.iter().position(|bound| late_ms <= *bound).unwrap_or(JITTER_MS.len());
        count.jitter[bucket] += 1;
    }
}
