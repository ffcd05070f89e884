//! Who answers: counted by device and line, and told when it ends and when it begins again.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::fieldbus::error::Fault;
use crate::observe::events::Event;
use isotherm_core::quantity::Moment;
use isotherm_profile::{DeviceId, Profile};

/// Consecutive failures after which people are told: a single lost answer is only counted.
const TOLD_AFTER: u64 = 2;

/// A device that was lost has returned when it has answered for this long: one that comes and goes is told once.
const BELIEVED_AFTER: Duration = Duration::from_secs(10);

/// What was late is told again after so long without.
const TOLD_AGAIN: Duration = Duration::from_secs(600);

/// Every device and every line.
#[derive(Clone, Debug)]
pub(super) struct Contact {
    pub(super) devices: Vec<DeviceCount>,
    pub(super) buses: Vec<BusCount>,
}

/// Requests and failures of one device.
#[derive(Clone, Debug, Default)]
pub(super) struct DeviceCount {
    pub(super) requests: u64,
    pub(super) failures: BTreeMap<&'static str, u64>,
    pub(super) answered: bool,
    pub(super) lost: Option<Lost>,
}

/// A device that does not answer.
#[derive(Clone, Debug, Default)]
pub(super) struct Lost {
    pub(super) fault: String,
    /// Requests that failed since.
    pub(super) missed: u64,
    pub(super) told: bool,
    /// It answers again, since then.
    pub(super) answers_since: Option<Moment>,
}

/// Cycles of one line.
#[derive(Clone, Debug, Default)]
pub(super) struct BusCount {
    pub(super) connected: bool,
    /// Attempts to connect since it went down.
    pub(super) down: Option<u64>,
    pub(super) cycles: u64,
    pub(super) overruns: u64,
    /// The last of them.
    pub(super) overrun_at: Option<Moment>,
    pub(super) jitter: [u64; JITTER_MS.len() + 1],
}

/// Upper bounds of the jitter histogram, ms.
pub(super) const JITTER_MS: [f64; 7] = [0.5, 1.0, 2.0, 5.0, 10.0, 50.0, 200.0];

impl BusCount {
    /// So many more times something was late. Whether that is to be told.
    pub(super) fn overrun(&mut self, count: u64, now: Moment) -> bool {
        if count == 0 {
            return false;
        }
        self.overruns += count;
        let before = self.overrun_at.replace(now);
        before.is_none_or(|before| now.since(before) >= TOLD_AGAIN)
    }
}

impl Contact {
    pub(super) fn new(profile: &Profile) -> Contact {
        Contact {
            devices: vec![DeviceCount::default(); profile.devices.len()],
            buses: vec![BusCount::default(); profile.buses.len()],
        }
    }

    /// A device has answered; what is to be told of that.
    pub(super) fn answers(&mut self, profile: &Profile, id: DeviceId, now: Moment) -> [Option<Event>; 2] {
        let device = profile.device(id);
        let count = &mut self.devices[id.0];
        count.answered = true;
        let returned = match &mut count.lost {
            Some(lost) if lost.told => now.since(*lost.answers_since.get_or_insert(now)) >= BELIEVED_AFTER,
            _ => true,
        };
        let lost = if returned { count.lost.take() } else { None };
        let bus = profile.bus(device.bus);
        let up = self.buses[device.bus.0].down.take().map(|attempts| Event::LinkUp {
            bus: bus.name.clone(),
            address: bus.address.clone(),
            attempts,
        });
        let back = lost.filter(|lost| lost.told).map(|lost| Event::DeviceBack {
            device: device.name.clone(),
            at: device.at(),
            missed: lost.missed,
        });
        [up, back]
    }

    /// A request to a device failed, after so many attempts to connect that came to this; what is to be told of that.
    /// With it the device counts as lost: what comes back may be another one, or one that has forgotten how it was set.
    pub(super) fn fails(
        &mut self,
        profile: &Profile,
        id: DeviceId,
        fault: Fault,
        (attempts, refused): (u32, Fault),
    ) -> (Option<Event>, bool) {
        let device = profile.device(id);
        let lost = self.devices[id.0].lost.get_or_insert_default();
        lost.missed += 1;
        lost.answers_since = None;
        lost.fault = fault.to_string();
        // What comes after a connection was made is the device's doing.
        if fault.is_of_the_line() && attempts > 0 {
            let bus = profile.bus(device.bus);
            let fault = refused;
            lost.fault = fault.to_string();
            let told = self.buses[device.bus.0].down.replace(u64::from(attempts)).is_some();
            let (bus, address) = (bus.name.clone(), bus.address.clone());
            return ((!told).then(|| Event::LinkDown { bus, address, fault: fault.to_string() }), false);
        }
        let tell = lost.missed >= TOLD_AFTER && !lost.told;
        lost.told |= tell;
        let (device, at) = (device.name.clone(), device.at());
        (tell.then(|| Event::DeviceLost { device, at, fault: fault.to_string() }), tell)
    }

    /// A frame of a device came.
    pub(super) fn heard(&mut self, profile: &Profile, id: DeviceId, now: Moment) -> [Option<Event>; 2] {
        let count = &self.devices[id.0];
        if count.answered && count.lost.is_none() { [None, None] } else { self.answers(profile, id, now) }
    }

    /// Nothing comes of a device any more; told once, but for a bus that is down, which has been. Where it is told, the device
    /// is to be looked at anew when it comes back.
    pub(super) fn is_silent(&mut self, profile: &Profile, id: DeviceId, fault: String) -> Option<Event> {
        let device = profile.device(id);
        let is_down = self.buses[device.bus.0].down.is_some();
        let lost = self.devices[id.0].lost.get_or_insert_default();
        lost.missed += 1;
        lost.answers_since = None;
        lost.fault = fault.clone();
        if is_down || std::mem::replace(&mut lost.told, true) {
            return None;
        }
        Some(Event::DeviceLost { device: device.name.clone(), at: device.at(), fault })
    }
}
