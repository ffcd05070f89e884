//! The task of one line. It takes reads, outputs and the heartbeat one at a time, by what is due first, and steps the
//! axes as soon as their inputs have been read.
//!
//! ```text
//! sleep ─► turn ─► the heartbeat, when it is due
//!   ▲       │      the axes, when what they rest on was read (or is late)
//!   │       │      a corrected position, when its position was read
//!   └───────┘      what is due first: one request of a device's reads · one verified write · one look at how a device is set
//! ```
//!
//! No round of writes makes a sensor stale: a device whose readings have lived half of their `max_age` goes before
//! every output, some times in a row. And no slow device keeps a position that is corrected, or an axis that is due,
//! waiting for more than one of its requests.

use std::sync::Arc;
use std::time::Duration;

use self::captures::Captures;
use self::outputs::Job;
use self::read::Poll;
use super::can::{Can, CanListener};
use super::contact::JITTER_MS;
use super::execute::LineTurn;
use super::inspector::Inspector;
use super::line_handle::LineHandle;
use super::shared::LineWork;
use crate::clock::Sleeper;
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::Request;
use isotherm_core::compensation::model::Model;
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, DeviceId, Profile};

mod captures;
mod outputs;
mod pulse;
mod read;
mod stamps;
#[cfg(test)]
mod tests;

use pulse::Pulse;

/// With nothing to do, a line looks around this often.
const IDLE: Duration = Duration::from_secs(1);
/// On a line that is quicker than this nothing waits long enough to go before its turn.
const SLOW: Duration = Duration::from_millis(20);
/// So often in a row something that presses goes before what was due earlier.
const PRESSED: u32 = 8;

/// Owns one line and everything that is read and written on it.
pub(super) struct LineTask {
    shared: LineHandle,
    bus: BusId,
    line: DeviceLine,
    sleeper: Sleeper,
    can: Option<Arc<Can>>,
    inspector: Inspector,
    polls: Vec<Poll>,
    jobs: Vec<Job>,
    pulse: Option<Pulse>,
    /// Inputs of an axis are read here, so its steps are made here, right after them.
    steps_axes: bool,
    /// A position read here is corrected on another line.
    feeds_others: bool,
    step_due: Option<Moment>,
    /// A device has been read, or there was news, since the axes were last looked at.
    has_news: bool,
    /// A position has been read that is corrected on another line.
    wakes_others: bool,
    /// How the devices are set is to be looked at.
    inspects: bool,
    work: LineWork,
    /// The news and the pauses that were taken note of.
    news: u64,
    pauses: u64,
    /// The last turn was that of a position, or of a read that could wait no longer; how often in a row.
    pressed: u32,
    overruns: Overruns,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    Sleep(Moment),
    Beat,
    /// Looks at how devices are set that are not known to be fit.
    Inspect,
    /// One request of the device at this place.
    Read(usize),
    Step,
    /// The output or set at this place.
    Output(usize),
}

/// What was late since it was last counted.
#[derive(Debug, Default)]
struct Overruns {
    count: u64,
    /// The worst of them, and what it was.
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
    pub(super) fn new(
        shared: LineHandle,
        bus: BusId,
        (line, sleeper): (DeviceLine, Sleeper),
        can: Option<Arc<Can>>,
        start: Moment,
    ) -> LineTask {
        let profile = &shared.profile;
        let is_here = |device: DeviceId| profile.device(device).bus == bus;
        // By output that corrects a position: where that is read, and where it goes.
        let positions = profile
            .outputs
            .iter()
            .filter_map(|output| Some((profile.signal(output.writes.position()?).device, output.device)));
        let corrected: Vec<DeviceId> = positions.clone().map(|(from, _)| from).collect();
        let steps_axes = home_lines(profile).contains(&bus);
        let feeds_others = positions.clone().any(|(from, to)| is_here(from) && !is_here(to))
            || (!steps_axes && !shared.dependents.probed_on[bus.0].is_empty());
        LineTask {
            bus,
            line,
            sleeper,
            can,
            inspector: Inspector::new(profile, bus, start),
            polls: read::polls(profile, bus, &corrected, start),
            jobs: outputs::jobs(&shared, bus, start),
            pulse: Pulse::of(profile, bus, start),
            steps_axes,
            feeds_others,
            step_due: Some(start),
            has_news: true,
            wakes_others: false,
            inspects: true,
            work: LineWork::All,
            news: 0,
            pauses: shared.pauses(),
            pressed: 0,
            overruns: Overruns::default(),
            shared,
        }
    }

    pub(super) fn requests(&self) -> usize {
        self.polls.iter().map(Poll::requests).sum()
    }

