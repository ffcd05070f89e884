//! One request to a device, with all that is counted and told of it.

use std::time::Duration;

use crate::codec::{Address, Table};
use crate::fieldbus::error::{CallerFault, Fault};
use crate::fieldbus::line::Line;
use crate::fieldbus::wire::{Answer, CanRequest, Request};
use crate::gateway::shared::{Core, Shared};
use crate::observe::events::Event;
use crate::profile::DeviceId;
use crate::quantity::Moment;

/// Consecutive failures after which people are told: a single lost answer is only counted.
const TOLD_AFTER: u64 = 2;

/// A device that was lost has returned when it has answered for this long: one that comes and goes is told once.
const BELIEVED_AFTER: Duration = Duration::from_secs(10);

/// Asks a device; counts, and tells what begins and what ends. `now` is the moment at which nothing on the line is under
/// way any more: pauses after a failure begin there.
pub(in crate::gateway) async fn call(
    line: &mut Line,
    shared: &Shared,
    device: DeviceId,
    request: Request<'_>,
    now: Moment,
) -> Result<Answer, Fault> {
    let request = addressed(shared, device, request)?;
    let rested = line.is_resting(device, now);
    let answer = line.call(device, request, now).await;
    // Nobody answers a frame: that it was sent says nothing of the device.
    let sends_only = matches!(request, Request::Can(CanRequest::Send { .. }));
    let mut core = shared.core();
    let count = &mut core.devices[device.0];
    if !rested {
        count.requests += 1;
        if let Err(fault) = &answer {
            *count.failures.entry(fault.blame()).or_default() += 1;
        }
    }
    let events = match &answer {
        Ok(_) if sends_only => return answer,
        Ok(_) | Err(Fault::Exception(_) | Fault::Aborted(_)) if count.lost.is_none() && count.answered => {
            return answer;
        }
        Ok(_) | Err(Fault::Exception(_) | Fault::Aborted(_)) => core.device_answers(shared, device),
        // It never left the house.
        Err(Fault::Caller(_)) => return answer,
        Err(fault) if !rested => core.device_fails(shared, device, *fault, line),
        Err(_) => return answer,
    };
    drop(core);
    for event in events.into_iter().flatten() {
        shared.tell(&event);
    }
    answer
}

/// A request by the place in one of a CAN device's lists, as it goes over the line.
fn addressed<'a>(shared: &Shared, device: DeviceId, request: Request<'a>) -> Result<Request<'a>, Fault> {
    match request {
        Request::Read { from: Address { table: Table::Object, offset }, .. } => {
            let object = shared.profile.device(device).can.as_ref().and_then(|can| can.object(offset));
            let object = object.ok_or(Fault::Caller(CallerFault::Extent))?;
            Ok(Request::Can(CanRequest::Read { object: *object }))
        }
        request => Ok(request),
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
        line: &Line,
    ) -> [Option<Event>; 2] {
        let device = shared.profile.device(id);
        let lost = self.devices[id.0].lost.get_or_insert_default();
        lost.missed += 1;
        lost.answers_since = None;
        lost.fault = fault.to_string();
        // What comes after a connection was made is the device's doing.
        if fault.is_of_the_line() && line.refusals().0 > 0 {
            let bus = shared.profile.bus(device.bus);
            let (attempts, fault) = line.refusals();
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
