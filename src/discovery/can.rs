//! A CAN interface as it is now, and what would help it, with the commands for it.

use serde::Serialize;

use crate::fieldbus::can::Interface;
use crate::fieldbus::error::{CanFault, Fault, LinkFault};
use isotherm_core::codec::{Address, Frame};
use isotherm_profile::{Bus, Profile, Signal};

/// What was found of an interface.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Looked {
    /// Its bus in the profile.
    pub bus: String,
    /// Its name.
    pub interface: String,
    /// It is there and carries frames.
    pub is_up: bool,
    /// How it is, in words.
    pub state: String,
    /// What would help, each with its command; empty where nothing is wrong.
    pub advice: Vec<String>,
}

/// Looks at the interface of each CAN line of a profile. Asks the kernel, sends nothing.
pub fn look(profile: &Profile) -> Vec<Looked> {
    let lines = profile.buses.iter().filter(|bus| bus.transport.is_can());
    lines.map(|bus| looked(bus, wants_fd(profile, bus), Interface::look(&bus.address))).collect()
}

fn wants_fd(profile: &Profile, bus: &Bus) -> bool {
    let here = profile.devices.iter().filter(|device| profile.bus(device.bus).name == bus.name);
    let is_written =
        here.filter_map(|device| device.can.as_ref()).flat_map(|can| &can.written).any(Frame::is_fd);
    let is_here = |signal: &&Signal| profile.bus(profile.device(signal.device).bus).name == bus.name;
    let is_fd = |signal: &Signal| matches!(&signal.address, Address::Frame(field) if field.is_fd);
    is_written || profile.signals.iter().filter(is_here).any(is_fd)
}

fn looked(bus: &Bus, wants_fd: bool, found: Result<Interface, CanFault>) -> Looked {
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
                    "restart-ms is 0: a controller that takes itself off the bus stays off it until somebody notices. As \
                     root: `ip link set dev {name} down`, `ip link set dev {name} type can restart-ms 100`, \
                     `ip link set dev {name} up`"
                ));
            }
            if wants_fd && !found.does_fd {
                let kind = if is_virtual {
                    String::new()
                } else {
                    format!("`ip link set dev {name} type can fd on`, ")
                };
                advice.push(format!(
                    "the profile has CAN FD frames, and this interface carries none. As root: `ip link set dev {name} \
                     down`, {kind}`ip link set dev {name} mtu 72`, `ip link set dev {name} up`"
                ));
            }
            found.to_string()
        }
    };
    Looked { bus: bus.name.clone(), interface: name.clone(), is_up, state, advice }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::discovery::bus::{Place, Transport};

    fn found(name: &str, wants_fd: bool, found: Result<Interface, CanFault>) -> Looked {
        let place = Place { transport: Transport::Can, address: name.to_owned() };
        looked(&place.bus(Duration::from_secs(1)), wants_fd, found)
    }

    const WELL: Interface = Interface {
        is_up: true,
        does_fd: false,
        bitrate: Some(250_000),
        restart_ms: Some(100),
        state: Some("well"),
        errors: Some((0, 0)),
    };

    #[test]
    fn each_trouble_of_an_interface_has_its_command() {
        let vcan =
            Interface { bitrate: None, restart_ms: None, state: None, errors: None, does_fd: true, ..WELL };
        for (name, wants_fd, given, state, advice) in [
            (
                "can0",
                false,
                Ok(WELL),
                "up, 250000 bit/s, restart 100 ms after bus-off, controller well",
                None,
            ),
            ("vcan0", true, Ok(vcan.clone()), "up, CAN FD", None),
            ("can0", false, Err(CanFault::NoInterface), "no such interface", Some("type can bitrate")),
            (
                "vcan0",
                false,
                Err(CanFault::NoInterface),
                "no such",
                Some("`ip link add dev vcan0 type vcan`"),
            ),
            (
                "vcan0",
                false,
                Ok(Interface { is_up: false, ..vcan }),
                "down",
                Some("`ip link set dev vcan0 up`"),
            ),
            (
                "can0",
                false,
                Ok(Interface { is_up: false, bitrate: None, ..WELL }),
                "down",
                Some("bitrate 250000` with the bitrate of the bus, then `ip link set dev can0 up`"),
            ),
            (
                "can0",
                false,
                Ok(Interface { restart_ms: Some(0), errors: Some((130, 2)), ..WELL }),
                "no restart after bus-off, controller well, errors 130 sending and 2 receiving",
                Some("type can restart-ms 100`"),
            ),
            ("can0", true, Ok(WELL), "up", Some("type can fd on`, `ip link set dev can0 mtu 72`")),
        ] {
            let looked = found(name, wants_fd, given);
            assert!(looked.state.contains(state), "{looked:?}");
            assert_eq!(looked.advice.len(), usize::from(advice.is_some()), "{looked:?}");
            assert!(advice.is_none_or(|part| looked.advice[0].contains(part)), "{looked:?}");
        }
    }
}
