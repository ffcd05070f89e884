//! State of the CAN interfaces of a profile, and advice with the commands that correct a wrong state.

use serde::Serialize;

use crate::fieldbus::error::{CanFault, Fault, LinkFault};
use crate::fieldbus::kinds::can::Interface;
use isotherm_core::codec::{Address, Frame};
use isotherm_profile::{Bus, Profile, Signal};

/// State of the CAN interface of one bus in the profile.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Inspected {
    /// Name of the bus in the profile.
    pub bus: String,
    /// Name of the CAN interface of this computer, for example `can0`.
    pub interface: String,
    /// Whether the CAN interface exists and is up.
    pub is_up: bool,
    /// State of the CAN interface as text for the user.
    pub state: String,
    /// Advice to the user, each with a command; empty if nothing is wrong.
    pub advice: Vec<String>,
}

/// Inspects the interface of each CAN line of a profile. The function queries the kernel, and sends no frame on the
/// bus.
pub fn inspect(profile: &Profile) -> Vec<Inspected> {
    let lines = profile.buses.iter().filter(|bus| bus.transport.is_can());
    lines.map(|bus| inspected(bus, requires_fd(profile, bus), Interface::query(&bus.address))).collect()
}

fn requires_fd(profile: &Profile, bus: &Bus) -> bool {
    let here = profile.devices.iter().filter(|device| profile.bus(device.bus).name == bus.name);
    let is_written =
        here.filter_map(|device| device.can.as_ref()).flat_map(|can| &can.written).any(Frame::is_fd);
    let is_here = |signal: &&Signal| profile.bus(profile.device(signal.device).bus).name == bus.name;
    let is_fd = |signal: &Signal| matches!(&signal.address, Address::Frame(field) if field.is_fd);
    is_written || profile.signals.iter().filter(is_here).any(is_fd)
}

fn inspected(bus: &Bus, requires_fd: bool, found: Result<Interface, CanFault>) -> Inspected {
    let name = &bus.address;
    let is_virtual = name.starts_with("vcan");
    let mut advice = Vec::new();
    let is_up = found.as_ref().is_ok_and(|found| found.is_up);
    let state = match found {
        Err(fault) => {
            advice.push(if is_virtual {
                format!("as root: `ip link add dev {name} type vcan`, then `ip link set dev {name} up`")
            } else {
                format!(
                    "is the adapter plugged in, and is this its name? (`ip -details link show type can`) Then, as root: \
                     `ip link set dev {name} type can bitrate 250000 restart-ms 100` with the bitrate of the bus, and \
                     `ip link set dev {name} up`"
                )
            });
            Fault::Link(LinkFault::Can(fault)).to_string()
        }
        Ok(found) => {
            if !found.is_up {
                let has_rate = is_virtual || found.bitrate.is_some();
                let rate = format!(
                    "`ip link set dev {name} type can bitrate 250000` with the bitrate of the bus, then "
                );
                let rate = if has_rate { String::new() } else { rate };
                advice.push(format!("as root: {rate}`ip link set dev {name} up`"));
            }
            if found.stays_off() {
                advice.push(format!(
                    "restart-ms is 0: a controller that goes bus-off stays off until the interface is \
                     restarted. As root: `ip link set dev {name} down`, `ip link set dev {name} type can \
                     restart-ms 100`, `ip link set dev {name} up`"
                ));
            }
            if requires_fd && !found.does_fd {
                let kind = if is_virtual {
                    String::new()
                } else {
                    format!("`ip link set dev {name} type can fd on`, ")
                };
                advice.push(format!(
                    "the profile has CAN FD frames, but CAN FD is not switched on at this interface. As \
                     root: `ip link set dev {name} down`, {kind}`ip link set dev {name} mtu 72`, `ip link \
                     set dev {name} up`"
                ));
            }
            found.to_string()
        }
    };
    Inspected { bus: bus.name.clone(), interface: name.clone(), is_up, state, advice }
}

#[cfg(test)]
mod tests;
