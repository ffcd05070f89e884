//! Whether the CAN interfaces of a profile are there and up, for who wants to know before anything begins.

use crate::fieldbus::can::Interface;
use crate::profile::{Bus, Profile, Transport};

/// The first CAN line that could not carry a frame now, and what to do about it.
pub fn unusable(profile: &Profile) -> Option<String> {
    profile.buses.iter().filter(|bus| bus.transport == Transport::Can).find_map(remedy)
}

fn remedy(bus: &Bus) -> Option<String> {
    let (bus, interface) = (&bus.name, &bus.address);
    match Interface::look(interface) {
        Ok(found) if found.is_up => None,
        Ok(_) => {
            Some(format!("bus {bus}: the interface {interface} is down. As root: ip link set {interface} up"))
        }
        Err(_) => Some(format!(
            "bus {bus}: there is no CAN interface {interface} on this computer. A virtual one, as root: \
             ip link add dev {interface} type vcan && ip link set {interface} up; where that is an \"Unknown device \
             type\", the kernel has no CAN, as in most containers. Another one: --set bus.{bus}.interface=NAME"
        )),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::profile;

    const TEXT: &str = "[machine]\nname = \"m\"\n[bus.field]\ntype = \"can\"\ninterface = \"none9\"\n";

    #[test]
    fn an_interface_that_is_not_there_is_named_with_how_to_make_it_and_how_to_take_another() {
        let profile = profile::parse(Path::new("m.toml"), TEXT, &[], &[]).unwrap_or_else(|e| panic!("{e}"));
        let said = unusable(&profile.profile).unwrap();
        for part in ["bus field", "ip link add dev none9 type vcan", "--set bus.field.interface="] {
            assert!(said.contains(part), "{said}");
        }
    }

    #[test]
    fn a_profile_without_can_needs_no_interface() {
        let text =
            TEXT.replace("\"can\"", "\"modbus-tcp\"").replace("interface = \"none9\"", "address = \"a:1\"");
        let profile = profile::parse(Path::new("m.toml"), &text, &[], &[]).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(unusable(&profile.profile), None);
    }
}
