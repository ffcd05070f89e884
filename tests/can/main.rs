//! CAN on a real kernel: `tests/vcan/run` builds these tests and runs them where there is a virtual interface.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::process::Command;
use std::time::Duration;

use socketcan::{CanSocket, EmbeddedFrame, Frame, Socket};

/// The interface that the tests run on, made by `tests/vcan/run`.
fn interface() -> String {
    std::env::var("ISOTHERM_VCAN").unwrap_or_else(|_| {
        panic!(
            "these tests need a CAN interface of their own: `tests/vcan/run` makes one and runs them on it"
        )
    })
}

/// Runs a program of can-utils to its end.
fn can_utils(program: &str, arguments: &[&str]) {
    let ended = Command::new(program).args(arguments).output();
    let ended = ended.unwrap_or_else(|error| panic!("{program}: {error}: apt-get install can-utils"));
    assert!(ended.status.success(), "{program} {arguments:?}: {}", String::from_utf8_lossy(&ended.stderr));
}

#[test]
fn a_frame_from_cansend_arrives_at_a_raw_socket_on_the_same_interface() {
    let interface = interface();
    let socket = CanSocket::open(&interface).unwrap();
    socket.set_read_timeout(Duration::from_secs(5)).unwrap();
    can_utils("cansend", &[&interface, "18FF1220#1122334455667788"]);
    let frame = socket.read_frame().unwrap();
    assert!(frame.is_extended());
    assert_eq!(frame.raw_id(), 0x18FF_1220);
    assert_eq!(frame.data(), [0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88]);
}
