//! Location of a value in registers: whole registers, one bit, or several adjacent bits.

use std::fmt;
use std::str::FromStr;

use crate::tables::KeyContext;
use isotherm_core::codec::{DataType, Part, Register, Whole};

/// Highest bit number of one register. The constant `LAST_OF_TWO` is the highest bit number of two registers.
const LAST_OF_ONE: u8 = 15;
const LAST_OF_TWO: u8 = 31;

/// Register of a value, and those bits of the register that contain the value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// First register, coil or discrete input.
    pub address: Register,
    /// Bits of the register that contain the value.
    pub bits: Bits,
}

/// Bits of a register that contain the value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bits {
    /// Whole registers, a coil or a discrete input.
    All,
    /// One bit, 0 to 15.
    One(u8),
    /// Adjacent bits: the numbers of the first and the last bit. In two registers, bits have the numbers 0 to 31.
    Range(u8, u8),
}

impl Cell {
    /// Formats the address in Modicon notation, for example as `30017.4-7`.
    pub fn modicon(self) -> String {
        self.with_bits(&self.address.modicon())
    }

    /// Appends the bits to the notation of the register.
    fn with_bits(self, register: &str) -> String {
        match self.bits {
            Bits::All => register.to_owned(),
            Bits::One(bit) => format!("{register}.{bit}"),
            Bits::Range(first, last) => format!("{register}.{first}-{last}"),
        }
    }

    /// Resolves the type of a value that consists of several bits. `kind` is the type that the profile states
    /// at the key `type`. By default the bits are unsigned, and in one register. Reports a type that is not
    /// possible, or bits outside of the type, and returns `None`.
    pub(crate) fn part(
        at: &KeyContext<'_>,
        (first, last): (u8, u8),
        kind: Option<DataType>,
    ) -> Option<DataType> {
        let whole = match kind {
            None | Some(DataType::U16) => Whole::U16,
            Some(DataType::I16) => Whole::I16,
            Some(DataType::U32) => Whole::U32,
            Some(DataType::I32) => Whole::I32,
            Some(other) => {
                let message =
                    format!("the type {} is not possible for several bits of a register", other.name());
                let help = "allowed: u16 and i16 for bits of one register, u32 and i32 for bits of two \
                            registers; i16 and i32 are signed";
                return at.key("type").reject(message, help);
            }
        };
        let part = Part::new(first, last, whole).map(DataType::Part);
        if part.is_none() {
            let message = format!("bit {last} is beyond the {} bits of the register", whole.width());
            let help = "write type = \"u32\" or \"i32\" for bits of two registers";
            at.key("register").invalid(message, help);
        }
        part
    }
}

impl FromStr for Cell {
    type Err = String;

    /// Parses `coil:20`, `input:16`, `input:16.0` or `input:16.4-7`.
    ///
    /// # Errors
    /// A sentence with the allowed notations.
    fn from_str(text: &str) -> Result<Cell, String> {
        let (register, bits) = match text.split_once('.') {
            Some((register, bits)) => (register, Some(bits.trim())),
            None => (text, None),
        };
        let address: Register = register.parse()?;
        let Some(bits) = bits else { return Ok(Cell { address, bits: Bits::All }) };
        if address.table.is_bits() {
            return Err(format!("{address} is one bit already: write it without `.{bits}`"));
        }
        let number = |text: &str, most: u8| text.trim().parse::<u8>().ok().filter(|bit| *bit <= most);
        let bits = match bits.split_once('-') {
            None => {
                let none = || format!("`{bits}` is not a bit of a register; allowed: 0 to {LAST_OF_ONE}");
                Bits::One(number(bits, LAST_OF_ONE).ok_or_else(none)?)
            }
            Some((first, last)) => match (number(first, LAST_OF_TWO), number(last, LAST_OF_TWO)) {
                (Some(first), Some(last)) if first < last => Bits::Range(first, last),
                (Some(first), Some(last)) => {
                    return Err(format!(
                        "bit {first} is not below bit {last}; write the smaller bit first, as `4-7`"
                    ));
                }
                _ => {
                    return Err(format!(
                        "`{bits}` are not bits of a register; allowed: 0 to {LAST_OF_ONE}, and 0 to \
                         {LAST_OF_TWO} of two registers, as `4-7`"
                    ));
                }
            },
        };
        Ok(Cell { address, bits })
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.with_bits(&self.address.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_is_a_register_a_bit_or_several_bits() {
        let bits = |text: &str| text.parse::<Cell>().unwrap().bits;
        assert_eq!((bits("holding:7"), bits("holding:7.3")), (Bits::All, Bits::One(3)));
        assert_eq!((bits("holding:7.4-7"), bits("holding:7.0-31")), (Bits::Range(4, 7), Bits::Range(0, 31)));
        let part: Cell = "40008. 4 - 7".parse().unwrap();
        assert_eq!((part.to_string(), part.modicon()), ("holding:7.4-7".to_owned(), "40008.4-7".to_owned()));
        for (text, words) in [
            ("coil:2.0-3", "one bit already"),
            ("input:2.16", "0 to 15"),
            ("input:2.", "0 to 15"),
            ("input:2.7-4", "smaller bit first"),
            ("input:2.4-4", "smaller bit first"),
            ("input:2.4-32", "0 to 31"),
            ("input:2.-7", "0 to 31"),
            ("input:2.4-", "0 to 31"),
        ] {
            let why = text.parse::<Cell>().unwrap_err();
            assert!(why.contains(words), "{text}: {why}");
        }
    }
}
