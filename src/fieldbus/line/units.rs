//! Devices of a line (units): permitted requests, and back-off after a failure. A `place` is the index of a device in
//! the list of the line.

use std::time::Duration;

use super::seed;
use crate::fieldbus::backoff::Backoff;
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::kinds;
use crate::fieldbus::kinds::modbus::pending_replies::{PendingReplies, Spans, UnitReplies};
use crate::fieldbus::kinds::modbus::reply_signature::ReplySignature;
use crate::fieldbus::wire::Request;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Device, DeviceId, Functions, Quirks, Transport};

/// Shortest pause after a missing answer of a unit without reliable transaction numbers. A multiple of a very short
/// timeout would be too short, because a late answer may take longer.
const SHORTEST_REST: Duration = Duration::from_millis(750);
/// Maximum number of consecutive requests without an answer for which the pause of a unit does not grow. This
/// applies to units that have answered in time before, on lines without reliable transaction numbers.
const PATIENT: u32 = 3;
/// Number of consecutive requests without an answer, after which a unit counts as dead.
const DEAD: u32 = 2;
/// Length of the first pause after a failure.
pub(super) const FIRST_PAUSE: Duration = Duration::from_secs(1);

/// One device on the line, with its settings and the times of its requests.
#[derive(Debug)]
pub(super) struct Unit {
    pub(super) device: DeviceId,
    pub(super) number: u8,
    pub(super) functions: Functions,
    pub(super) quirks: Quirks,
    pub(super) breaker: Backoff,
    pub(super) last_fault: Fault,
    /// Whether the unit has checks (comparisons with expected values, key `verify`) that must pass before its readings
    /// are used. An OPC UA server always has a check of its namespaces.
    pub(super) is_checked: bool,
    /// Whether a Modbus gateway to a serial line is in front of the unit. A late answer of the unit may then have the
    /// transaction number of another request.
    pub(super) is_behind_gateway: bool,
    /// Time of the last request that the unit has answered.
    pub(super) received: Moment,
    /// Time of the last request that was sent to the unit.
    pub(super) tried: Moment,
    /// Start of the last round of reads, in which the line read all signals of the device once; `None` if the device is
    /// not read in rounds.
    pub(super) round: Option<Moment>,
    /// Age at which the readings of the device are too old; `Duration::MAX` if the device has no limit.
    pub(super) max_age: Duration,
}

impl Unit {
    /// Returns the time of the request that delivered the oldest present reading of the device. Writes, and reads that
    /// verify writes, do not count.
    pub(super) fn read_since(&self) -> Moment {
        self.round.map_or(self.received, |round| round.min(self.received))
    }
}

/// All devices of the line. Several devices of a profile may have the same unit number.
pub(super) struct Units {
    all: Vec<Unit>,
    /// Late answers that may still arrive, by unit number.
    pub(super) pending: UnitReplies,
}

impl Units {
    pub(super) fn of(transport: Transport, devices: &[(DeviceId, &Device)]) -> Units {
        let is_tcp = transport == Transport::Tcp;
        let numbers = || devices.iter().map(|(_, device)| device.unit);
        let unit = |(id, device): &(DeviceId, &Device)| Unit {
            device: *id,
            number: device.unit,
            functions: device.functions,
            quirks: device.quirks,
            breaker: Backoff::new(FIRST_PAUSE, seed(&device.name)),
            last_fault: Fault::Link(LinkFault::Down),
            is_checked: device.is_checked() || kinds::of(transport).has_namespaces,
            is_behind_gateway: device.quirks.gateway.is_present(transport, numbers()),
            received: Moment::default(),
            tried: Moment::default(),
            round: None,
            max_age: Duration::MAX,
        };
        let mut pending = UnitReplies::of_units(numbers());
        if is_tcp {
            // A Modbus gateway has one request at a time on its serial line. An answer to an earlier process therefore
            // gets no new transaction number.
            pending.each().for_each(PendingReplies::is_quiet);
        }
        Units { all: devices.iter().map(unit).collect(), pending }
    }

    /// Returns the index of a device in the list of the line's units (its `place`); `None` if the device is not on the
    /// line.
    pub(super) fn place(&self, device: DeviceId) -> Option<usize> {
        self.all.iter().position(|unit| unit.device == device)
    }

    /// Returns the index of the first device with this unit number in the list of units; `None` if there is none.
    pub(super) fn place_of(&self, number: u8) -> Option<usize> {
        self.all.iter().position(|unit| unit.number == number)
    }

    pub(super) fn at(&self, place: usize) -> &Unit {
        &self.all[place]
    }

    pub(super) fn at_mut(&mut self, place: usize) -> &mut Unit {
        &mut self.all[place]
    }

