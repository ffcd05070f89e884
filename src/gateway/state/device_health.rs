//! Health of devices and bus lines: counts of requests and failures, and reports when a device or connection is lost
//! and when it returns.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use crate::fieldbus::error::Fault;
use crate::fieldbus::explain::{advised_on, explain_on, remedy_of_a_reading};
use crate::fieldbus::kinds;
use crate::fieldbus::seen::{Others, Seen};
use crate::fieldbus::wire::Request;
use crate::observe::events::Event;
use isotherm_core::explained::{Cause, Explained};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::{Reason, SignalId};
use isotherm_profile::{BusId, Device, DeviceId, OutputId, Profile};

use super::failed_reads::{FailedReads, PlannedReads};
use super::output_faults;

/// Number of consecutive failures after which a device is reported as lost. A single lost answer is not reported.
const REPORTED_AFTER: u64 = 2;
/// Number of consecutive failures after which a device on a lossy bus (Modbus RTU) is reported as lost. Such
/// a bus sometimes loses an answer, and the request is repeated at once. On TCP, [`REPORTED_AFTER`] applies,
/// because the gateway opens a new connection after the second missing answer. [`REPORTED_AFTER`] also
/// applies behind a Modbus gateway, because a device there receives requests too seldom.
const REPORTED_AFTER_LOSSES: u64 = 3;

/// Time for which a lost device must answer before it is reported as returned. A device with repeated short losses is
/// therefore reported once.
const RETURNED_AFTER: Duration = Duration::from_secs(10);

/// Time without a late cycle of a bus line after which the next late cycle is reported again.
const REPORTED_AGAIN: Duration = Duration::from_secs(600);
/// Minimum delay of a late cycle that is reported. A shorter delay is only counted, because an operator cannot do
/// anything about it.
const WORTH_A_WORD: Duration = Duration::from_millis(10);

/// Hint for a temperature reading that is outside the default `range`. The default applies because the profile sets
/// no `range`.
const BEYOND_DEFAULT_RANGE: &str = "is the sensor broken, or are `scale` or `word_order` wrong? If the value is \
                                    right, write `range`; for a difference of temperatures, write \
                                    `difference = true`";
/// Hint for a temperature reading that changes faster than the default `max_rate`.
const BEYOND_DEFAULT_RATE: &str =
    "is a contact loose, does a drive disturb the signal? If not, write a larger `max_rate`, or \"none\"";

/// Health of all devices and bus lines of the profile.
#[derive(Clone, Debug)]
pub(in crate::gateway) struct DeviceHealth {
    profile: Arc<Profile>,
    reads: Arc<PlannedReads>,
    pub(in crate::gateway) devices: Vec<DeviceCount>,
    pub(in crate::gateway) buses: Vec<BusCount>,
    /// Age of each signal's last value by the timestamp of its server. `None` without a timestamp.
    pub(in crate::gateway) stamped: Vec<Option<Duration>>,
}

/// Numbers of requests and failures of one device, and its loss if the device does not answer now.
#[derive(Clone, Debug, Default)]
pub(in crate::gateway) struct DeviceCount {
    pub(in crate::gateway) requests: u64,
    pub(in crate::gateway) failures: BTreeMap<&'static str, u64>,
    pub(in crate::gateway) answered: bool,
    pub(in crate::gateway) lost: Option<LostDevice>,
    failed: FailedReads,
    /// State of the device's OPC UA subscription that was reported last.
    pub(in crate::gateway) subscription: String,
}

/// Device that does not answer.
#[derive(Clone, Debug, Default)]
pub(in crate::gateway) struct LostDevice {
    pub(in crate::gateway) fault: Explained,
    /// Number of requests that failed since the loss of the device.
    pub(in crate::gateway) missed: u64,
    /// Reported cause of the loss. `None` until the loss is reported.
    reported: Option<Cause<String>>,
    /// Time since which the device answers again. `None` while the device does not answer.
    pub(in crate::gateway) answers_since: Option<Moment>,
}

/// Bus line without a connection.
#[derive(Clone, Debug)]
pub(in crate::gateway) struct DisconnectedLine {
    /// Number of attempts to connect since the connection was lost.
    pub(in crate::gateway) attempts: u64,
    cause: Cause<String>,
}

