//! Devices that send lines of text: readouts, gauges, and DCON modules (ADAM and similar I/O modules). The
//! gateway only reads from them.
//!
//! - [`lines`] — lines of text from the bytes of a port. `search` — the values in the lines of one answer.
//! - [`pending`] — requests whose answers may still arrive.
//! - [`wire`] — sends a request and receives the lines of the answer. `port` reads the lines from a port, and `dial`
//!   opens the port.
//! - `scan` — shows the text on a line, and searches for DCON modules.
//!
//! Some devices send without a request. Each read then discards the text that has arrived, and uses the next
//! whole line. The value is therefore never older than the read.

mod dial;
pub mod lines;
pub mod pending;
mod port;
pub mod request;
mod scan;
mod search;
pub mod wire;

use super::kind::{BusKind, LinePlace, ScanKind, VirtualLine, serial_server_hint};
use super::target::{host, profile_lines, serial_with_data_bits};
use crate::fieldbus::connection::Dial;
use crate::fieldbus::error::{Fault, LinkFault, PeerFault};
use crate::fieldbus::serial::place;
use isotherm_profile::{Bus, Transport};

/// Beginning of the address of a serial port.
const SCHEME: &str = "ascii://";
/// Beginning of the address of a serial server.
const SCHEME_OVER_TCP: &str = "ascii+tcp://";

/// Description of the bus type with lines of text on a serial port of this computer.
pub const SERIAL: BusKind = BusKind {
    word: "serial-ascii",
    address_key: "port",
    settings: |transport| match transport {
        Transport::Ascii { serial, data_bits } => profile_lines(serial, data_bits),
        _ => String::new(),
    },
    example: Some("ascii:///dev/ttyUSB0?baud=9600&data_bits=7&parity=even"),
    parse: |text| {
        let found = serial_with_data_bits(text.strip_prefix(SCHEME)?, SCHEME, 8);
        Some(found.map(|(serial, data_bits, path)| (Transport::Ascii { serial, data_bits }, path)))
    },
    shown: |transport, address| match transport.port_settings() {
        Some(settings) => format!("{address} at {settings}"),
        None => address.to_owned(),
    },
    dial,
    hint,
    place: |bus| LinePlace::Name(place(&bus.address)),
    is_lossy: true,
    scan: SCAN,
    virtual_line: VirtualLine::Served("is the serial port"),
    ..BusKind::PLAIN
};

/// Description of the bus type with lines of text through a TCP connection to a serial server.
pub const OVER_TCP: BusKind = BusKind {
    word: "serial-ascii",
    example: Some("ascii+tcp://192.168.0.20:4001"),
    parse: |text| {
        let host = host(text.strip_prefix(SCHEME_OVER_TCP)?, None);
        let host = host.map_err(|why| why.replace("rtu+tcp://", SCHEME_OVER_TCP));
        Some(host.map(|address| (Transport::AsciiOverTcp, address)))
    },
    shown: |_, address| format!("{SCHEME_OVER_TCP}{address}"),
    dial,
    hint,
    place: |bus| LinePlace::Host(bus.address.clone()),
    is_lossy: true,
    scan: SCAN,
    virtual_line: VirtualLine::Served("listens on"),
    ..BusKind::PLAIN
};

const SCAN: ScanKind = ScanKind::Other {
    is: "a line with text",
    instead: "`isotherm scan` of this line shows the text that arrives, and DCON modules",
    scan: Some(scan::report),
};

fn dial(bus: &Bus) -> Option<Box<dyn Dial>> {
    Some(Box::new(dial::TextDial::new(bus)?))
}

/// Returns the remedy for a fault of a device that sends text; `None` if the general remedy for all types of bus
/// applies.
fn hint(fault: Fault) -> Option<&'static str> {
    match fault {
        Fault::Timeout => Some(
            "is the device on and connected? Do baud rate, data bits and parity match the device? Does `request` \
             end as the device expects, often with \\r? A device that sends without a request needs a `timeout` \
             longer than its interval",
        ),
        Fault::Peer(PeerFault::Malformed) => Some(
            "the text differs from `text` of the signal: was the device switched to another unit, for example inch, or \
             to another resolution? Do data bits and parity match the device? `isotherm trace` shows it",
        ),
        Fault::Peer(PeerFault::Checksum) => Some(
            "is the checksum of the module switched on? If it is off, `text` must not contain {sum}. Otherwise check \
             the cable, its shield and its termination",
        ),
        Fault::Link(LinkFault::Broken) => {
            Some("many serial servers accept one client at a time: is another program connected?")
        }
        Fault::Peer(PeerFault::Unasked) => Some(
            "the device sends without a request: remove `request` of its signals, or set the device to send on \
             request",
        ),
        Fault::Peer(PeerFault::Echoed) => Some(
            "the adapter returns the request, and the device does not answer: are its address and `request` right?",
        ),
        _ => serial_server_hint(fault),
    }
}

#[cfg(test)]
mod tests;
