//! The devices of a line: what each may be asked, and how long one that failed is left alone.

use std::time::Duration;

use super::seed;
use crate::fieldbus::backoff::Backoff;
use crate::fieldbus::error::{Fault, LinkFault, PeerFault};
use crate::fieldbus::owed::{Debts, Owed, Spans};
use crate::fieldbus::wire::Request;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Device, DeviceId, Functions, Quirks, Transport};

/// No such unit is left alone for less after a miss: where timeouts are short, an answer may be later than four of them.
const SHORTEST_REST: Duration = Duration::from_millis(750);
/// Misses in a row of a unit that has answered before, on such a line, that make no pause longer.
const PATIENT: u32 = 3;
/// The first pause after a failure.
pub(super) const FIRST_PAUSE: Duration = Duration::from_secs(1);

/// One device on the line.
#[derive(Debug)]
pub(super) struct Unit {
    pub(super) device: DeviceId,
    pub(super) number: u8,
    pub(super) functions: Functions,
    pub(super) quirks: Quirks,
    pub(super) breaker: Backoff,
    pub(super) last_fault: Fault,
    /// Whether the unit has checks that must pass before it is used. The nodes of a server are identified by their namespaces.
    pub(super) is_checked: bool,
    /// A late answer of the unit may name the transaction of another question: a gateway to a serial line is in front of it.
    pub(super) is_behind_gateway: bool,
    /// When it last answered.
    pub(super) heard: Moment,
}

/// All of them. Several devices of a profile may be one unit.
pub(super) struct Units {
    all: Vec<Unit>,
    /// What the units still owe, by their numbers.
    pub(super) owed: Debts,
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
            is_checked: device.is_checked() || transport == Transport::OpcUa,
            is_behind_gateway: device.quirks.gateway.is_present(transport, numbers()),
            heard: Moment::default(),
        };
        let mut owed = Debts::of_units(numbers());
        if is_tcp {
            // A gateway has one question at a time on its line: an answer from before the start names no question of ours.
            owed.each().for_each(Owed::is_quiet);
        }
        Units { all: devices.iter().map(unit).collect(), owed }
    }

    /// The place of a device.
    pub(super) fn place(&self, device: DeviceId) -> Option<usize> {
        self.all.iter().position(|unit| unit.device == device)
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

    /// The devices with this unit number.
    pub(super) fn named(&self, number: u8) -> impl Iterator<Item = DeviceId> {
        self.all.iter().filter(move |unit| unit.number == number).map(|unit| unit.device)
    }

    pub(super) fn owed(&mut self, place: usize) -> &mut Owed {
        self.owed.of(self.all[place].number)
    }

    /// Returns whether the last question to the unit with this number was not answered in time.
    pub(super) fn has_timed_out(&self, number: u8) -> bool {
        let has_missed = self.owed.get(number).is_some_and(|owed| owed.missed() > 0);
        has_missed && self.all.iter().any(|unit| unit.number == number && unit.last_fault == Fault::Timeout)
    }

    /// This device, or each of them, need rest no longer.
    pub(super) fn revive(&mut self, device: Option<DeviceId>) {
        for unit in self.all.iter_mut().filter(|unit| device.is_none_or(|one| one == unit.device)) {
            unit.breaker.succeed();
        }
    }

    /// No answer, where a late one would not say what it answers: of a prompt unit it is lost, and it may be asked again;
    /// another is left alone until what it owes has had its time.
    pub(super) fn misses(
        &mut self,
        place: usize,
        (request, asked, missed): (Request<'_>, Moment, Moment),
        fault: Fault,
        now: Moment,
        spans: Spans,
    ) {
        let owed = self.owed(place);
        let is_lost = fault.is_of_a_gateway()
            || matches!(fault, Fault::Timeout | Fault::Peer(PeerFault::Malformed | PeerFault::Foreign));
        if !is_lost {
            owed.distrust();
        }
        let may_be_asked = owed.misses(request, asked, missed);
        self.all[place].last_fault = fault;
        if !may_be_asked {
            self.rest(place, fault, now, spans);
        }
    }

    /// A unit whose answer may still come, and would not say what it answers, is left alone for as long as that takes:
    /// by each of the devices that are this unit. Where that is longer than a miss or two are worth, for a pause that
    /// doubles.
    pub(super) fn rest(&mut self, place: usize, fault: Fault, now: Moment, spans: Spans) {
        let quiet = now.after((spans.timeout + spans.grace).max(spans.timeout + SHORTEST_REST));
        let number = self.all[place].number;
        let owed = self.owed.of(number);
        owed.anything();
        if !owed.has_answered() || !(1..=PATIENT).contains(&owed.missed()) {
            self.all[place].breaker.fail(now.after(spans.timeout));
        }
        for unit in self.all.iter_mut().filter(|unit| unit.number == number) {
            unit.breaker.not_before_either(quiet);
            unit.last_fault = fault;
        }
    }
}
