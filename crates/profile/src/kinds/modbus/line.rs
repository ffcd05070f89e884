//! Settings of Modbus lines in the tables `[bus.*]` of the profile: address, serial port, and TLS.

use std::time::Duration;

use crate::host_port::host_and_port;
use crate::kinds::modbus::quirks;
use crate::kinds::modbus::serial::{Parity, Serial};
use crate::tables::bus::tls::TLS_PORT;
use crate::tables::bus::transport::{BusType, Transport};
use crate::tables::bus::{LineSettings, LineType, RawBus};
use crate::tables::{KeyContext, optional};

/// Assumed answer time of a device through a plain serial server. It includes two short frames at 9600 baud, because
/// profiles do not state the baud rate behind a serial server.
const ANSWER_THROUGH_SERVER: Duration = Duration::from_millis(30);
/// TCP port of Modbus TCP without TLS, which hints suggest.
const USUAL: u16 = 502;
/// Example of host and port, which hints show.
const EXAMPLE: &str = "192.168.0.10:502";

/// Types of Modbus lines.
pub(super) static TYPES: [LineType; 4] = [
    LineType {
        word: BusType::ModbusTcp,
        title: "Modbus TCP",
        keys: &["address", "late", "tls", "pipeline", "quirks"],
        exclusive: None,
        answer: LineType::ANSWER,
    },
    LineType {
        word: BusType::ModbusRtu,
        title: "Modbus RTU",
        keys: &["late", "port", "baud", "parity", "stop_bits", "quirks"],
        exclusive: Some("port"),
        answer: LineType::ANSWER,
    },
    LineType {
        word: BusType::ModbusRtuOverTcp,
        title: "RTU over TCP",
        keys: &["address", "late", "quirks"],
        exclusive: Some("address"),
        answer: ANSWER_THROUGH_SERVER,
    },
    LineType {
        word: BusType::ModbusAscii,
        title: "Modbus ASCII",
        keys: &["address", "late", "port", "baud", "parity", "stop_bits", "data_bits", "quirks"],
        exclusive: Some("port"),
        answer: ANSWER_THROUGH_SERVER,
    },
];

/// Resolves transport and address of a line of this type. The address is `None` if it has an error.
pub(super) fn resolve(raw: &RawBus, at: &KeyContext<'_>, of: BusType) -> Option<(Transport, Option<String>)> {
    if of == BusType::ModbusTcp {
        return Some((Transport::Tcp, address(raw, at)));
    }
    at.key("quirks").not_applicable(&["gateway"], quirks::OF_TCP, quirks::WAITS);
    if of == BusType::ModbusRtuOverTcp {
        return Some((Transport::RtuOverTcp, address(raw, at)));
    }
    if of == BusType::ModbusAscii && at.key("address").is_written() {
        let help = "remove this key: these settings are made at the serial server";
        let settings = ["port", "baud", "parity", "stop_bits", "data_bits"];
        at.not_applicable(&settings, "a serial port of this computer", help);
        return Some((Transport::ModbusAsciiOverTcp, address(raw, at)));
    }
    let (settings, port) = (serial(raw, at), port(raw, at));
    if of == BusType::ModbusAscii {
        // The usual settings of Modbus ASCII (Modbus over Serial Line V1.02, 2.5.2).
        let serial = Serial { parity: raw.parity.unwrap_or(Parity::Even), ..settings? };
        return Some((Transport::ModbusAscii { serial, data_bits: raw.data_bits.unwrap_or(7) }, port));
    }
    Some((Transport::Serial(settings?), port))
}

/// Resolves the TLS settings of a modbus-tcp line at this address.
pub(super) fn settings(
    raw: &RawBus,
    at: &KeyContext<'_>,
    of: BusType,
    address: Option<&str>,
) -> Option<LineSettings> {
    let tls = optional(raw.tls.as_ref().filter(|_| of == BusType::ModbusTcp), |tls| {
        // The files are checked even if the address is wrong.
        let host = address.and_then(|address| host_and_port(address).ok());
        tls.resolve(&at.key("tls"), host.map_or("localhost", |(host, _)| host))
    })?;
    Some(LineSettings { tls, ..LineSettings::default() })
}

