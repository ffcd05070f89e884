//! Settings of a serial line, and the time that transfers take on this line.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

/// Highest baud rate at which the silence between frames depends on the character time. Above this rate, the silence is
/// fixed.
const FASTEST_BY_CHARACTERS: u32 = 19_200;

/// Settings of a serial port. There are always eight data bits, because Modbus RTU allows nothing else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Serial {
    /// Baud rate in bits per second.
    pub baud: u32,
    /// Parity bit of each character.
    pub parity: Parity,
    /// Stop bits, 1 or 2.
    pub stop_bits: u8,
}

/// Parity bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "ParityWord", description = "")]
pub enum Parity {
    /// No parity bit.
    #[default]
    None,
    /// Even parity.
    Even,
    /// Odd parity.
    Odd,
}

impl Parity {
    /// Returns the word for this parity in a profile, for example `even`.
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
    /// The text is not a parity. The error lists the allowed values.
    fn from_str(text: &str) -> Result<Parity, String> {
        let known = [Parity::None, Parity::Even, Parity::Odd].into_iter().find(|known| known.word() == text);
        known.ok_or_else(|| format!("`{text}` is not a parity; allowed: none, even, odd"))
    }
}

impl Serial {
    /// Returns the duration of one character: start bit, eight data bits, parity bit, stop bits.
    pub fn character(&self) -> Duration {
        let bits = 1 + 8 + u32::from(self.parity != Parity::None) + u32::from(self.stop_bits);
        Duration::from_secs(1) * bits / self.baud.max(1)
    }

    /// Returns the silence between two frames (Modbus over Serial Line V1.02, 2.5.1.1). This is the duration of 3.5
    /// characters of eleven bits. Above 19,200 baud it is 1.75 ms.
    pub fn silence(&self) -> Duration {
        if self.baud > FASTEST_BY_CHARACTERS {
            return Duration::from_micros(1750);
        }
        Duration::from_secs(1) * 77 / (2 * self.baud.max(1))
    }

    /// Returns settings with a reduced baud rate, so that times calculated for RTU frames are long enough for
    /// ASCII frames. An ASCII frame has two characters for each byte of the RTU frame, and one more
    /// character.
    pub const fn for_ascii(self) -> Serial {
        Serial { baud: self.baud / 5 * 2 + 1, ..self }
    }

    /// Returns the duration of transferring this number of bytes.
    pub fn bytes(&self, count: usize) -> Duration {
        self.character() * u32::try_from(count).unwrap_or(u32::MAX)
    }

    /// Returns the time for which one request and its answer occupy the line. The arguments are the lengths of the
    /// frames in bytes, with unit and checksum. The time until the device begins its answer is not included.
    pub fn exchange(&self, request: usize, answer: usize) -> Duration {
        self.bytes(request + answer) + 2 * self.silence()
    }
}

impl fmt::Display for Serial {
    /// Formats the settings, for example as `9600 baud 8N1`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Even => 'E',
            Parity::Odd => 'O',
        };
        write!(f, "{} baud 8{parity}{}", self.baud, self.stop_bits)
    }
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
        for bytes in [8, 21, 255] {
            let characters = serial(9600, Parity::Even, 1).bytes(2 * bytes + 1);
            assert!(serial(9600, Parity::Even, 1).for_ascii().bytes(bytes) >= characters, "{bytes}");
        }
    }
}