/// Connection state of one bus line, and the numbers of its cycles and late cycles.
#[derive(Clone, Debug, Default)]
pub(in crate::gateway) struct BusCount {
    pub(in crate::gateway) connected: bool,
    pub(in crate::gateway) down: Option<DisconnectedLine>,
    pub(in crate::gateway) cycles: u64,
    pub(in crate::gateway) overruns: u64,
    overrun_at: Option<Moment>,
    pub(in crate::gateway) jitter: [u64; JITTER_MS.len() + 1],
}

/// Number of consecutive failures with a new cause, after which this cause is reported. The first number is
/// for attempts to connect, the second number for requests.
const CHANGED_AFTER_ATTEMPTS: u32 = 2;
const CHANGED_AFTER_REQUESTS: u32 = 20;

/// Upper bounds of the buckets of the jitter histogram, ms. Jitter is the time by which a sleep of the line task ends
/// too late.
pub(in crate::gateway) const JITTER_MS: [f64; 7] = [0.5, 1.0, 2.0, 5.0, 10.0, 50.0, 200.0];

impl DeviceHealth {
    pub(in crate::gateway) fn new(profile: &Arc<Profile>) -> DeviceHealth {
        DeviceHealth {
            profile: profile.clone(),
            reads: Arc::new(PlannedReads::of(profile)),
            devices: vec![DeviceCount::default(); profile.devices.len()],
            buses: vec![BusCount::default(); profile.buses.len()],
            stamped: vec![None; profile.signals.len()],
        }
    }

    /// Counts late cycles of a bus line, and returns true if they must be reported. `late` contains their
    /// number and the longest delay. Late cycles are not reported while a device of the line does not answer,
    /// because the line then waits for this device.
    pub(in crate::gateway) fn overrun(&mut self, id: BusId, late: (u64, Duration), now: Moment) -> bool {
        let (count, longest) = late;
        let mut devices = self.profile.devices_on(id);
        let waits = devices.any(|(device, _)| self.devices[device.0].does_not_answer());
        let bus = &mut self.buses[id.0];
        bus.overruns += count;
        if waits || longest < WORTH_A_WORD {
            return false;
        }
        let before = bus.overrun_at.replace(now);
        before.is_none_or(|before| now.since(before) >= REPORTED_AGAIN)
    }

    /// Returns cause and hint for a signal that may not be used. The cause names the raw value with which the device
    /// reports the fault, the timestamp of the server, or the fault of device or connection.
    pub(in crate::gateway) fn why(&self, id: SignalId, reason: Reason) -> Explained {
        self.cause_of(id, reason).or_hint(remedy_of_a_reading(reason))
    }

    fn cause_of(&self, id: SignalId, reason: Reason) -> Explained {
        let signal = self.profile.signal(id);
        let said = signal.encoding.bad.iter().filter(|sentinel| sentinel.means == reason);
        let raw: Vec<String> = said.map(|sentinel| sentinel.raw.to_string()).collect();
        if !raw.is_empty() {
            return format!("{reason} (raw {})", raw.join(" or ")).into();
        }
        let device = &self.devices[signal.device.0];
        let lost = device.lost.as_ref().filter(|lost| !lost.fault.cause.is_empty());
        let seen = self.reads.of_signal(&device.failed, (id, signal.device));
        let seen = seen.filter(|seen| seen.fault.reason() == reason);
        // If the device answers other requests, the fault concerns this read.
        let own = seen.filter(|seen| lost.is_none() || seen.others == Others::Answered);
        match (reason, lost, own) {
            (Reason::Timeout | Reason::BadReply, _, Some(seen)) => self.explained(signal.device, seen),
            (Reason::LinkDown | Reason::Timeout | Reason::BadReply | Reason::NeverRead, Some(lost), _) => {
                lost.fault.clone()
            }
            (Reason::Stale, ..) => self.why_stale(id).unwrap_or_else(|| reason.to_string().into()),
            (Reason::Jumped | Reason::ScaleChanged, ..) => {
                let (path, device) = (self.profile.path.display(), &self.profile.device(signal.device).name);
                let question = match reason {
                    Reason::ScaleChanged => "is the value at the device the same as before?",
                    _ => "is it the same device with the same settings?",
                };
                Explained::new(
                    reason.to_string(),
                    format!("{question} If so: isotherm confirm {path} {device}"),
                )
            }
            (Reason::Exception(code), ..) => {
                self.explained(signal.device, seen.unwrap_or(Seen::from(Fault::Exception(code))))
            }
            (Reason::OutOfRange, ..) => {
                let limit = signal.defaults.range_condition(signal.unit);
                by_default(reason, limit, BEYOND_DEFAULT_RANGE)
            }
            (Reason::TooFast, ..) => {
                let limit = signal.defaults.rate_condition(signal.unit);
                by_default(reason, limit, BEYOND_DEFAULT_RATE)
            }
            _ => reason.to_string().into(),
        }
    }

