//! Types of lines, and their transports.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::kinds::modbus::serial::Serial;

/// Default time after which a write without an answer can no longer arrive. The gateway assumes that no network or
/// device delays a write for longer.
pub(super) const LATE: Duration = Duration::from_secs(30);
const LATE_TIMEOUTS: u32 = 2;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum BusType {
    ModbusTcp,
    ModbusRtu,
    ModbusRtuOverTcp,
    ModbusAscii,
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
    /// Modbus RTU frames over a TCP connection, as simple serial servers forward them.
    RtuOverTcp,
    /// Modbus RTU on a serial port of this computer.
    Serial(Serial),
    /// Modbus ASCII on a serial port of this computer.
    ModbusAscii {
        /// Baud rate, parity and stop bits of the port.
        serial: Serial,
        /// Data bits of each character, 7 or 8.
        data_bits: u8,
    },
    /// Modbus ASCII frames over a TCP connection.
    ModbusAsciiOverTcp,
    /// A CAN interface of this computer.
    Can,
    /// An OPC UA server.
    OpcUa,
    /// Sensors of this computer, read through its kernel.
    Sysfs,
    /// Lines of text on a serial port of this computer.
    Ascii {
        /// Baud rate, parity and stop bits of the port.
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

    /// Returns the settings of the serial port of a Modbus line. For Modbus ASCII they are adapted, so that times
    /// calculated for RTU frames are long enough. `None` if the transport has no serial port.
    pub const fn serial(self) -> Option<Serial> {
        match self {
            Transport::Serial(serial) => Some(serial),
            Transport::ModbusAscii { serial, .. } => Some(serial.for_ascii()),
            _ => None,
        }
    }

    /// Formats the settings of a serial port, for example as `9600 baud 7E2`. `None` if the transport has no serial
    /// port.
    pub fn port_settings(self) -> Option<String> {
        let (serial, data_bits) = match self {
            Transport::Serial(serial) => (serial, 8),
            Transport::Ascii { serial, data_bits } | Transport::ModbusAscii { serial, data_bits } => {
                (serial, data_bits)
            }
            _ => return None,
        };
        // `Serial` formats the eight data bits of Modbus RTU.
        Some(serial.to_string().replacen(" 8", &format!(" {data_bits}"), 1))
    }

    /// Returns the type of the lines with this transport, as the key `type` states it.
    pub(crate) const fn bus_type(self) -> BusType {
        match self {
            Transport::Tcp => BusType::ModbusTcp,
            Transport::RtuOverTcp => BusType::ModbusRtuOverTcp,
            Transport::Serial(_) => BusType::ModbusRtu,
            Transport::ModbusAscii { .. } | Transport::ModbusAsciiOverTcp => BusType::ModbusAscii,
            Transport::Can => BusType::Can,
            Transport::OpcUa => BusType::OpcUa,
            Transport::Sysfs => BusType::Sysfs,
            Transport::Ascii { .. } | Transport::AsciiOverTcp => BusType::SerialAscii,
        }
    }

    /// Returns the default time during which a write without an answer may still arrive. On a local serial port only
    /// the device can delay a write.
    pub fn late(self, timeout: Duration) -> Duration {
        match self {
            Transport::Serial(_) | Transport::ModbusAscii { .. } => timeout.saturating_mul(LATE_TIMEOUTS),
            // Nothing is written to these lines.
            Transport::Sysfs | Transport::Ascii { .. } | Transport::AsciiOverTcp => timeout,
            Transport::Tcp
            | Transport::RtuOverTcp
            | Transport::ModbusAsciiOverTcp
            | Transport::Can
            | Transport::OpcUa => LATE.max(timeout),
        }
    }
}
