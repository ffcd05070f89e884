//! What is read of a device before anything that depends on it is armed.

use std::fmt;

use isotherm_core::codec::{Address, DataType, Encoding};
use isotherm_core::reading::Reason;

/// A register or an object that must read a certain value: a type code, a data format, whether a broken wire is looked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Expected {
    /// Its first register or its bit; its object.
    pub address: Address,
    /// How it is read; scale 1.
    pub encoding: Encoding,
    /// What it must read.
    pub equals: i64,
    /// What that is, for people.
    pub what: String,
    /// What to do where it reads something else.
    pub remedy: String,
}

impl Expected {
    /// What is wrong with these registers, in words; `None` where they are as they must be.
    pub fn mismatch(&self, words: &[u16]) -> Option<String> {
        let found = match self.encoding.counts(words) {
            Some(counts) if counts.0 == self.equals => return None,
            Some(counts) => counts.to_string(),
            None => Reason::BadReply.to_string(),
        };
        Some(format!("{self} reads {found} instead of {} ({}){}", self.equals, self.what, self.advice()))
    }

    /// Why it could not be checked, in words.
    pub fn unreadable(&self, why: impl fmt::Display) -> String {
        format!("{self} cannot be read: {why} ({}){}", self.what, self.advice())
    }

    fn advice(&self) -> String {
        if self.remedy.is_empty() { String::new() } else { format!(": {}", self.remedy) }
    }
}

impl fmt::Display for Expected {
    /// `coil:268 (00269)`, `holding:116.5 (40117.5)`, `object 6110:01`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.address, self.encoding.data_type) {
            (Address::Modbus(register), DataType::Bit(bit)) => {
                write!(f, "{register}.{bit} ({}.{bit})", register.modicon())
            }
            (address, _) => write!(f, "{address}"),
        }
    }
}
