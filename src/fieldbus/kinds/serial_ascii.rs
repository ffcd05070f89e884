//! Devices that send lines of text: readouts, gauges, and DCON modules. The lines are only read.
//!
//! - [`lines`] — lines of text from the bytes of a port. `search` — the values in the lines of one answer.
//! - [`pending`] — requests whose answers may still arrive.
//! - [`wire`] — sends a request and receives its lines. `port` is its port, and `dial` opens it.
//! - `scan` — shows the text on a line, and searches for DCON modules.
//!
//! Some devices send without a request. Each read then discards what has arrived, and takes the next whole line. The
//! value is therefore never older than the read.

mod dial;
pub mod lines;
pub mod pending;
mod port;
pub mod request;
mod scan;
mod search;
pub mod wire;

use super::kind::{BusKind, LinePlace, ScanKind, VirtualLine};
use super::target::{host, serial};
use crate::fieldbus::connection::Dial;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::serial::place;
use isotherm_profile::{Bus, Serial, Transport};

/// Beginning of the address of a serial port.
const SCHEME: &str = "ascii://";
/// Beginning of the address of a serial server.
const SCHEME_OVER_TCP: &str = "ascii+tcp://";

/// Lines of text on a serial port of this computer.
pub const SERIAL: BusKind = BusKind {
    word: "serial-ascii",
    address_key: "port",
    settings: |transport| match transport {
        Transport::Ascii { serial: Serial { baud, parity, stop_bits }, data_bits } => {
            let parity = parity.word();
            format!(
                "baud = {baud}\ndata_bits = {data_bits}\nparity = \"{parity}\"\nstop_bits = {stop_bits}\n"
            )
        }
        _ => String::new(),
    },
    example: Some("ascii:///dev/ttyUSB0?baud=9600&data_bits=7&parity=even"),
    parse: |text| Some(serial_port(text.strip_prefix(SCHEME)?)),
    shown: |transport, address| match transport.ascii_settings() {
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

/// Lines of text through a TCP connection to a serial server.
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

/// Parses the path of a serial port with its settings.
fn serial_port(text: &str) -> Result<(Transport, String), String> {
    let (path, settings) = text.split_once('?').unwrap_or((text, ""));
    let mut data_bits = 8;
    let mut others = Vec::new();
    for setting in settings.split('&') {
        match setting.strip_prefix("data_bits=") {
            None => others.push(setting),
            Some("7") => data_bits = 7,
            Some("8") => data_bits = 8,
            Some(_) => return Err(format!("`{setting}`: allowed: 7, 8")),
        }
    }
    let found = serial(&format!("{path}?{}", others.join("&")));
    let (serial, path) = found.map_err(|why| {
        why.replace("rtu://", SCHEME).replace("allowed: baud, parity", "allowed: baud, data_bits, parity")
    })?;
    Ok((Transport::Ascii { serial, data_bits }, path))
}

/// Returns the remedy for a fault of a device that sends text.
fn hint(fault: Fault) -> Option<&'static str> {
    match fault {
        Fault::Timeout => Some(
            "is the device on and connected? Are baud rate, data bits and parity those of the device? Does `request` \
             end as the device expects, often with \\r? A device that sends without a request needs a `timeout` \
             longer than its interval",
        ),
        Fault::Peer(PeerFault::Malformed) => Some(
            "the text differs from `text` of the signal: was the device switched to another unit, such as inch, or \
             to another resolution? Are data bits and parity those of the device? `isotherm trace` shows the text",
        ),
        Fault::Peer(PeerFault::Unasked) => Some(
            "the device sends without a request: remove `request` of its signals, or set the device to send on \
             request",
        ),
        Fault::Peer(PeerFault::Echoed) => Some(
            "the adapter returns the request, and the device does not answer: are its address and `request` right?",
        ),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