    /// Returns cause and hint for a signal that is read, but whose timestamp is too old. `None` if the timestamp is
    /// not the cause.
    fn why_stale(&self, id: SignalId) -> Option<Explained> {
        let signal = self.profile.signal(id);
        let age = self.stamped[id.0].filter(|age| *age >= signal.max_age / 2)?.as_secs_f64();
        let (digits, device) = (usize::from(age < 10.0), &self.profile.device(signal.device).name);
        Some(Explained::new(
            format!("{}: the server's timestamp is {age:.digits$} s old", Reason::Stale),
            format!(
                "if the server updates the timestamp only when the value changes, write source_time = \
                 \"changed\" at device {device}"
            ),
        ))
    }

    /// Returns cause and hint for a failed request of an output.
    pub(super) fn why_of_output(&self, output: OutputId, seen: Seen) -> Explained {
        let fault = seen.fault;
        let id = self.profile.output(output).device;
        match &self.devices[id.0].lost {
            Some(lost) if fault.is_of_the_line() && !lost.fault.cause.is_empty() => lost.fault.clone(),
            _ => {
                let words = output_faults::of_an_output(&self.profile, output, fault);
                advised_on(self.profile.bus(self.profile.device(id).bus).transport, seen, words)
            }
        }
    }

    fn explained(&self, id: DeviceId, seen: impl Into<Seen>) -> Explained {
        explain_on(self.profile.bus(self.profile.device(id).bus).transport, seen)
    }

    /// Records the result of a request, for the advice in later messages. Returns the description of the
    /// request if the request has failed.
    pub(in crate::gateway) fn record(
        &mut self,
        id: DeviceId,
        request: Request<'_>,
        outcome: Result<(), Fault>,
    ) -> Option<Seen> {
        self.reads.record(&mut self.devices[id.0].failed, (id, request), outcome)
    }

    /// Records an answer or a frame from a device.
    pub(in crate::gateway) fn answers(&mut self, id: DeviceId, now: Moment, events: &mut Vec<Event>) {
        let count = &mut self.devices[id.0];
        if count.is_here() {
            return;
        }
        count.answered = true;
        let has_returned = match &mut count.lost {
            Some(lost) if lost.reported.is_some() => {
                now.since(*lost.answers_since.get_or_insert(now)) >= RETURNED_AFTER
            }
            _ => true,
        };
        let lost = count.lost.take_if(|_| has_returned).filter(|lost| lost.reported.is_some());
        let bus = self.profile.device(id).bus;
        if self.requests_show_link(bus) {
            self.link_is_up(bus, events);
        }
        let device = self.profile.device(id);
        events.extend(lost.map(|lost| Event::DeviceBack {
            device: device.name.clone(),
            at: device.at(),
            missed: lost.missed,
        }));
    }

    /// Counts a failed request. `attempts`: number of failed attempts to connect before the request. `refused`: fault
    /// of these attempts.
    pub(in crate::gateway) fn fails(
        &mut self,
        id: DeviceId,
        seen: impl Into<Seen>,
        (attempts, refused): (u32, Fault),
        events: &mut Vec<Event>,
    ) {
        let seen = seen.into();
        // A failure after a connection was made is the fault of the device.
        if seen.fault.is_of_the_line() && attempts > 0 {
            let refusal = self.explained(id, refused);
            self.devices[id.0].misses(refusal);
            let bus = self.profile.device(id).bus;
            if self.requests_show_link(bus) {
                self.link_is_down(bus, attempts.into(), refused, events);
            }
            return;
        }
        let explained = self.explained(id, seen);
        let count = &mut self.devices[id.0];
        let bus = self.profile.bus(self.profile.device(id).bus);
        let is_lossy = kinds::of(bus.transport).is_lossy && !self.profile.is_behind_gateway(id);
        let reported_after = if is_lossy && count.answered { REPORTED_AFTER_LOSSES } else { REPORTED_AFTER };
        let lost = count.misses(explained);
        if lost.missed >= reported_after && lost.has_news() {
            events.push(lost.report(self.profile.device(id)));
        }
    }

