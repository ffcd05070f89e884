//! Modbus TCP, also inside TLS, and Modbus RTU and ASCII on a serial port or through TCP.
//!
//! - [`tcp`] — frames of Modbus TCP; [`rtu`] — frames of a serial line. The private module `pdu` builds and
//!   checks the content of both. [`ascii`] — converts RTU frames to Modbus ASCII and back.
//! - [`pending_replies`] — late replies that a unit may still send after a timeout, and the requests that may
//!   be sent meanwhile.
//! - [`reply_signature`] — features that distinguish the answers to two requests; `order_check` — whether the
//!   answers of a unit behind a Modbus gateway belong to their requests.
//! - [`text`] — detection of text of another protocol on the line.
//! - [`wire`] — interface of a Modbus connection, in addition to that of every line.
//! - `pipeline` — whether two requests are sent together, and when the line stops doing so.

pub mod ascii;
mod dial;
pub(in crate::fieldbus) mod hint;
pub(in crate::fieldbus) mod order_check;
mod pdu;
pub mod pending_replies;
pub(in crate::fieldbus) mod pipeline;
pub mod reply_signature;
pub mod request;
pub mod rtu;
pub mod tcp;
pub mod text;
pub mod wire;

use super::kind::{BusKind, LinePlace, ScanKind, VirtualLine, serial_server_hint};
use super::target::{host, profile_lines, serial, serial_with_data_bits};
use crate::fieldbus::connection::Dial;
use crate::fieldbus::serial::place;
use isotherm_profile::{Bus, Parity, Serial, Transport};

/// Default TCP port of Modbus TCP.
const PORT: u16 = 502;

/// Description of the bus type Modbus TCP.
pub const TCP: BusKind = BusKind {
    word: "modbus-tcp",
    example: Some("tcp://192.168.0.10:502"),
    parse: |text| {
        let host = host(text.strip_prefix("tcp://")?, Some(PORT));
        Some(host.map(|address| (Transport::Tcp, address)))
    },
    shown: |_, address| format!("tcp://{address}"),
    dial,
    advice: hint::advice,
    place: |bus| LinePlace::Host(bus.address.clone()),
    is_lossy: true,
    scan: ScanKind::Units {
        unanswered: "Try another port, or another --register. If the units are behind a Modbus gateway, check its \
                     baud rate, parity and wiring",
        malformed: " Write rtu+tcp://",
    },
    virtual_line: VirtualLine::Served("listens on"),
    ..BusKind::PLAIN
};

/// Description of the bus type with RTU frames through a TCP connection.
pub const RTU_OVER_TCP: BusKind = BusKind {
    word: "modbus-rtu-over-tcp",
    example: Some("rtu+tcp://192.168.0.11:4001"),
    parse: |text| {
        let host = host(text.strip_prefix("rtu+tcp://")?, None);
        Some(host.map(|address| (Transport::RtuOverTcp, address)))
    },
    shown: |_, address| format!("rtu+tcp://{address}"),
    dial,
    hint: serial_server_hint,
    advice: hint::advice,
    place: |bus| LinePlace::Host(bus.address.clone()),
    is_lossy: true,
    scan: SERIAL_UNITS,
    virtual_line: VirtualLine::Served("listens on"),
    ..BusKind::PLAIN
};

/// Description of the bus type with RTU frames on a serial port of this computer.
pub const SERIAL: BusKind = BusKind {
    word: "modbus-rtu",
    address_key: "port",
    settings: |transport| match transport {
        Transport::Serial(Serial { baud, parity, stop_bits }) => {
            format!("baud = {baud}\nparity = \"{}\"\nstop_bits = {stop_bits}\n", parity.word())
        }
        _ => String::new(),
    },
    example: Some("rtu:///dev/ttyUSB0?baud=9600&parity=none"),
    parse: |text| {
        let port = serial(text.strip_prefix("rtu://")?);
        Some(port.map(|(serial, path)| (Transport::Serial(serial), path)))
    },
    shown: |transport, address| match transport {
        Transport::Serial(serial) => format!("{address} at {serial}"),
        _ => address.to_owned(),
    },
    dial,
    advice: hint::advice,
    place: |bus| LinePlace::Name(place(&bus.address)),
    is_lossy: true,
    scan: SERIAL_UNITS,
    virtual_line: VirtualLine::Served("is the serial port"),
    ..BusKind::PLAIN
};

/// Beginning of the address of a serial port with Modbus ASCII.
const ASCII_SCHEME: &str = "modbus-ascii://";
/// Beginning of the address of a serial server with Modbus ASCII.
const ASCII_SCHEME_OVER_TCP: &str = "modbus-ascii+tcp://";

/// Description of the bus type with Modbus ASCII on a serial port of this computer.
pub const ASCII: BusKind = BusKind {
    word: "modbus-ascii",
    address_key: "port",
    settings: |transport| match transport {
        Transport::ModbusAscii { serial, data_bits } => profile_lines(serial, data_bits),
        _ => String::new(),
    },
    example: Some("modbus-ascii:///dev/ttyUSB0?baud=9600&data_bits=7&parity=even"),
    parse: |text| {
        let found = serial_with_data_bits(text.strip_prefix(ASCII_SCHEME)?, ASCII_SCHEME, 7);
        let found = found.map(|(serial, data_bits, path)| {
            // The default parity is that of Modbus ASCII.
            let parity = if text.contains("parity=") { serial.parity } else { Parity::Even };
            (Transport::ModbusAscii { serial: Serial { parity, ..serial }, data_bits }, path)
        });
        Some(found)
    },
    shown: |transport, address| match transport.port_settings() {
        Some(settings) => format!("{address} at {settings}"),
        None => address.to_owned(),
    },
    dial,
    advice: hint::advice,
    place: |bus| LinePlace::Name(place(&bus.address)),
    is_lossy: true,
    scan: ASCII_UNITS,
    virtual_line: VirtualLine::Served("is the serial port"),
    ..BusKind::PLAIN
};

/// Description of the bus type with Modbus ASCII through a TCP connection.
pub const ASCII_OVER_TCP: BusKind = BusKind {
    word: "modbus-ascii",
    example: Some("modbus-ascii+tcp://192.168.0.11:4001"),
    parse: |text| {
        let host = host(text.strip_prefix(ASCII_SCHEME_OVER_TCP)?, None);
        let host = host.map_err(|why| why.replace("rtu+tcp://", ASCII_SCHEME_OVER_TCP));
        Some(host.map(|address| (Transport::ModbusAsciiOverTcp, address)))
    },
    shown: |_, address| format!("{ASCII_SCHEME_OVER_TCP}{address}"),
    dial,
    hint: serial_server_hint,
    advice: hint::advice,
    place: |bus| LinePlace::Host(bus.address.clone()),
    is_lossy: true,
    scan: ASCII_UNITS,
    virtual_line: VirtualLine::Served("listens on"),
    ..BusKind::PLAIN
};

const ASCII_UNITS: ScanKind = ScanKind::Units {
    unanswered: "Try other settings, for example data_bits=8&parity=none, or another --register. Check the power of the \
                 device, and whether it is set to Modbus ASCII",
    malformed: "",
};

const SERIAL_UNITS: ScanKind = ScanKind::Units {
    unanswered: "Try --baud 1200,9600,19200,38400 --parity none,even, or another --register. Check the power of \
                 the device, and whether A and B are exchanged",
    malformed: "",
};

fn dial(bus: &Bus) -> Option<Box<dyn Dial>> {
    Some(Box::new(dial::ModbusDial::new(bus)?))
}
