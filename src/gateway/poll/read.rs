//! The reads of one device, one request at a time.

use std::time::Duration;

use super::{Captures, LineTask, devices_of, signals_of};
use crate::fieldbus::departure::Leave;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reason;
use isotherm_profile::plan::{ReadRequest, plan};
use isotherm_profile::{BusId, DeviceId, Profile};

/// One device's reads.
pub(super) struct Poll {
    device: DeviceId,
    every: Duration,
    /// When its next round begins.
    next: Moment,
    /// The round that is under way: when it was due, and the request that comes next.
    under_way: Option<(Moment, usize)>,
    /// A position that is corrected is among them.
    pub(super) reads_position: bool,
    /// It was read to its end, or could not be.
    pub(super) has_been_read: bool,
    /// When its last round began, and how old that may become.
    read_at: Moment,
    max_age: Duration,
    captures: Captures,
    requests: Vec<ReadRequest>,
}

/// The reads of a line. Those of positions that are corrected come last, so that nothing stands between the two.
pub(super) fn polls(profile: &Profile, bus: BusId, corrected: &[DeviceId], start: Moment) -> Vec<Poll> {
    let poll = |device: DeviceId| Poll {
        device,
        every: profile.device(device).every,
        next: start,
        under_way: None,
        reads_position: corrected.contains(&device),
        has_been_read: false,
        read_at: start,
        max_age: signals_of(profile, device).map(|(_, signal)| signal.max_age).min().unwrap_or(Duration::MAX),
        captures: Captures::new(signals_of(profile, device).filter_map(|(_, signal)| signal.capture)),
        requests: plan(profile.device(device), signals_of(profile, device)),
    };
    let mut polls: Vec<Poll> =
        devices_of(profile, bus).map(poll).filter(|poll| !poll.requests.is_empty()).collect();
    polls.sort_by_key(|poll| poll.reads_position);
    polls
}

impl Poll {
    pub(super) fn requests(&self) -> usize {
        self.requests.len()
    }

    /// When the round that is under way was due, else when the next one is.
    pub(super) fn due(&self) -> Moment {
        self.under_way.map_or(self.next, |(due, _)| due)
    }

    /// It was due by then and has not been read since.
    pub(super) fn is_outstanding(&self, by: Moment) -> bool {
        let has_been_read = self.has_been_read && self.under_way.is_none() && self.read_at >= by;
        self.due() <= by && !has_been_read
    }

    pub(super) fn is_under_way(&self) -> bool {
        self.under_way.is_some()
    }

    /// Its readings have lived half of the time for which they may be used.
    pub(super) fn grows_stale(&self, now: Moment) -> bool {
        now.since(self.read_at) >= self.max_age / 2
    }

    /// It is read at once, from its first request on.
    pub(super) fn begin_anew(&mut self, now: Moment) {
        (self.next, self.under_way) = (now, None);
    }
}

impl LineTask {
    /// One request of a device's reads, and what it brings. What the device must be told before goes with the first.
    pub(super) async fn read(&mut self, place: usize, now: Moment) {
        let presses = self.pressing_now(place, now);
        self.pressed = if presses { self.pressed + 1 } else { 0 };
        let poll = &mut self.polls[place];
        let (due, request) = poll.under_way.unwrap_or((poll.next, 0));
        if request == 0 {
            poll.next = now.next_tick(due, poll.every);
            poll.read_at = now;
            let late = now.since(due);
            if late >= poll.every {
                self.overruns.note(late, poll.device);
            }
            poll.captures.send(&mut self.line, &self.shared, poll.device).await;
        }
        let is_last = request + 1 == poll.requests.len();
        poll.under_way = (!is_last).then_some((due, request + 1));
        self.ask(place, request).await;
        if is_last {
            self.has_read(place);
        }
    }

    /// Whether it goes before others because it presses.
    fn pressing_now(&self, place: usize, now: Moment) -> bool {
        self.polls[place].reads_position || self.polls[place].grows_stale(now)
    }

    async fn ask(&mut self, place: usize, request: usize) {
        let poll = &self.polls[place];
        let read = &poll.requests[request];
        let answer = self.line.request(poll.device, read.asks.into(), Leave::Whenever).await;
        let mut core = self.shared.core();
        let is_fit = core.commissioning.is_fit(poll.device);
        for field in &read.fields {
            let signal = self.shared.profile.signal(field.signal);
            match (poll.captures.captured(signal.capture), &answer) {
                (Ok(captured), Ok(answered)) => {
                    let value = answered.answer.decode(field, &signal.encoding);
                    let value = value.and_then(|value| is_fit.then_some(value).ok_or(Reason::NotAsExpected));
                    let asked = captured.map_or(answered.asked, |captured| captured.min(answered.asked));
                    core.board.store(&self.shared.profile, field.signal, value, asked);
                }
                (Err(fault), _) | (_, &Err(fault)) => core.board.fail(field.signal, fault.reason()),
            }
        }
    }

    /// A device has been read to its end: its position is corrected next, here or on another line.
    fn has_read(&mut self, place: usize) {
        let now = self.line.looked();
        // At once: a line that always has something to read may never come to the end of a round.
        self.shared.look_for_restarts(now);
        self.shared.hear_probings(now);
        let poll = &mut self.polls[place];
        poll.has_been_read = true;
        (self.has_news, self.inspects) = (true, true);
        if poll.reads_position {
            let device = poll.device;
            self.wake_corrections(device, now);
        }
        self.wakes_others = self.feeds_others;
    }
}
