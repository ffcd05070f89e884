//! What becomes of each request: counted, and told when something begins and when it ends.

use std::time::Duration;

use crate::fieldbus::error::Fault;
use crate::fieldbus::line::Witness;
use crate::fieldbus::wire::{CanRequest, Request};
use crate::gateway::shared::{Core, Shared};
use crate::observe::events::Event;
use isotherm_profile::DeviceId;

/// Consecutive failures after which people are told: a single lost answer is only counted.
const TOLD_AFTER: u64 = 2;

/// A device that was lost has returned when it has answered for this long: one that comes and goes is told once.
const BELIEVED_AFTER: Duration = Duration::from_secs(10);

impl Witness for Shared {
    fn note(
        &self,
        device: DeviceId,
        request: Request<'_>,
        outcome: Result<(), Fault>,
        refusals: (u32, Fault),
    ) {
        let mut core = self.core();
        let count = &mut core.devices[device.0];
        count.requests += 1;
        if let Err(fault) = outcome {
            *count.failures.entry(fault.blame()).or_default() += 1;
        }
        let has_answered = outcome.map_or_else(Fault::is_refusal, |()| true);
        // Nobody answers a frame: that it was sent says nothing of the device.
        let is_a_frame = matches!(request, Request::Can(CanRequest::Send { .. })) && outcome.is_ok();
        if is_a_frame || (has_answered && count.lost.is_none() && count.answered) {
            return;
        }
        let events = match outcome {
            Err(fault) if !has_answered => core.device_fails(self, device, fault, refusals),
            _ => core.device_answers(self, device),
        };
        drop(core);
        for event in events.into_iter().flatten() {
            self.tell(&event);
        }
    }
}

impl Core {
    pub(in crate::gateway) fn device_answers(&mut self, shared: &Shared, id: DeviceId) -> [Option<Event>; 2] {
        let device = shared.profile.device(id);
        let count = &mut self.devices[id.0];
        count.answered = true;
        let now = shared.clock.now();
        let returned = match &mut count.lost {
            Some(lost) if lost.told => now.since(*lost.answers_since.get_or_insert(now)) >= BELIEVED_AFTER,
            _ => true,
        };
        let lost = if returned { count.lost.take() } else { None };
        let bus = shared.profile.bus(device.bus);
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

    fn device_fails(
        &mut self,
        shared: &Shared,
        id: DeviceId,
        fault: Fault,
        (attempts, refused): (u32, Fault),
    ) -> [Option<Event>; 2] {
        let device = shared.profile.device(id);
        let lost = self.devices[id.0].lost.get_or_insert_default();
        lost.missed += 1;
        lost.answers_since = None;
        lost.fault = fault.to_string();
        // What comes after a connection was made is the device's doing.
        if fault.is_of_the_line() && attempts > 0 {
            let bus = shared.profile.bus(device.bus);
            let fault = refused;
            lost.fault = fault.to_string();
            let told = self.buses[device.bus.0].down.replace(u64::from(attempts)).is_some();
            let (bus, address) = (bus.name.clone(), bus.address.clone());
            return [(!told).then(|| Event::LinkDown { bus, address, fault: fault.to_string() }), None];
        }
        let tell = lost.missed >= TOLD_AFTER && !lost.told;
        lost.told |= tell;
        if tell {
            // What comes back may be another one, or one that has forgotten how it was set.
            self.commissioning.forget(shared, id);
        }
        let (device, at) = (device.name.clone(), device.at());
        [tell.then(|| Event::DeviceLost { device, at, fault: fault.to_string() }), None]
    }
}
