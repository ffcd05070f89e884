use super::*;

#[test]
fn a_line_is_read_as_people_type_it() {
    for (text, shown) in [
        ("tcp://192.168.0.10:502", "tcp://192.168.0.10:502"),
        ("tcp://plc.cell", "tcp://plc.cell:502"),
        ("tcp://plc.cell:1502/", "tcp://plc.cell:1502"),
        ("tcp://[fe80::1]", "tcp://[fe80::1]:502"),
        ("tcp://[fe80::1]:503", "tcp://[fe80::1]:503"),
        ("rtu+tcp://10.0.0.7:4001", "rtu+tcp://10.0.0.7:4001"),
        ("opc.tcp://nck.cell", "opc.tcp://nck.cell:4840"),
        ("opc.tcp://[::1]/plc", "opc.tcp://[::1]:4840/plc"),
        ("opc.tcp://[fe80::1%2]:4841/", "opc.tcp://[fe80::1%2]:4841"),
        ("rtu:///dev/ttyUSB0", "/dev/ttyUSB0 at 9600 baud 8N1"),
        ("/sys", "/sys"),
        ("/dev/ttyUSB0", "/dev/ttyUSB0 at 9600 baud 8N1"),
        (
            "/dev/serial/by-id/usb-FTDI_FT4X2ABC-if00-port0",
            "/dev/serial/by-id/usb-FTDI_FT4X2ABC-if00-port0 at 9600 baud 8N1",
        ),
        ("/dev/ttyUSB0?baud=19200&parity=even", "/dev/ttyUSB0 at 19200 baud 8E1"),
        ("192.168.0.10", "tcp://192.168.0.10:502"),
        ("192.168.0.10:1502", "tcp://192.168.0.10:1502"),
        ("localhost", "tcp://localhost:502"),
        ("plc.cell:802", "tcp://plc.cell:802"),
        ("[fe80::1]", "tcp://[fe80::1]:502"),
        ("[fe80::1]:503", "tcp://[fe80::1]:503"),
        ("192.168.0.12:4840", "opc.tcp://192.168.0.12:4840"),
        ("rtu:///dev/ttyS1?baud=1200&parity=even&stop_bits=2", "/dev/ttyS1 at 1200 baud 8E2"),
        ("modbus-ascii:///dev/ttyS1", "/dev/ttyS1 at 9600 baud 7E1"),
        ("modbus-ascii:///dev/ttyS1?baud=4800&data_bits=8&parity=none", "/dev/ttyS1 at 4800 baud 8N1"),
        ("modbus-ascii+tcp://10.0.0.7:4001", "modbus-ascii+tcp://10.0.0.7:4001"),
        ("ascii:///dev/ttyS1?baud=4800&data_bits=7&parity=even", "/dev/ttyS1 at 4800 baud 7E1"),
        ("ascii+tcp://10.0.0.7:4001", "ascii+tcp://10.0.0.7:4001"),
    ] {
        assert_eq!(
            text.parse::<LineAddress>().map(|place| place.to_string()),
            Ok(shown.to_owned()),
            "{text}"
        );
    }
}

#[test]
fn what_is_no_line_is_told_how_to_write_one() {
    for (text, word) in [
        ("", "tcp://192.168.0.10:502"),
        ("192.168.0.10:", "not a host and port"),
        ("192.168.0.10:0", "not a host and port"),
        ("192.168.0.10:99999", "the port is above 65535: write a port from 1 to 65535"),
        ("::1", "write [::1]:502"),
        ("/dev/ttyUSB0?speed=9600", "baud, parity, stop_bits"),
        ("http://x", "rtu+tcp://"),
        ("tcp://", "the host is missing"),
        ("tcp://x:0", "not a host and port"),
        ("tcp://:502", "not a host and port"),
        ("tcp://x:99999", "the port is above 65535: write a port from 1 to 65535, as x:502"),
        ("rtu+tcp://x:70000", "the port is above 65535"),
        ("tcp://::1:15921", "write [::1]:15921"),
        ("tcp://::1", "write [::1]:502"),
        ("opc.tcp://nck:99999", "the port is above 65535"),
        ("rtu+tcp://x", "rtu+tcp://x:4001"),
        ("opc.tcp://::1", "\"opc.tcp://[::1]:4840\""),
        ("opc.tcp://ho st", "contains a space"),
        ("opc.tcp:// 10.0.0.7", "contains a space"),
        ("opc.tcp://", "not a host and port"),
        ("opc.tcp://10.0.0.300", "not a host and port"),
        ("opc.tcp://nck:0", "not a host and port"),
        ("opc.tcp://[nck]", "not a host and port"),
        ("rtu://dev/ttyUSB0", "three slashes"),
        ("rtu:///dev/ttyUSB0?baud=9", "300"),
        ("rtu:///dev/ttyUSB0?parity=mark", "none, even, odd"),
        ("rtu:///dev/ttyUSB0?stop_bits=3", "1, 2"),
        ("rtu:///dev/ttyUSB0?speed=9600", "baud, parity, stop_bits"),
        ("modbus-ascii:///dev/ttyUSB0?data_bits=5", "allowed: 7, 8"),
        ("modbus-ascii+tcp://x", "modbus-ascii+tcp://x:4001"),
    ] {
        let why = text.parse::<LineAddress>().unwrap_err();
        assert!(why.contains(word), "{text}: {why}");
    }
}

#[test]
fn the_settings_of_a_serial_line_with_units_can_be_changed() {
    for (text, expected) in [
        ("rtu:///dev/ttyS1", "/dev/ttyS1 at 1200 baud 8N1"),
        ("modbus-ascii:///dev/ttyS1", "/dev/ttyS1 at 1200 baud 7E1"),
        ("ascii:///dev/ttyS1", "/dev/ttyS1 at 9600 baud 8N1"),
        ("tcp://10.0.0.7:502", "tcp://10.0.0.7:502"),
    ] {
        let line: LineAddress = text.parse().unwrap();
        assert_eq!(line.with_serial(|serial| Serial { baud: 1200, ..serial }).to_string(), expected);
    }
}
