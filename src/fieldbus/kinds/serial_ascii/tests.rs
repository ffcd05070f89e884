use super::*;
use isotherm_profile::{Parity, Serial};

#[test]
fn an_address_has_the_settings_of_its_port() {
    let serial = |baud, parity, stop_bits| Serial { baud, parity, stop_bits };
    for (text, expected) in [
        (
            "ascii:///dev/ttyUSB0?baud=4800&data_bits=7&parity=even&stop_bits=2",
            (Transport::Ascii { serial: serial(4800, Parity::Even, 2), data_bits: 7 }, "/dev/ttyUSB0"),
        ),
        (
            "ascii:///dev/ttyUSB0",
            (Transport::Ascii { serial: serial(9600, Parity::None, 1), data_bits: 8 }, "/dev/ttyUSB0"),
        ),
    ] {
        let found = (SERIAL.parse)(text).unwrap();
        let (transport, address) = expected;
        assert_eq!(found, Ok((transport, address.to_owned())), "{text}");
    }
    let found = (OVER_TCP.parse)("ascii+tcp://server:4001").unwrap();
    assert_eq!(found, Ok((Transport::AsciiOverTcp, "server:4001".to_owned())));
    assert_eq!((SERIAL.parse)("rtu:///dev/ttyUSB0"), None);
}

#[test]
fn a_wrong_address_is_rejected_in_its_own_notation() {
    for (text, words) in [
        ("ascii:///dev/ttyUSB0?data_bits=9", "`data_bits=9`: allowed: 7, 8"),
        ("ascii:///dev/ttyUSB0?speed=1", "allowed: baud, data_bits, parity, stop_bits"),
        ("ascii://dev/ttyUSB0", "three slashes: ascii:///dev/ttyUSB0"),
    ] {
        let why = (SERIAL.parse)(text).unwrap().unwrap_err();
        assert!(why.contains(words), "{text}: {why}");
    }
    let why = (OVER_TCP.parse)("ascii+tcp://server").unwrap().unwrap_err();
    assert!(why.contains("ascii+tcp://server:4001"), "{why}");
}

#[test]
fn a_line_is_shown_and_written_with_its_settings() {
    let serial = Serial { baud: 9600, parity: Parity::Even, stop_bits: 2 };
    let transport = Transport::Ascii { serial, data_bits: 7 };
    assert_eq!((SERIAL.shown)(transport, "/dev/ttyUSB0"), "/dev/ttyUSB0 at 9600 baud 7E2");
    assert_eq!(
        (SERIAL.settings)(transport),
        "baud = 9600\ndata_bits = 7\nparity = \"even\"\nstop_bits = 2\n"
    );
    assert_eq!((OVER_TCP.shown)(Transport::AsciiOverTcp, "server:4001"), "ascii+tcp://server:4001");
}

#[test]
fn the_faults_of_text_have_remedies_of_their_own() {
    let faults = [PeerFault::Malformed, PeerFault::Checksum, PeerFault::Unasked, PeerFault::Echoed];
    for fault in faults.map(Fault::Peer) {
        assert!(hint(fault).is_some(), "{fault}");
    }
    let link = [LinkFault::Refused, LinkFault::Broken].map(Fault::Link);
    for fault in link.into_iter().chain(faults.map(Fault::Peer)) {
        let said = hint(fault).unwrap_or_default();
        assert!(
            !said.is_empty() && !said.contains("Modbus") && !said.contains("unit number"),
            "{fault}: {said}"
        );
    }
    assert!(hint(Fault::Timeout).unwrap().contains("baud rate"));
    assert_eq!(hint(Fault::Link(LinkFault::Unreachable)), None);
}
