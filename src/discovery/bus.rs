//! Address of a line as one word, as users type it: `tcp://192.168.0.10:502`,
//! `rtu:///dev/ttyUSB0?baud=9600&parity=none`, `rtu+tcp://192.168.0.11:4001`, `opc.tcp://192.168.0.12:4840`. `/sys`
//! stands for this computer's own sensors.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use isotherm_profile::{Bus, OpcUa, Quirks, host_and_port, server_url};

pub use isotherm_profile::{Parity, Serial, Transport};

/// Default port of Modbus TCP.
const PORT: u16 = 502;
/// Default settings of a serial port. Most modules are shipped with these settings.
const SHIPPED_WITH: Serial = Serial { baud: 9600, parity: Parity::None, stop_bits: 1 };

/// Transport and address of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineAddress {
    /// Transport of the line.
    pub transport: Transport,
    /// Address in the notation of the transport: host and port, URL, path of the serial port, CAN interface, or
    /// directory of the kernel's sensors.
    pub address: String,
}

impl LineAddress {
    /// Returns the transport and address of a bus in a profile.
    pub fn of(bus: &Bus) -> LineAddress {
        LineAddress { transport: bus.transport, address: bus.address.clone() }
    }

    /// Returns this line with changed settings of its serial port. A line without a serial port is returned unchanged.
    pub fn with_serial(&self, change: impl FnOnce(Serial) -> Serial) -> LineAddress {
        let transport = match self.transport {
            Transport::Serial(serial) => Transport::Serial(change(serial)),
            other => other,
        };
        LineAddress { transport, address: self.address.clone() }
    }

    /// Returns a bus with this transport and address, the timeout, and otherwise default settings.
    pub fn bus(&self, timeout: Duration) -> Bus {
        Bus {
            name: "line".to_owned(),
            transport: self.transport,
            address: self.address.clone(),
            tls: None,
            opcua: (self.transport == Transport::OpcUa).then(OpcUa::plain),
            timeout,
            late: self.transport.late(timeout),
            pipeline: 1,
            quirks: Quirks::default(),
            sync: None,
        }
    }

    /// Returns the lines that describe this line in a profile (type, address, serial settings), without the table
    /// header with the bus name.
    pub fn profile_lines(&self) -> String {
        let (kind, key) = match self.transport {
            Transport::Tcp => ("modbus-tcp", "address"),
            Transport::RtuOverTcp => ("modbus-rtu-over-tcp", "address"),
            Transport::Serial(_) => ("modbus-rtu", "port"),
            Transport::Can => ("can", "interface"),
            Transport::OpcUa => ("opcua", "address"),
            Transport::Sysfs => ("sysfs", "address"),
        };
        let serial = match self.transport {
            Transport::Serial(Serial { baud, parity, stop_bits }) => {
                format!("baud = {baud}\nparity = \"{}\"\nstop_bits = {stop_bits}\n", parity.word())
            }
            _ => String::new(),
        };
        format!("type = \"{kind}\"\n{key} = \"{}\"\n{serial}", self.address)
    }
}

/// Text for users, for example `tcp://192.168.0.10:502` or `/dev/ttyUSB0 at 9600 baud 8N1`.
impl fmt::Display for LineAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.transport {
            Transport::Tcp => write!(f, "tcp://{}", self.address),
            Transport::RtuOverTcp => write!(f, "rtu+tcp://{}", self.address),
            Transport::Serial(serial) => write!(f, "{} at {serial}", self.address),
            Transport::Can | Transport::OpcUa | Transport::Sysfs => f.write_str(&self.address),
        }
    }
}

impl FromStr for LineAddress {
    type Err = String;

    /// # Errors
    /// A sentence with the mistake and the correct form.
    fn from_str(text: &str) -> Result<LineAddress, String> {
        const FORMS: &str = "write tcp://192.168.0.10:502, rtu:///dev/ttyUSB0?baud=9600&parity=none, \
                             rtu+tcp://192.168.0.11:4001, opc.tcp://192.168.0.12:4840 or /sys";
        if text.starts_with('/') && !text.starts_with("/dev/") {
            return Ok(LineAddress { transport: Transport::Sysfs, address: text.to_owned() });
        }
        let (scheme, rest) =
            text.split_once("://").ok_or_else(|| format!("`{text}` is no address of a line; {FORMS}"))?;
        match scheme {
            "tcp" => Ok(LineAddress { transport: Transport::Tcp, address: host(rest, Some(PORT))? }),
            "rtu+tcp" => Ok(LineAddress { transport: Transport::RtuOverTcp, address: host(rest, None)? }),
            "rtu" => serial(rest),
            "opc.tcp" => {
                let address = server_url(text).map_err(|(why, help)| format!("{why}; {help}"))?;
                Ok(LineAddress { transport: Transport::OpcUa, address })
            }
            _ => Err(format!("`{scheme}` is no type of line; {FORMS}")),
        }
    }
}

/// Returns host and port. A missing port is replaced by `usual`.
fn host(text: &str, usual: Option<u16>) -> Result<String, String> {
    let text = text.strip_suffix('/').unwrap_or(text);
    if text.is_empty() {
        return Err("the host is missing; write tcp://192.168.0.10:502".to_owned());
    }
    match (host_and_port(text), usual) {
        (Ok((_, Some(port))), _) if port > 0 => Ok(text.to_owned()),
        (Ok((host, None)), Some(usual)) => Ok(format!("{host}:{usual}")),
        (Ok((host, None)), None) => {
            Err(format!("the port of {host} is missing; write rtu+tcp://{host}:4001"))
        }
        (place, _) => {
            let help = place.err().and_then(|why| why.help(usual.unwrap_or(4001), str::to_owned));
            let help = help.unwrap_or_else(|| "write 192.168.0.10:502".to_owned());
            Err(format!("`{text}` is no host and port; {help}"))
        }
    }
}

fn serial(text: &str) -> Result<LineAddress, String> {
    let (path, settings) = text.split_once('?').unwrap_or((text, ""));
    if !path.starts_with('/') {
        return Err(format!("`{path}` is no serial port; write three slashes: rtu:///dev/ttyUSB0"));
    }
    let mut serial = SHIPPED_WITH;
    for setting in settings.split('&').filter(|setting| !setting.is_empty()) {
        let (key, value) = setting.split_once('=').unwrap_or((setting, ""));
        let wrong = || format!("`{setting}`: ");
        match key {
            "baud" => serial.baud = baud(value).map_err(|why| wrong() + &why)?,
            "parity" => serial.parity = value.parse().map_err(|why: String| wrong() + &why)?,
            "stop_bits" => {
                let bits = value.parse().ok().filter(|bits| (1..=2).contains(bits));
                serial.stop_bits = bits.ok_or_else(|| wrong() + "allowed: 1, 2")?;
            }
            _ => {
                return Err(format!(
                    "`{key}` is no setting of a serial port; allowed: baud, parity, stop_bits"
                ));
            }
        }
    }
    Ok(LineAddress { transport: Transport::Serial(serial), address: path.to_owned() })
}

/// Parses the bits per second of a serial port.
///
/// # Errors
/// A sentence with the allowed range.
pub fn baud(text: &str) -> Result<u32, String> {
    let baud = text.trim().parse().ok().filter(|baud| (300..=4_000_000).contains(baud));
    baud.ok_or_else(|| format!("`{text}` is no number of bits per second; allowed: 300 to 4000000"))
}

#[cfg(test)]
mod tests;
