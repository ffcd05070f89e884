//! Settings of serial-ascii buses in the tables `[bus.*]` of the profile: the serial port, or the address of a serial
//! server.

use crate::host_port::host_and_port;
use crate::kinds::modbus::serial::Serial;
use crate::tables::KeyContext;
use crate::tables::bus::RawBus;
use crate::tables::bus::transport::Transport;
use crate::tables::bus_kind::TransportAddress;

/// TCP port of a serial server, used in example addresses.
const USUAL: u16 = 4001;

/// Resolves transport and address of a bus. If the bus has the key `address`, the gateway connects to it through a
/// serial server.
pub(super) fn resolve(raw: &RawBus, at: &KeyContext<'_>) -> Option<TransportAddress> {
    if at.key("address").is_written() {
        let help = "remove this key: these settings are made at the serial server";
        let settings = ["port", "baud", "parity", "stop_bits", "data_bits"];
        at.not_applicable(&settings, "a serial port of this computer", help);
        return Some((Transport::AsciiOverTcp, address(&at.key("address"), raw.address.as_ref())));
    }
    let help = "write the baud rate that is set at the device: 9600 and 4800 are usual";
    at.key("baud").missing("`baud` is missing: what is the baud rate of the line?", help);
    let port = port(&at.key("port"), raw.port.as_ref());
    let (parity, stop_bits) = (raw.parity.unwrap_or_default(), raw.stop_bits.unwrap_or(1));
    let serial = Serial { baud: raw.baud?, parity, stop_bits };
    Some((Transport::Ascii { serial, data_bits: raw.data_bits.unwrap_or(8) }, port))
}

/// Checks the path of the serial port. Returns `None` if it has an error.
fn port(at: &KeyContext<'_>, port: Option<&String>) -> Option<String> {
    let help = "write the port's path, as \"/dev/serial/by-id/usb-…\"; or, for a serial server, address = \
                \"192.168.0.20:4001\"";
    at.missing("`port` is missing: which serial port of this computer is the line?", help);
    let port = port?;
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

/// Checks host and port of a serial server. Returns `None` if they have an error.
fn address(at: &KeyContext<'_>, address: Option<&String>) -> Option<String> {
    let address = address?;
    let help = match host_and_port(address) {
        Ok((_, Some(port))) if port > 0 => return Some(address.clone()),
        Ok((host, _)) => format!("write host and port, as \"{host}:{USUAL}\""),
        Err(why) => {
            let help = why.help(USUAL, |meant| format!("\"{meant}\""));
            help.unwrap_or_else(|| "write host and port, as \"192.168.0.20:4001\"".to_owned())
        }
    };
    at.reject(format!("`{address}` is not a host and port"), help)
}