/// Checks the host and port of a TCP line. Returns `None` if they have an error.
pub(super) fn address(raw: &RawBus, at: &KeyContext<'_>) -> Option<String> {
    let at = at.key("address");
    let help = "write host and port, as \"192.168.0.10:502\"; 502 is Modbus TCP's usual port";
    at.missing("`address` is missing: what are the host and port of the line?", help);
    let address = raw.address.as_ref()?;
    if let Some((scheme, rest)) = address.split_once("://") {
        let host = rest.split(['/', '?']).next().unwrap_or_default();
        let host = match host_and_port(host) {
            Ok((_, Some(_))) => host.to_owned(),
            Ok((host, None)) => format!("{host}:{USUAL}"),
            Err(why) => why.meant(USUAL).unwrap_or_else(|| EXAMPLE.to_owned()),
        };
        let help = format!("write host and port alone, as \"{host}\"; `type` sets the protocol");
        return at.reject(format!("`{address}` is a URL (`{scheme}`), not host and port"), help);
    }
    let place = host_and_port(address);
    let host = place.as_ref().map_or(address.as_str(), |(host, _)| host);
    let is_numbers = host.contains('.') && host.chars().all(|c| c.is_ascii_digit() || c == '.');
    if is_numbers && host.parse::<std::net::Ipv4Addr>().is_err() {
        let help = "write four numbers of 0 to 255, as \"192.168.0.10:502\"";
        return at.reject(format!("`{host}` is not an IP address"), help);
    }
    let example = match place {
        Ok((_, Some(_))) => return Some(address.clone()),
        Ok((host, None)) if raw.tls.is_some() => return Some(format!("{host}:{TLS_PORT}")),
        Ok((host, None)) => format!("{host}:{USUAL}"),
        Err(_) => EXAMPLE.to_owned(),
    };
    let help = place.err().and_then(|why| why.help(USUAL, str::to_owned));
    let help = help.unwrap_or_else(|| {
        format!("write host and port, as \"{example}\"; {USUAL} is Modbus TCP's usual port")
    });
    at.reject(format!("`{address}` is not a host and port"), help)
}

/// Resolves the settings of a serial port. Returns `None` if they have an error.
fn serial(raw: &RawBus, at: &KeyContext<'_>) -> Option<Serial> {
    let help = "write the baud rate that is set at the devices: 9600 and 19200 are usual";
    at.key("baud").missing("`baud` is missing: what is the baud rate of the line?", help);
    let (parity, stop_bits) = (raw.parity.unwrap_or_default(), raw.stop_bits.unwrap_or(1));
    Some(Serial { baud: raw.baud?, parity, stop_bits })
}

/// Checks the path of a serial port. Returns `None` if it has an error.
fn port(raw: &RawBus, at: &KeyContext<'_>) -> Option<String> {
    let at = at.key("port");
    let help = "write the port's path; `ls /dev/serial/by-id` shows the names that do not change when an \
                adapter is replugged";
    at.missing("`port` is missing: which serial port of this computer is the line?", help);
    let port = raw.port.as_ref()?;
    if !port.starts_with('/') {
        let help = format!("write the whole path, as \"/dev/{port}\" or a path below /dev/serial/by-id");
        return at.reject(format!("`{port}` is not the path of a serial port"), help);
    }
    if ["/dev/ttyUSB", "/dev/ttyACM"].iter().any(|numbered| port.starts_with(numbered)) {
        let message = format!(
            "`{port}` may be another adapter after adapters were replugged or the computer was restarted"
        );
        at.warn(message, "use the adapter's name below /dev/serial/by-id");
    }
    Some(port.clone())
}
