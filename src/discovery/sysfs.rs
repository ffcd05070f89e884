//! Temperature sensors of this computer, and sensors of a profile that this computer does not have.

use std::path::Path;

use serde::Serialize;

use crate::fieldbus::kinds::sysfs::find::{PresentSensor, all, find};
use isotherm_core::codec::PcSensor;
use isotherm_core::reading::Reason;
use isotherm_profile::{Profile, Transport};

/// Maximum number of sensor names in the advice on a missing sensor.
const MOST: usize = 20;

/// Temperature sensor of this computer that a profile names.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Inspected {
    /// Name of the bus in the profile.
    pub bus: String,
    /// Use of the sensor in the profile: `signal bed`.
    pub of: String,
    /// Name of the sensor in the profile.
    pub sensor: String,
    /// Path of the file that contains the temperature; `None` if the computer does not have the sensor.
    pub read_in: Option<String>,
    /// Description of the problem, with the names of sensors that exist; `None` if the sensor was found.
    pub advice: Option<String>,
}

/// Looks up the files of each sensor of a profile. The function reads no temperature.
pub fn inspect(profile: &Profile) -> Vec<Inspected> {
    let mut inspected = Vec::new();
    for signal in &profile.signals {
        let bus = profile.bus(profile.device(signal.device).bus);
        let Some(sensor) = signal.address.sensor().filter(|_| bus.transport == Transport::Sysfs) else {
            continue;
        };
        let root = Path::new(&bus.address);
        let found = find(root, sensor);
        inspected.push(Inspected {
            bus: bus.name.clone(),
            of: format!("signal {}", signal.name),
            sensor: sensor.to_string(),
            read_in: found.as_ref().ok().map(ToString::to_string),
            advice: found.err().map(|reason| advice(root, sensor, reason)),
        });
    }
    inspected
}

fn advice(root: &Path, sensor: &PcSensor, reason: Reason) -> String {
    let present = all(root);
    let called = |of: &dyn Fn(&PresentSensor) -> bool| {
        let names = present.iter().filter(|present| of(present)).map(|present| present.sensor.to_string());
        let mut names: Vec<String> = names.collect();
        if names.len() > MOST {
            names.truncate(MOST);
            names.push("…".to_owned());
        }
        names.join(", ")
    };
    if reason == Reason::SeveralFound {
        return format!("{reason}: write one of {}", called(&|present| present.is(sensor)));
    }
    let (kind, driver) = match sensor {
        PcSensor::OneWire(_) => {
            ("w1:", "is the sensor plugged in, is the 1-Wire adapter's driver loaded (`lsmod | grep w1`)")
        }
        PcSensor::Hwmon(_) => {
            ("hwmon:", "is the chip's driver loaded (`sensors-detect` finds the necessary driver)")
        }
        PcSensor::Iio(_) => (
            "iio:",
            "is the chip's driver loaded, is the chip in the device tree (`ls /sys/bus/iio/devices`)",
        ),
    };
    let others = called(&|present| present.sensor.to_string().starts_with(kind));
    match (others.is_empty(), present.is_empty()) {
        (false, _) => format!("{reason}; present sensors of this kind: {others}"),
        (true, false) => {
            format!(
                "{reason}, and this computer has no other sensor of this kind: {driver}? Present sensors: {}",
                called(&|_| true)
            )
        }
        (true, true) => format!("{reason}, and no sensor was found in {}: {driver}?", root.display()),
    }
}
