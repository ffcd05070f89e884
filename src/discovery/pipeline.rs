//! Test whether a device supports two requests at a time. The test sends the device two reads at once.

use serde::Serialize;

use crate::clock::Clock;
use crate::fieldbus::dial;
use crate::fieldbus::error::Fault;
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::Request;
use isotherm_profile::{Bus, BusId, Device, DeviceId, Profile};

/// Number of pairs of requests that each device gets. One pair is not enough: a device that mixes up two answers may be
/// right by chance.
const PAIRS: usize = 20;

/// Result of the test of one device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PipelineTest {
    /// Name of the bus in the profile.
    pub bus: String,
    /// Name of the device in the profile.
    pub device: String,
    /// Description of the failure; `None` if the device supports two requests at a time, or if even a
    /// single request fails.
    pub fault: Option<String>,
}

/// Tests the devices on each bus with `pipeline = 2`. The test only reads from the devices.
pub async fn tried(profile: &Profile) -> Vec<PipelineTest> {
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
            found.push(PipelineTest {
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
    // Send a single request first. Its fault is reported elsewhere, and has nothing to do with the pipeline.
    if line.request(device.0, request, SendDeadline::None).await.is_err() {
        return Ok(());
    }
    for _ in 0..PAIRS {
        line.set_follow_up(Some((device.0, request)));
        line.request(device.0, request, SendDeadline::None).await?;
        line.request(device.0, request, SendDeadline::None).await?;
    }
    Ok(())
}