    pub(super) fn get(&self, device: DeviceId) -> Option<&Unit> {
        self.all.iter().find(|unit| unit.device == device)
    }

    /// Sets the age at which the readings of each device are too old.
    pub(super) fn set_ages(&mut self, max_age_of: impl Fn(DeviceId) -> Duration) {
        self.all.iter_mut().for_each(|unit| unit.max_age = max_age_of(unit.device));
    }

    /// Returns the number of devices of the profile on the line.
    pub(super) fn count(&self) -> u32 {
        u32::try_from(self.all.len()).unwrap_or(u32::MAX)
    }

    /// Returns whether the unit has answered its last request.
    pub(super) fn is_live(&self, place: usize) -> bool {
        let unit = self.at(place);
        let is_answering = unit.breaker.failures() == 0 && self.missed(unit.number) == 0;
        unit.received != Moment::default() && is_answering
    }

    /// Returns whether the unit counts as dead: it has never answered, or has not answered two requests in a row. A
    /// single lost answer may be chance.
    pub(super) fn is_dead(&self, place: usize) -> bool {
        let unit = self.at(place);
        unit.breaker.failures() > 0 || self.missed(unit.number) >= DEAD
    }

    /// Returns the devices behind the Modbus gateway that have answered their last requests.
    pub(super) fn live(&self) -> impl Iterator<Item = &Unit> {
        let live = (0..self.all.len()).filter(move |place| self.is_live(*place));
        live.map(move |place| self.at(place)).filter(|unit| unit.is_behind_gateway)
    }

    /// Returns the devices with this unit number.
    pub(super) fn named(&self, number: u8) -> impl Iterator<Item = DeviceId> {
        self.all.iter().filter(move |unit| unit.number == number).map(|unit| unit.device)
    }

    pub(super) fn pending(&mut self, place: usize) -> &mut PendingReplies {
        self.pending.of(self.all[place].number)
    }

    /// Returns whether the last request to the unit with this number ended with a timeout.
    pub(super) fn has_timed_out(&self, number: u8) -> bool {
        self.missed(number) > 0
            && self.all.iter().any(|unit| unit.number == number && unit.last_fault == Fault::Timeout)
    }

    /// Returns the number of consecutive requests that the unit with this number has not answered.
    fn missed(&self, number: u8) -> u32 {
        self.pending.get(number).map_or(0, PendingReplies::missed)
    }

    /// Ends the back-off of a device. `None` ends the back-off of all devices.
    pub(super) fn revive(&mut self, device: Option<DeviceId>) {
        for unit in self.all.iter_mut().filter(|unit| device.is_none_or(|one| one == unit.device)) {
            unit.breaker.succeed();
            unit.tried = Moment::default();
        }
    }

    /// Records that an answer is missing, and may still arrive without a reliable transaction number. A unit that
    /// usually answers promptly may get a request again. Any other unit gets no request until the late answer can no
    /// longer arrive.
    pub(super) fn misses(
        &mut self,
        place: usize,
        (request, asked, missed): (Request<'_>, Moment, Moment),
        fault: Fault,
        now: Moment,
        spans: Spans,
    ) {
        let is_behind_gateway = self.all[place].is_behind_gateway;
        let pending = self.pending(place);
        let is_lost = fault.is_of_a_gateway() || fault.is_missing_answer();
        if !is_lost {
            pending.reset_timing();
        }
        // A control question differs in form from each late answer. If answers of two forms may be late, there may be
        // none.
        let are_alike = pending.marks().all(|mark| mark == ReplySignature::of(request));
        let may_be_asked = pending.misses(request, asked, missed) && (are_alike || !is_behind_gateway);
        self.all[place].last_fault = fault;
        if !may_be_asked {
            self.back_off(place, fault, now, spans);
        }
    }

    /// Stops requests to the unit of this device while a late answer may still arrive, also for other devices
    /// with the same unit number. The pause of the device also doubles, with one exception. The pause stays
    /// the same after 1 to [`PATIENT`] missing answers in a row, if the unit has answered in time since its
    /// last late answer.
    pub(super) fn back_off(&mut self, place: usize, fault: Fault, now: Moment, spans: Spans) {
        let quiet = now.after((spans.timeout + spans.grace).max(spans.timeout + SHORTEST_REST));
        let number = self.all[place].number;
        let pending = self.pending.of(number);
        pending.anything();
        if !pending.has_answered() || !(1..=PATIENT).contains(&pending.missed()) {
            self.all[place].breaker.fail(now.after(spans.timeout));
        }
        for unit in self.all.iter_mut().filter(|unit| unit.number == number) {
            unit.breaker.not_before_either(quiet);
            unit.last_fault = fault;
        }
    }
}
