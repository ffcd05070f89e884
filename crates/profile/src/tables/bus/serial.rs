//! A serial line: its settings, and how long things take on it.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::RawBus;
use crate::tables::At;

/// Bits per second up to which silence is measured in characters; above, it is a fixed time.
const FASTEST_BY_CHARACTERS: u32 = 19_200;

/// The settings of a serial port. Always eight data bits: Modbus RTU knows nothing else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Serial {
    /// Bits per second.
    pub baud: u32,
    /// The bit that checks the eight before it.
    pub parity: Parity,
    /// 1 or 2.
    pub stop_bits: u8,
}

/// The bit that checks the eight before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "ParityWord", description = "")]
pub enum Parity {
    /// There is none.
    #[default]
    None,
    /// An even number of ones.
    Even,
    /// An odd number of ones.
    Odd,
}

impl Parity {
    /// Its word in a profile.
    pub fn word(self) -> &'static str {
        match self {
            Parity::None => "none",
            Parity::Even => "even",
            Parity::Odd => "odd",
        }
    }
}

impl FromStr for Parity {
    type Err = String;

    /// # Errors
    /// A sentence that says what is allowed.
    fn from_str(text: &str) -> Result<Parity, String> {
        let known = [Parity::None, Parity::Even, Parity::Odd].into_iter().find(|known| known.word() == text);
        known.ok_or_else(|| format!("`{text}` is no parity; allowed: none, even, odd"))
    }
}

impl Serial {
    /// Time of one character: start, eight data bits, parity, stop bits.
    pub fn character(&self) -> Duration {
        let bits = 1 + 8 + u32::from(self.parity != Parity::None) + u32::from(self.stop_bits);
        Duration::from_secs(1) * bits / self.baud.max(1)
    }

    /// Silence between two frames: 3.5 characters of eleven bits, and 1.75 ms above 19,200 baud (Modbus over Serial Line
    /// V1.02, 2.5.1.1).
    pub fn silence(&self) -> Duration {
        if self.baud > FASTEST_BY_CHARACTERS {
            return Duration::from_micros(1750);
        }
        Duration::from_secs(1) * 77 / (2 * self.baud.max(1))
    }

    /// How long this many bytes are under way.
    pub fn bytes(&self, count: usize) -> Duration {
        self.character() * u32::try_from(count).unwrap_or(u32::MAX)
    }

    /// How long one question and its answer occupy the line, bytes of the frames with unit and checksum; the device's own
    /// time to think comes on top.
    pub fn exchange(&self, request: usize, answer: usize) -> Duration {
        self.bytes(request + answer) + 2 * self.silence()
    }
}

impl fmt::Display for Serial {
    /// `9600 baud 8N1`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Even => 'E',
            Parity::Odd => 'O',
        };
        write!(f, "{} baud 8{parity}{}", self.baud, self.stop_bits)
    }
}

/// The settings of a modbus-rtu line.
pub(super) fn settings(raw: &RawBus, at: &At<'_>) -> Option<Serial> {
    if raw.baud.is_none() {
        let help = "write what the devices are set to: 9600 and 19200 are usual";
        at.key("baud").missing("`baud` is missing: how fast is the line?", help);
    }
    let (parity, stop_bits) = (raw.parity.unwrap_or_default(), raw.stop_bits.unwrap_or(1));
    Some(Serial { baud: raw.baud?, parity, stop_bits })
}

/// The port of a modbus-rtu line.
pub(super) fn port(raw: &RawBus, at: &At<'_>) -> Option<String> {
    let at = at.key("port");
    let Some(port) = &raw.port else {
        let help =
            "write the port's path; `ls /dev/serial/by-id` shows those that keep their name when replugged";
        at.missing("`port` is missing: where is the line?", help);
        return None;
    };
    if !port.starts_with('/') {
        let help = format!("write the whole path, as \"/dev/{port}\" or one of /dev/serial/by-id");
        at.wrong(format!("`{port}` is no path of a port"), help);
        return None;
    }
    if ["/dev/ttyUSB", "/dev/ttyACM"].iter().any(|numbered| port.starts_with(numbered)) {
        let message = format!("`{port}` may be another adapter after a replug or a restart");
        at.warn(message, "use its name below /dev/serial/by-id");
    }
    Some(port.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn serial(baud: u32, parity: Parity, stop_bits: u8) -> Serial {
        Serial { baud, parity, stop_bits }
    }

    #[test]
    fn the_times_are_those_of_the_specification() {
        let slow = serial(9600, Parity::None, 1);
        assert_eq!(slow.character().as_micros(), 1041);
        assert_eq!(slow.silence().as_micros(), 4010);
        assert_eq!(serial(9600, Parity::Even, 1).character().as_micros(), 1145);
        assert_eq!(serial(19_200, Parity::Even, 1).silence().as_micros(), 2005);
        assert_eq!(serial(38_400, Parity::Even, 1).silence().as_micros(), 1750);
        assert_eq!(slow.exchange(8, 21).as_micros(), 38_229);
    }
}