    /// Takes its turns until the gateway has stopped, and takes leave of a server that keeps a place for it; with a listener, takes
    /// what comes by itself as well. Five hundred of them rest together: what it needs only while it does something, or only on CAN,
    /// lies elsewhere.
    pub(super) async fn run(mut self: Box<Self>, listener: Option<Box<CanListener>>) {
        match listener {
            None => self.turns().await,
            Some(listener) => {
                tokio::join!(Box::pin(listener.listen()), self.turns());
            }
        }
    }

    async fn turns(&mut self) {
        let mut now = self.line.look();
        loop {
            self.take_note(now);
            // A server keeps a place for this line until it takes leave.
            if self.work == LineWork::Leave && self.shared.profile.bus(self.bus).opcua.is_some() {
                return self.line.close().await;
            }
            let turn = self.next(now);
            // After the axes, where it is their turn: what the others do then goes by what was just decided.
            if turn != Turn::Step && std::mem::take(&mut self.wakes_others) {
                self.shared.wake_others(self.bus);
            }
            match turn {
                Turn::Sleep(due) => {
                    let due = due.min(now.after(IDLE));
                    self.line.rests_for(due.since(now));
                    let began = self.sleeper.sleep_from(now, due).await;
                    self.line.departure.look_at(began);
                    self.account(began.since(due));
                    self.inspects = true;
                    self.shared.turned(self.bus);
                    now = began;
                    continue;
                }
                Turn::Beat => {
                    if let Some(pulse) = &mut self.pulse {
                        pulse.beat(&mut self.line, &self.shared, now).await;
                    }
                }
                Turn::Inspect => {
                    self.inspects = false;
                    self.inspector.inspect(&mut self.line, &self.shared, self.can.as_deref()).await;
                    let now = self.line.looked();
                    self.polls.iter_mut().for_each(|poll| poll.make_up(&self.shared, now));
                }
                Turn::Read(place) => self.read(place, now).await,
                Turn::Step => self.step(now),
                Turn::Output(place) => {
                    let along = self.line.takes_along(now).filter(|_| self.jobs[place].corrects.is_some());
                    if let Some(by) = along {
                        self.line.ask_behind(self.reads_next(by));
                    }
                    let turn = &mut LineTurn { line: &mut self.line, shared: &self.shared, now };
                    self.jobs[place].turn(turn).await;
                    if along.is_some() {
                        self.line.ask_behind(None);
                    }
                    self.pressed = 0;
                }
            }
            // A line that always has something to do must not keep the others from their turn.
            tokio::task::coop::consume_budget().await;
            self.shared.turned(self.bus);
            now = self.line.looked();
        }
    }

    /// What has happened elsewhere since the last turn.
    fn take_note(&mut self, now: Moment) {
        if let Some(since) = self.line.departure.stood_still() {
            self.shared.stood_still(since);
        }
        if self.shared.news(self.bus) == self.news {
            return;
        }
        // Before it is looked what there is: who comes after this wakes it again.
        self.sleeper.forget_wakeups();
        self.news = self.shared.news(self.bus);
        (self.has_news, self.inspects) = (true, true);
        for revived in self.can.iter().flat_map(|can| can.revived()) {
            self.line.revive(revived);
        }
        let before = std::mem::replace(&mut self.work, self.shared.line_work());
        if before == LineWork::All && self.work != LineWork::All {
            self.shared.outputs_rest();
        }
        let pauses = self.shared.pauses();
        if std::mem::replace(&mut self.pauses, pauses) != pauses {
            // What is on its way belongs to a time that is over.
            self.line.hang_up();
            self.polls.iter_mut().for_each(|poll| poll.begin_anew(now));
        }
        self.wake_outputs(now);
    }

    /// Steps the axes that are due, and looks at the outputs again: each of them may have something to do.
    fn step(&mut self, now: Moment) {
        self.has_news = false;
        // What comes in CAN frames is in no device's reads.
        self.shared.look_for_restarts(now);
        self.shared.hear_probings(now);
        if self.steps_axes {
            self.step_due = self.shared.advance(now);
        }
        if std::mem::take(&mut self.wakes_others) {
            self.shared.wake_others(self.bus);
        }
        self.wake_outputs(now);
    }

    /// Something was decided, read or commanded: each output looks whether that is something to do for it.
    fn wake_outputs(&mut self, now: Moment) {
        self.jobs.iter_mut().for_each(|job| job.wake(now));
    }

    /// One request of a device's reads. At the end of a round its position is corrected next, here or on another line.
    async fn read(&mut self, place: usize, now: Moment) {
        let poll = &mut self.polls[place];
        let presses = poll.reads_position || poll.grows_stale(now);
        self.pressed = if presses { self.pressed + 1 } else { 0 };
        let is_over = poll.read(&mut self.line, &self.shared, &mut self.overruns, now).await;
        if !is_over {
            return;
        }
        let now = self.line.looked();
        // At once: a line that always has something to read may never come to the end of a round.
        self.shared.look_for_restarts(now);
        self.shared.hear_probings(now);
        (self.has_news, self.inspects, self.wakes_others) = (true, true, self.feeds_others);
        if poll.reads_position {
            let corrections = self.jobs.iter_mut().filter(|job| job.corrects == Some(poll.device));
            corrections.for_each(|job| job.due = job.due.min(now));
        }
    }

