//! Reads of one device, one request at a time.

use std::collections::HashSet;
use std::time::Duration;

use super::Overruns;
use super::stamps::accepted;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::line::{Attribution, DeviceLine};
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::Request;
use crate::gateway::shared::line_handle::LineHandle;
use crate::gateway::state::scales::ScalePlace;
use isotherm_core::codec::{Encoded, Table};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reason;
use isotherm_profile::plan::ReadRequest;
use isotherm_profile::{BusId, Capture, Device, DeviceId, Profile, Signal};

/// Maximum number of repeated requests in one round of reads. The gateway repeats a request because a single lost
/// answer does not show that the device is lost.
const REPEATS: u32 = 3;

/// Reads of one device: the requests, and the times at which they are due.
pub(super) struct Poll {
    pub(super) device: DeviceId,
    pub(super) every: Duration,
    /// Time at which the next round of requests begins.
    next: Moment,
    /// Round of requests that has begun: the time at which it was due, and the index of its next request. `None`
    /// between two rounds.
    under_way: Option<(Moment, usize)>,
    /// Time at which the task repeats an unanswered request; `None` if no request must be repeated. `repeats`: number
    /// of repetitions in this round.
    again: Option<Moment>,
    repeats: u32,
    /// Whether an output corrects a position that is read from this device.
    pub(super) reads_position: bool,
    /// Whether a round of reads of this device was completed, successfully or not.
    pub(super) has_been_read: bool,
    /// Whether an answer was discarded because the device had not passed its checks at that time.
    is_discarded: bool,
    /// Start of the last round of reads (`read_at`), and the shortest `max_age` of the signals of the device
    /// (`max_age`).
    read_at: Moment,
    max_age: Duration,
    captures: Captures,
    requests: Vec<ReadRequest>,
}

/// Creates the reads of all devices on a line. The devices with corrected positions come last, so that the outputs
/// can write the corrected positions directly after the reads.
pub(super) fn polls(
    profile: &Profile,
    bus: BusId,
    corrected: &HashSet<DeviceId>,
    start: Moment,
) -> Vec<Poll> {
    let poll = |(id, device): (DeviceId, &Device)| Poll {
        device: id,
        every: device.every,
        next: start,
        under_way: None,
        again: None,
        repeats: 0,
        reads_position: corrected.contains(&id),
        has_been_read: false,
        is_discarded: false,
        read_at: start,
        max_age: profile.shortest_age_of(id),
        captures: Captures::new(profile.signals_of(id).filter_map(|(_, signal)| signal.capture)),
        requests: profile.requests(id),
    };
    let mut polls: Vec<Poll> =
        profile.devices_on(bus).map(poll).filter(|poll| !poll.requests.is_empty()).collect();
    polls.sort_by_key(|poll| poll.reads_position);
    polls
}

impl Poll {
    pub(super) fn requests(&self) -> usize {
        self.requests.len()
    }

    /// Returns the time at which the next request of the device is due. The request repeats an unanswered request,
    /// continues the present round, or begins the next round.
    pub(super) fn due(&self) -> Moment {
        self.again.or(self.under_way.map(|(due, _)| due)).unwrap_or(self.next)
    }

    /// Returns whether the device was due at the time `by`, and its round of reads is not complete yet.
    pub(super) fn is_outstanding(&self, by: Moment) -> bool {
        let has_been_read = self.has_been_read && self.under_way.is_none() && self.read_at >= by;
        self.due() <= by && !has_been_read
    }

    pub(super) fn is_under_way(&self) -> bool {
        self.under_way.is_some()
    }

    /// Returns whether the age of the readings has reached half of the shortest `max_age` of the device's
    /// signals.
    pub(super) fn grows_stale(&self, now: Moment) -> bool {
        now.since(self.read_at) >= self.max_age / 2
    }

    /// Returns the next request if it is due at the time `by`. `None` if the request repeats an unanswered request,
    /// or if a capture command must be sent first.
    pub(super) fn asks_next(&self, by: Moment) -> Option<(DeviceId, Request<'static>)> {
        let place = self.under_way.map_or(0, |(_, place)| place);
        let is_plain = self.again.is_none() && (place > 0 || self.captures.is_empty());
        let request = self.requests.get(place).filter(|_| is_plain && self.due() <= by)?;
        Some((self.device, Request::in_registers(&request.asks)?))
    }

    /// Makes a new round of reads of the device due at once.
    pub(super) fn restart(&mut self, now: Moment) {
        (self.next, self.under_way, self.again) = (now, None, None);
    }

    /// Makes a new round of reads due at once, if an answer was discarded and the device has passed its checks since
    /// then.
    pub(super) fn make_up(&mut self, shared: &LineHandle, now: Moment) {
        if self.is_discarded && shared.core().devices.is_confirmed(self.device) {
            self.is_discarded = false;
            self.restart(now);
        }
    }

