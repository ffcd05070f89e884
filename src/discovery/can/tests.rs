use std::time::Duration;

use super::*;
use crate::discovery::bus::LineAddress;
use isotherm_profile::Transport;

fn found(name: &str, requires_fd: bool, found: Result<Interface, CanFault>) -> Inspected {
    let place = LineAddress { transport: Transport::Can, address: name.to_owned() };
    inspected(&place.bus(Duration::from_secs(1)), requires_fd, found)
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
    for (name, requires_fd, given, state, advice) in [
        ("can0", false, Ok(WELL), "up, 250000 bit/s, restart 100 ms after bus-off, controller well", None),
        ("vcan0", true, Ok(vcan.clone()), "up, CAN FD", None),
        ("can0", false, Err(CanFault::NoInterface), "no such interface", Some("type can bitrate")),
        ("vcan0", false, Err(CanFault::NoInterface), "no such", Some("`ip link add dev vcan0 type vcan`")),
        ("vcan0", false, Ok(Interface { is_up: false, ..vcan }), "down", Some("`ip link set dev vcan0 up`")),
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
            "no restart after bus-off, controller well, error counters 130 (sending) and 2 (receiving)",
            Some("type can restart-ms 100`"),
        ),
        ("can0", true, Ok(WELL), "up", Some("type can fd on`, `ip link set dev can0 mtu 72`")),
    ] {
        let inspected = found(name, requires_fd, given);
        assert!(inspected.state.contains(state), "{inspected:?}");
        assert_eq!(inspected.advice.len(), usize::from(advice.is_some()), "{inspected:?}");
        assert!(advice.is_none_or(|part| inspected.advice[0].contains(part)), "{inspected:?}");
    }
}