    /// Whose turn it is: by what is due.
    fn next(&self, now: Moment) -> Turn {
        if self.pulse.as_ref().is_some_and(|pulse| pulse.due <= now) {
            return Turn::Beat;
        }
        let polls = self.polls.iter().enumerate().map(|(place, poll)| (poll.due(), place));
        let read = polls.min();
        if self.may_step(now) {
            return Turn::Step;
        }
        let jobs = || self.working_jobs().map(|(place, job)| (job.due, place));
        if let Some((_, place)) =
            jobs().filter(|(due, place)| *due <= now && self.jobs[*place].corrects.is_some()).min()
        {
            return Turn::Output(place);
        }
        if self.inspects && !self.inspector.is_empty() {
            return Turn::Inspect;
        }
        let output = jobs().min();
        let read = read.filter(|(due, _)| *due <= now);
        match (read, output.filter(|(due, _)| *due <= now)) {
            (None, None) => Turn::Sleep(self.rests_until()),
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

    /// The outputs that may do something, with their places.
    fn working_jobs(&self) -> impl Iterator<Item = (usize, &Job)> {
        let works = |job: &Job| self.work == LineWork::All || job.corrects.is_some();
        self.jobs.iter().enumerate().filter(move |(_, job)| works(job))
    }

    /// The read whose turn comes after a corrected position, if that is by then.
    fn reads_next(&self, by: Moment) -> Option<(DeviceId, Request<'static>)> {
        self.polls.iter().min_by_key(|poll| poll.due())?.asks_next(by)
    }

    /// The axes are looked at when a round of reads is over. One that is due waits for what it rests on, but not for
    /// a device that is slow, nor for one that is due again as soon as it has been read.
    fn may_step(&self, now: Moment) -> bool {
        let is_outstanding = |by: Moment| self.polls.iter().any(|poll| poll.is_outstanding(by));
        let is_due = self.step_due.filter(|due| self.steps_axes && *due <= now);
        let is_late =
            |due: &Moment| now.since(*due) >= SLOW && self.polls.iter().all(|poll| poll.has_been_read);
        is_due.is_some_and(|due| !is_outstanding(due) || is_late(&due))
            || (self.has_news && !is_outstanding(now))
    }

    /// A read that waits for nobody: of a position that is corrected, or of readings that are half way to being stale.
    fn pressing(&self, now: Moment) -> Option<usize> {
        let polls = self.polls.iter().enumerate().filter(|(_, poll)| poll.due() <= now);
        let pressing = polls.filter(|(_, poll)| {
            (poll.reads_position && now.since(poll.due()) >= SLOW) || poll.grows_stale(now)
        });
        pressing.map(|(place, poll)| (!poll.reads_position, poll.due(), place)).min().map(|(.., place)| place)
    }

    /// When there is something to do again.
    fn rests_until(&self) -> Moment {
        let polls = self.polls.iter().map(|poll| poll.due());
        let jobs = self.working_jobs().map(|(_, job)| job.due);
        let pulse = self.pulse.iter().map(|pulse| pulse.due);
        let step = self.step_due.filter(|_| self.steps_axes);
        polls.chain(jobs).chain(pulse).chain(step).min().unwrap_or(Moment::END)
    }

    /// Counts a sleep that ended so late, and what was late before it.
    fn account(&mut self, late: Duration) {
        let Overruns { count: overruns, worst } = std::mem::take(&mut self.overruns);
        if let Some((late, device)) = worst {
            let what = || format!("a poll of {}", self.shared.profile.device(device).name);
            self.shared.overrun(self.bus, overruns, late, what);
        }
        let is_connected = match &self.can {
            Some(can) => can.link.fault().is_none(),
            None => self.line.is_connected(),
        };
        let mut core = self.shared.core();
        let count = &mut core.contact.buses[self.bus.0];
        count.cycles += 1;
        count.connected = is_connected;
        let late_ms = late.as_secs_f64() * 1000.0;
        let bucket = JITTER_MS.iter().position(|bound| late_ms <= *bound).unwrap_or(JITTER_MS.len());
        count.jitter[bucket] += 1;
    }
}

/// The lines on which axes are stepped: where the first input of each is read, or its output is written.
fn home_lines(profile: &Profile) -> Vec<BusId> {
    let homes = profile.axes.iter().enumerate().map(|(axis, settings)| {
        let input = settings.settings.models.iter().flat_map(Model::signals).next();
        let input = input.map(|signal| profile.signal(signal).device);
        let output = profile.outputs.iter().find(|output| output.axis.0 == axis).map(|output| output.device);
        input.or(output).map_or(BusId(0), |device| profile.device(device).bus)
    });
    homes.collect()
}
