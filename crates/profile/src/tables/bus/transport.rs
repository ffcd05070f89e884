//! Types of lines, and their transports.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::kinds::modbus::serial::Serial;

/// Longest time for which a network and its devices are assumed to delay a write.
pub(super) const LATE: Duration = Duration::from_secs(30);
const LATE_TIMEOUTS: u32 = 2;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum BusType {
    ModbusTcp,
    ModbusRtu,
    ModbusRtuOverTcp,
    Can,
    #[serde(rename = "opcua")]
    OpcUa,
    Sysfs,
    SerialAscii,
}

/// Transport of a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Modbus TCP.
    Tcp,
    /// RTU frames over a TCP connection, as simple gateways forward them.
    RtuOverTcp,
    /// Modbus RTU on a serial port of this computer.
    Serial(Serial),
    /// A CAN interface of this computer.
    Can,
    /// An OPC UA server.
    OpcUa,
    /// Sensors of this computer, from its kernel.
    Sysfs,
    /// Lines of text on a serial port of this computer.
    Ascii {
        /// Settings of the port.
        serial: Serial,
        /// Data bits of each character, 7 or 8.
        data_bits: u8,
    },
    /// Lines of text through a TCP connection to a serial server.
    AsciiOverTcp,
}

impl Transport {
    /// Returns whether the transport is a CAN interface.
    pub const fn is_can(self) -> bool {
        matches!(self, Transport::Can)
    }

    /// Settings of the serial port. `None` if the transport has none.
    pub const fn serial(self) -> Option<Serial> {
        if let Transport::Serial(serial) = self { Some(serial) } else { None }
    }

    /// Settings of a serial port with text, for example `9600 baud 7E2`. `None` for any other transport.
    pub fn ascii_settings(self) -> Option<String> {
        let Transport::Ascii { serial, data_bits } = self else { return None };
        // `Serial` formats the eight data bits of Modbus RTU.
        Some(serial.to_string().replacen(" 8", &format!(" {data_bits}"), 1))
    }

    /// Type of the lines with this transport.
    pub(crate) const fn bus_type(self) -> BusType {
        match self {
            Transport::Tcp => BusType::ModbusTcp,
            Transport::RtuOverTcp => BusType::ModbusRtuOverTcp,
            Transport::Serial(_) => BusType::ModbusRtu,
            Transport::Can => BusType::Can,
            Transport::OpcUa => BusType::OpcUa,
            Transport::Sysfs => BusType::Sysfs,
            Transport::Ascii { .. } | Transport::AsciiOverTcp => BusType::SerialAscii,
        }
    }

    /// Default time during which a write without an answer may still arrive. On a local serial port only the device can
    /// delay a write.
    pub fn late(self, timeout: Duration) -> Duration {
        match self {
            Transport::Serial(_) => timeout.saturating_mul(LATE_TIMEOUTS),
            // Nothing is written to these lines.
            Transport::Sysfs | Transport::Ascii { .. } | Transport::AsciiOverTcp => timeout,
            Transport::Tcp | Transport::RtuOverTcp | Transport::Can | Transport::OpcUa => LATE.max(timeout),
        }
    }
}
