//! Whether a device bears two questions at a time: tried with two reads in one go.

use serde::Serialize;

use crate::clock::Clock;
use crate::fieldbus::departure::Leave;
use crate::fieldbus::dial;
use crate::fieldbus::error::Fault;
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::Request;
use isotherm_profile::{Bus, BusId, Device, DeviceId, Profile};

/// Pairs that a device is asked: one that mixes them up may be right by chance.
const PAIRS: usize = 20;

/// What came of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Tried {
    /// The bus in the profile.
    pub bus: String,
    /// The device that was asked.
    pub device: String,
    /// Why it does not do; `None`: it does.
    pub fault: Option<String>,
}

/// Asks each device on a bus with `pipeline = 2`. Reads only.
pub async fn tried(profile: &Profile) -> Vec<Tried> {
    let mut found = Vec::new();
    let pipelined = profile.buses.iter().enumerate().filter(|(_, bus)| bus.pipeline > 1);
    for (place, bus) in pipelined {
        for (id, device) in profile.devices_on(BusId(place)) {
            let Some(request) =
                profile.requests(id).first().and_then(|request| Request::in_registers(&request.asks))
            else {
                continue;
            };
            let fault = in_pairs(bus, (id, device), request).await.err();
            found.push(Tried {
                bus: bus.name.clone(),
                device: device.name.clone(),
                fault: fault.map(|fault| fault.to_string()),
            });
        }
    }
    found
}

async fn in_pairs(bus: &Bus, device: (DeviceId, &Device), request: Request<'static>) -> Result<(), Fault> {
    let Some(dial) = dial(bus) else { return Ok(()) };
    let mut line = DeviceLine::new(bus, &[device], dial, &Clock::wall());
    // One alone first: what is wrong with that is told elsewhere, and has nothing to do with the second one.
    if line.request(device.0, request, Leave::Whenever).await.is_err() {
        return Ok(());
    }
    for _ in 0..PAIRS {
        line.ask_behind(Some((device.0, request)));
        line.request(device.0, request, Leave::Whenever).await?;
        line.request(device.0, request, Leave::Whenever).await?;
    }
    Ok(())
}