    /// Executes one request, and stores the values of its answer. Sends capture commands before the first request of
    /// a round. Returns true if the round is complete.
    pub(super) async fn read(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        overruns: &mut Overruns,
        now: Moment,
    ) -> bool {
        let (due, place) = self.under_way.unwrap_or((self.next, 0));
        let is_repeated = self.again.take().is_some();
        if place == 0 && !is_repeated {
            (self.next, self.repeats) = (now.next_tick(due, self.every), 0);
            self.read_at = now;
            let late = now.since(due);
            if late >= self.every && !line.has_waited_since(due) {
                overruns.note(late, self.device);
            }
        }
        if place == 0 {
            self.captures.send(line, shared, self.device).await;
        }
        let request = &self.requests[place];
        let answer = line.request_unverified(self.device, Request::from(&request.asks)).await;
        let is_missed = answer.as_ref().is_err_and(|fault| fault.spoils_connection());
        let again = line.again_at(self.device).filter(|again| is_missed && *again < self.next);
        self.again = again.filter(|_| self.repeats < REPEATS);
        let is_last = self.again.is_none() && place + 1 == self.requests.len();
        let next = if self.again.is_some() { place } else { place + 1 };
        self.repeats += u32::from(next == place);
        self.under_way = (!is_last).then_some((due, next));
        if is_last {
            line.note_round(self.device, self.read_at);
        }
        let mut core = shared.core();
        let is_confirmed = core.devices.is_confirmed(self.device);
        if answer.is_ok() && core.devices.is_unconfirmed(self.device) {
            // Before the checks, nothing is known about the reading, not even that it is wrong.
            self.is_discarded = true;
            self.has_been_read |= is_last;
            return is_last;
        }
        let source_time = shared.profile.device(self.device).source_time;
        let confirmed = |encoded: Encoded| is_confirmed.then_some(encoded).ok_or(Reason::NotAsExpected);
        let breaks = core.devices.of(self.device).breaks_without_checks();
        let mut is_held_back =
            answer.as_ref().is_ok_and(|answer| answer.attribution == Attribution::Contested);
        for field in request.scales() {
            match &answer {
                Ok(answered) if answered.attribution == Attribution::Ours => {
                    let exponent = answered.answer.encoded(field).and_then(confirmed);
                    let signal = shared.profile.signal(field.signal);
                    let exponent = exponent.and_then(|encoded| exponent_of(signal, &encoded));
                    core.board.store_scale(field.signal, exponent, breaks);
                }
                Ok(_) => core.board.store_contested(field.signal),
                &Err(fault) => core.board.fail(field.signal, fault.reason()),
            }
        }
        for field in request.values() {
            let signal = shared.profile.signal(field.signal);
            match (self.captures.captured(signal), &answer) {
                (Ok(captured), Ok(answered)) => {
                    let value = answered.answer.decode(field, &signal.encoding);
                    let value =
                        value.and_then(|value| is_confirmed.then_some(value).ok_or(Reason::NotAsExpected));
                    let asked = answered.answer.asked(field).unwrap_or(answered.asked);
                    let asked = captured.map_or(asked, |captured| captured.min(asked));
                    let stamp = answered.answer.stamped(field);
                    let (value, taken, age) = accepted(source_time, stamp, value, asked);
                    if source_time.is_some() {
                        core.device_health.stamped[field.signal.0] = age;
                    }
                    let is_scaled = core.board.has_scale(field.signal);
                    match answered.attribution {
                        Attribution::Ours if is_scaled => {
                            let raw = answered.answer.encoded(field).and_then(confirmed);
                            let place = match request.has_scale_of(field.signal) {
                                true => ScalePlace::SameAnswer,
                                false => ScalePlace::OtherAnswer,
                            };
                            core.board.store_scaled(field.signal, raw, taken, breaks, place);
                        }
                        Attribution::Ambiguous if is_scaled => {
                            is_held_back = true;
                            core.board.store_contested(field.signal);
                        }
                        Attribution::Ours => core.board.store(field.signal, value, taken, breaks),
                        Attribution::Ambiguous => {
                            is_held_back |= !core.board.store_ambiguous(field.signal, value, taken, breaks);
                        }
                        Attribution::Contested => core.board.store_contested(field.signal),
                    }
                }
                (Err(fault), _) | (_, &Err(fault)) => core.board.fail(field.signal, fault.reason()),
            }
        }
        if is_held_back {
            // The hint then asks whether another master is on the line.
            let fault = Fault::Peer(PeerFault::Foreign);
            core.device_health.record(self.device, Request::from(&request.asks), Err(fault));
        }
        self.has_been_read |= is_last;
        is_last
    }
}

/// Returns the scale exponent (power of ten) of a signal from its scale register.
fn exponent_of(signal: &Signal, encoded: &Encoded) -> Result<i8, Reason> {
    signal.scale_from.as_ref().ok_or(Reason::NoScale)?.exponent(encoded.registers())
}

/// Capture commands of one device, without duplicates. By such a command, a counter copies its count into its
/// registers. The second value is the time at which the command was last sent, or the fault. This value is
/// `None` before the first attempt.
///
/// The commands are part of the reading. Therefore the gateway also sends them in a dry run, and before an axis is
/// armed.
#[derive(Debug)]
struct Captures(Vec<(Capture, Option<Result<Moment, Fault>>)>);

impl Captures {
    fn new(commands: impl Iterator<Item = Capture>) -> Captures {
        let mut captures: Vec<(Capture, Option<Result<Moment, Fault>>)> = Vec::new();
        for command in commands {
            if captures.iter().all(|(known, _)| *known != command) {
                captures.push((command, None));
            }
        }
        Captures(captures)
    }

    fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Sends all capture commands, and records for each command the time or the fault.
    async fn send(&mut self, line: &mut DeviceLine, shared: &LineHandle, device: DeviceId) {
        for (capture, sent) in &mut self.0 {
            let (at, value) = (capture.address.offset, [capture.value]);
            let request = match capture.address.table {
                Table::Coil => Request::write_coil(at, capture.value != 0),
                _ => Request::write_holding(at, &value, shared.profile.device(device).functions),
            };
            *sent =
                Some(line.request(device, request, SendDeadline::None).await.map(|answered| answered.asked));
        }
    }

    /// Returns the time at which the present value of a signal was captured. `None` if the value needs no capture
    /// command. An error means that the command failed: the value in the register is then from another time.
    fn captured(&self, signal: &Signal) -> Result<Option<Moment>, Fault> {
        let command = self.0.iter().find(|(own, _)| Some(*own) == signal.capture);
        command.and_then(|(_, sent)| *sent).transpose()
    }
}
