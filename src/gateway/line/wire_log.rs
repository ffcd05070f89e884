//! Wire log of a running gateway: recorded messages between the gateway and its devices. Each bus line has one tap
//! (recorder of messages). A caller finds a tap by the name of a device.

use std::sync::Arc;

use crate::fieldbus::trace::{ExchangeReceiver, Tap};
use isotherm_profile::{BusId, DeviceId, Profile};

/// Access to the messages between the gateway and its devices, from any thread.
#[derive(Clone, Debug)]
pub struct WireLog(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    taps: Vec<Tap>,
    devices: Vec<(String, BusId)>,
}

impl WireLog {
    pub(in crate::gateway) fn new(profile: &Profile) -> WireLog {
        let tap = Tap::default();
        let taps = profile.buses.iter().map(|_| tap.of_another_line()).collect();
        let devices = profile.devices.iter().map(|device| (device.name.clone(), device.bus)).collect();
        WireLog(Arc::new(Inner { taps, devices }))
    }

    pub(in crate::gateway) fn tap(&self, bus: BusId) -> &Tap {
        &self.0.taps[bus.0]
    }

    /// Records the messages of the device with this name until the returned value is dropped.
    ///
    /// # Errors
    /// No such device exists, or too many clients trace its bus line. The error is a sentence.
    pub fn listen(&self, device: &str) -> Result<ExchangeReceiver, String> {
        let Some(place) = self.0.devices.iter().position(|(name, _)| name == device) else {
            let known: Vec<&str> = self.0.devices.iter().map(|(name, _)| name.as_str()).collect();
            return Err(format!("there is no device `{device}`; there are: {}", known.join(", ")));
        };
        self.tap(self.0.devices[place].1).listen(Some(DeviceId(place)))
    }
}
