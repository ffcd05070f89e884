//! Whether the devices are set as the profile expects them: read before anything is armed, again after a device was
//! lost, and again and again where something was wrong, until somebody has put it right. A CANopen node that has a setup
//! list is set up first.
//!
//! A module that sends hexadecimal counts of its range instead of tenths of a degree sends plausible temperatures.
//! So nothing is believed of a device whose checks have not all been read and found right.

use std::sync::Arc;

use isotherm_core::compensation::model::Model;
use isotherm_core::reading::SignalId;
use isotherm_profile::{AxisId, Device, DeviceId, Profile};

/// What has been found of each device, and which devices an axis depends on.
#[derive(Clone, Debug)]
pub(super) struct Commissioning {
    profile: Arc<Profile>,
    devices: Vec<Finding>,
    /// By device: how often everything had to begin anew.
    rounds: Vec<u64>,
    of_axis: Vec<Vec<DeviceId>>,
}

/// Of one device, or of all that an axis depends on.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Finding {
    /// Nothing is to be checked, or everything was found right.
    Fit,
    /// Not all has been read yet.
    Unknown,
    /// What is wrong, as a sentence.
    Wrong(String),
}

impl Commissioning {
    pub(super) fn new(profile: &Arc<Profile>) -> Commissioning {
        let devices = profile.devices.iter().map(Finding::begin);
        let of_axis = (0..profile.axes.len()).map(|axis| devices_of(profile, AxisId(axis)));
        let rounds = vec![0; profile.devices.len()];
        let profile = profile.clone();
        Commissioning { devices: devices.collect(), rounds, of_axis: of_axis.collect(), profile }
    }

    /// Whether what is read from it may be believed.
    pub(super) fn is_fit(&self, device: DeviceId) -> bool {
        self.devices[device.0] == Finding::Fit
    }

    /// It has not been looked at to the end yet.
    pub(super) fn is_unknown(&self, device: DeviceId) -> bool {
        self.devices[device.0] == Finding::Unknown
    }

    pub(super) fn wrong(&self, device: DeviceId) -> Option<&str> {
        match &self.devices[device.0] {
            Finding::Wrong(why) => Some(why),
            Finding::Fit | Finding::Unknown => None,
        }
    }

    /// Of the devices that an axis depends on: the first that is wrong, else one that is not known.
    pub(super) fn of_axis(&self, axis: usize) -> &Finding {
        let findings = || self.of_axis[axis].iter().map(|device| &self.devices[device.0]);
        let wrong = findings().find(|finding| matches!(finding, Finding::Wrong(_)));
        wrong.or_else(|| findings().find(|finding| **finding == Finding::Unknown)).unwrap_or(&Finding::Fit)
    }

    /// Forgets what was found: the device may have been exchanged or restarted, so it is set up and checked again.
    pub(super) fn forget(&mut self, device: DeviceId) {
        self.rounds[device.0] += 1;
        if self.is_fit(device) {
            self.devices[device.0] = Finding::begin(self.profile.device(device));
        }
    }

    /// How often everything about a device had to begin anew.
    pub(super) fn round(&self, device: DeviceId) -> u64 {
        self.rounds[device.0]
    }

    /// A device was looked at; what had been found before.
    pub(super) fn note(&mut self, device: DeviceId, found: Finding) -> Finding {
        std::mem::replace(&mut self.devices[device.0], found)
    }
}

impl Finding {
    fn begin(device: &Device) -> Finding {
        if device.is_checked() { Finding::Unknown } else { Finding::Fit }
    }
}

/// The devices that any model of the axis reads, and those that its outputs write to.
fn devices_of(profile: &Profile, axis: AxisId) -> Vec<DeviceId> {
    let inputs = profile.axis(axis).settings.models.iter().flat_map(Model::signals);
    let device = |id: SignalId| profile.signal(id).device;
    let written = profile.outputs.iter().filter(|output| output.axis == axis).map(|output| output.device);
    let mut devices: Vec<DeviceId> = inputs.map(device).chain(written).collect();
    devices.sort_unstable();
    devices.dedup();
    devices
}
