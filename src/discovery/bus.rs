//! Address of a bus line as one word, as users type it: `tcp://192.168.0.10:502`,
//! `rtu:///dev/ttyUSB0?baud=9600&parity=none`, `rtu+tcp://192.168.0.11:4001`, `opc.tcp://192.168.0.12:4840`. `/sys`
//! stands for this computer's own sensors.
//!
//! Users may omit the type of line. `/dev/ttyUSB0` is a serial port, `192.168.0.10` and `192.168.0.10:1502` are Modbus
//! TCP, and a host with the port 4840 is an OPC UA server.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use crate::fieldbus::kinds::kind::BusKind;
use crate::fieldbus::kinds::{self, KINDS};
use isotherm_profile::{Bus, OpcUa, Quirks, Transport, host_and_port};

pub use crate::fieldbus::kinds::baud;
pub use crate::fieldbus::kinds::kind::{ScanKind, ScanReport, VirtualLine};
pub use isotherm_profile::{Parity, Serial};

/// Transport and address of a bus line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineAddress {
    /// Transport of the line, for example Modbus TCP, or RTU on a serial port.
    pub transport: Transport,
    /// Address in the notation of the transport: host and port, URL, path of the serial port, CAN interface, or
    /// directory of the kernel's sensors.
    pub address: String,
}

impl LineAddress {
    /// Returns the transport and address of a bus in the profile.
    pub fn of(bus: &Bus) -> LineAddress {
        LineAddress { transport: bus.transport, address: bus.address.clone() }
    }

    /// Returns the description of the type of bus, for example Modbus TCP or CAN.
    pub fn kind(&self) -> &'static BusKind {
        kinds::of(self.transport)
    }

    /// Returns the settings of the serial port of a Modbus line; `None` if the line uses no serial port of this
    /// computer.
    pub const fn serial(&self) -> Option<Serial> {
        match self.transport {
            Transport::Serial(serial) | Transport::ModbusAscii { serial, .. } => Some(serial),
            _ => None,
        }
    }

    /// Returns a copy of this address with changed settings of the serial port. An address without a serial port is not
    /// changed.
    pub fn with_serial(&self, change: impl FnOnce(Serial) -> Serial) -> LineAddress {
        let transport = match self.transport {
            Transport::Serial(serial) => Transport::Serial(change(serial)),
            Transport::ModbusAscii { serial, data_bits } => {
                Transport::ModbusAscii { serial: change(serial), data_bits }
            }
            other => other,
        };
        LineAddress { transport, address: self.address.clone() }
    }

    /// Returns the settings of a bus with this transport and address, and with `timeout`. All other settings have their
    /// defaults.
    pub fn bus(&self, timeout: Duration) -> Bus {
        Bus {
            name: "line".to_owned(),
            transport: self.transport,
            address: self.address.clone(),
            tls: None,
            opcua: self.kind().has_namespaces.then(|| Box::new(OpcUa::plain())),
            timeout,
            late: self.transport.late(timeout),
            pipeline: 1,
            quirks: Quirks::default(),
            sync: None,
        }
    }

    /// Returns the profile text for this bus line: its type, its address and its serial settings. The table header with
    /// the name of the bus is not included.
    pub fn profile_lines(&self) -> String {
        let BusKind { word, address_key, settings, .. } = self.kind();
        format!("type = \"{word}\"\n{address_key} = \"{}\"\n{}", self.address, settings(self.transport))
    }
}

/// Text for users, for example `tcp://192.168.0.10:502` or `/dev/ttyUSB0 at 9600 baud 8N1`.
impl fmt::Display for LineAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&(self.kind().shown)(self.transport, &self.address))
    }
}

impl FromStr for LineAddress {
    type Err = String;

    /// # Errors
    /// A sentence with the mistake and the correct form.
    fn from_str(text: &str) -> Result<LineAddress, String> {
        let full = with_type(text);
        let text = full.as_deref().unwrap_or(text);
        let parsed = KINDS.iter().find_map(|kind| (kind.parse)(text));
        let (transport, address) = parsed.unwrap_or_else(|| {
            Err(match text.split_once("://") {
                Some((scheme, _)) => format!("`{scheme}` is not a type of bus line; {}", forms()),
                None => format!("`{text}` is not an address of a bus line; {}", forms()),
            })
        })?;
        Ok(LineAddress { transport, address })
    }
}

/// TCP port that is registered for OPC UA.
pub(crate) const OPC_UA: u16 = 4840;

/// Adds the type of bus line, for example `rtu://`, to the path of a serial port or to a host. Returns `None` for other
/// texts.
fn with_type(text: &str) -> Option<String> {
    if text.starts_with("/dev/") {
        return Some(format!("rtu://{text}"));
    }
    if text.is_empty() || text.starts_with('/') || text.contains("://") {
        return None;
    }
    let is_opcua = host_and_port(text).is_ok_and(|(_, port)| port == Some(OPC_UA));
    Some(format!("{}://{text}", if is_opcua { "opc.tcp" } else { "tcp" }))
}

/// Returns a list with an example of each form of bus address, for messages.
fn forms() -> String {
    let examples: Vec<&str> = KINDS.iter().filter_map(|kind| kind.example).collect();
    match examples.as_slice() {
        [before @ .., last] => format!("write {} or {last}", before.join(", ")),
        [] => String::new(),
    }
}

#[cfg(test)]
mod tests;