    /// Records that a device has stopped sending, and reports its loss once. If the bus of the device is down, only
    /// the fault of the bus is reported.
    pub(in crate::gateway) fn is_silent(&mut self, id: DeviceId, fault: Explained, events: &mut Vec<Event>) {
        let is_down = self.buses[self.profile.device(id).bus.0].down.is_some();
        let lost = self.devices[id.0].misses(fault);
        if !is_down && lost.has_news() {
            events.push(lost.report(self.profile.device(id)));
        }
    }

    /// Returns whether the result of a request shows the state of the bus line's connection. On CAN, only the
    /// listener of the interface reports this state. There, the result of a request can be older than a change of the
    /// state.
    fn requests_show_link(&self, bus: BusId) -> bool {
        !self.profile.bus(bus).transport.is_can()
    }

    /// Records that a bus line has a connection or an interface again, and reports this.
    pub(in crate::gateway) fn link_is_up(&mut self, id: BusId, events: &mut Vec<Event>) {
        let bus = self.profile.bus(id);
        events.extend(self.buses[id.0].down.take().map(|down| Event::LinkUp {
            bus: bus.name.clone(),
            address: bus.address.clone(),
            attempts: down.attempts,
        }));
    }

    /// Records that the bus line has no connection after `attempts` attempts. Reports the loss of the connection, and
    /// each change of its cause.
    pub(in crate::gateway) fn link_is_down(
        &mut self,
        id: BusId,
        attempts: u64,
        fault: Fault,
        events: &mut Vec<Event>,
    ) {
        let bus = self.profile.bus(id);
        let cause = explain_on(bus.transport, fault);
        let is_news = match &mut self.buses[id.0].down {
            Some(down) => {
                down.attempts = attempts;
                down.cause.is_now(cause.cause.clone(), CHANGED_AFTER_ATTEMPTS)
            }
            down => {
                *down = Some(DisconnectedLine { attempts, cause: Cause::new(cause.cause.clone()) });
                true
            }
        };
        if is_news {
            let (bus, address) = (bus.name.clone(), bus.address.clone());
            let excludes_wiring = fault.excludes_wiring();
            events.push(Event::LinkDown { bus, address, fault: cause, excludes_wiring });
        }
    }
}

impl DeviceCount {
    /// Returns whether the device has answered and is not lost.
    pub(in crate::gateway) fn is_here(&self) -> bool {
        self.answered && self.lost.is_none()
    }

    /// Returns true if the loss of the device was reported, but not yet its return.
    pub(in crate::gateway) fn is_reported_lost(&self) -> bool {
        self.lost.as_ref().is_some_and(|lost| lost.reported.is_some())
    }

    /// Returns whether the last request was not answered.
    pub(super) fn does_not_answer(&self) -> bool {
        self.lost.as_ref().is_some_and(|lost| lost.answers_since.is_none())
    }

    /// Counts a request that the device did not answer, or that could not be sent.
    fn misses(&mut self, fault: Explained) -> &mut LostDevice {
        let lost = self.lost.get_or_insert_default();
        (lost.missed, lost.answers_since, lost.fault) = (lost.missed + 1, None, fault);
        lost
    }
}

impl LostDevice {
    /// Returns whether a loss or a new cause of the loss must be reported.
    fn has_news(&mut self) -> bool {
        let fault = &self.fault;
        self.reported.as_mut().is_none_or(|cause| cause.is_now(fault.cause.clone(), CHANGED_AFTER_REQUESTS))
    }

    fn report(&mut self, device: &Device) -> Event {
        self.reported = Some(Cause::new(self.fault.cause.clone()));
        Event::DeviceLost { device: device.name.clone(), at: device.at(), fault: self.fault.clone() }
    }
}

/// Returns the reason why a reading is rejected. `limit` is the default limit that the reading exceeds; `None` if the
/// limit is set in the profile or the template.
fn by_default(reason: Reason, limit: Option<String>, hint: &'static str) -> Explained {
    match limit {
        Some(limit) => Explained::new(format!("{reason} ({limit}, the default limit)"), hint),
        None => reason.to_string().into(),
    }
}

#[cfg(test)]
mod tests;
