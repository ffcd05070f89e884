//! Keys for sensors of this computer: name, unit and timing.

use std::time::Duration;

use super::bus::Transport;
use super::{Check, KeyContext};
use crate::duration::shown;
use isotherm_core::codec::PcSensor;

/// Default directory of the kernel's sensors.
pub(super) const ROOT: &str = "/sys";
/// Default timeout for all sensors of a device. A 1-Wire sensor needs most of a second.
pub(super) const TIMEOUT: Duration = Duration::from_secs(2);
/// Time for reading a 1-Wire sensor. It measures for 750 ms at 12 bits (DS18B20), with a request before and a read
/// after it.
const ONE_WIRE: Duration = Duration::from_secs(1);
/// Reason why nothing is written to a sysfs line.
pub(super) const ONLY_READ: &str =
    "sensors of this computer are only read: nothing is written to a sysfs line";

/// Checks the directory of a sysfs line.
pub(super) fn root(at: &KeyContext<'_>, address: Option<&String>) -> Option<String> {
    let Some(address) = address else { return Some(ROOT.to_owned()) };
    if !address.starts_with('/') {
        let help = "remove this key (default \"/sys\"); in a container, write the directory where the host's \
                    /sys is mounted: \"/host/sys\"";
        return at.key("address").reject(format!("`{address}` is no absolute path of a directory"), help);
    }
    if let Some(inside) = ["/class", "/bus/"].iter().find_map(|inside| address.find(inside)) {
        let above = &address[..inside];
        let help = format!("write the directory above: \"{above}\"; the sensor is named at its signal");
        let message = format!("`{address}` is a directory inside of the kernel's directory");
        return at.key("address").reject(message, help);
    }
    Some(address.clone())
}

/// Parses the sensor at this key of a signal.
pub(super) fn sensor(signal: &KeyContext<'_>, text: Option<&String>) -> Option<PcSensor> {
    let at = signal.key("sensor");
    let Some(text) = text else {
        let is_elsewhere =
            ["register", "node", "dbc", "pdo", "sdo", "frame"].iter().any(|key| signal.has(key));
        if !is_elsewhere {
            let help = "write \"w1:28-0316a2794f01\", \"hwmon:NAME/LABEL\" or \"iio:NAME/LABEL\"; `isotherm scan --bus /sys` lists \
                        what this computer has";
            at.missing("`sensor` is missing: which sensor is read?", help);
        }
        return None;
    };
    let report = |why: String| {
        let (message, help) = why.split_once("; ").unwrap_or((&why, "write it as `isotherm scan` does"));
        at.invalid(message, format!("{help}; `isotherm scan --bus /sys` lists what this computer has"));
    };
    text.parse().map_err(report).ok()
}

/// Reports a unit other than °C, because the kernel returns all temperatures in °C.
pub(super) fn unit(at: &KeyContext<'_>, unit: Option<&str>) {
    if let Some(unit) = unit.filter(|unit| *unit != "degC") {
        at.invalid(format!("a sensor of this computer is read in °C, not in \"{unit}\""), "leave `unit` out");
    }
}

/// Warns about 1-Wire sensors whose timeout or period is too short for a measurement.
pub(super) fn too_quick(check: &Check<'_>) {
    for signal in check.signals.valid() {
        let Some(PcSensor::OneWire(id)) = signal.address.sensor() else { continue };
        let Some(device) = check.devices.get(signal.device.0) else { continue };
        let Some(bus) = check.bus_of(device).filter(|bus| bus.transport == Transport::Sysfs) else {
            continue;
        };
        let takes = format!("{id} measures for up to 750 ms (12 bits)");
        let at = check.at("bus").key(&bus.name).key("timeout");
        if bus.timeout < ONE_WIRE && at.is_written() {
            let message = format!("{takes}, but `timeout` is {}", shown(bus.timeout));
            at.warn(message, "write \"2s\", or remove the key");
        } else if device.every < ONE_WIRE {
            let message = format!("{takes}, but is read every {}", shown(device.every));
            let help = "write every = \"1s\" or longer at this device. Give faster sensors another device \
                        in the profile";
            check.at("device").key(&device.name).key("every").warn(message, help);
        } else {
            continue;
        }
        return;
    }
}
