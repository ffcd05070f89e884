//! What a digit display shows beside a corrected position, and where there is none.

use isotherm_core::codec::{Register, Table};

/// The words of a display besides its value. An output to anything else has none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Display {
    /// Written with each value.
    pub beside: Vec<Beside>,
    /// Written where there is no position to correct, or the axis is off.
    pub stale: Option<Stale>,
}

/// One word beside the value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Beside {
    /// A holding register.
    pub register: u16,
    /// The axis follows its first model.
    pub good: u16,
    /// It follows another one.
    pub degraded: u16,
    /// It holds, ramps, is zeroed or off.
    pub fault: u16,
}

/// The text that stands for no value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stale {
    /// For people.
    pub text: String,
    /// Its first holding register.
    pub register: u16,
    /// Its characters.
    pub words: Vec<u16>,
}

/// How an axis does, for a display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// It follows its first model.
    Good,
    /// It follows another one.
    Degraded,
    /// It follows none.
    Fault,
}

impl Beside {
    /// The word for this state.
    pub fn word(self, shown: Shown) -> u16 {
        match shown {
            Shown::Good => self.good,
            Shown::Degraded => self.degraded,
            Shown::Fault => self.fault,
        }
    }
}

impl Stale {
    /// The words of a text, `characters` to a register, filled up with blanks.
    pub fn words(text: &str, characters: u8) -> Vec<u16> {
        let bytes = text.as_bytes();
        if characters == 1 {
            return bytes.iter().map(|byte| u16::from(*byte)).collect();
        }
        let pair = |pair: &[u8]| u16::from_be_bytes([pair[0], pair.get(1).copied().unwrap_or(b' ')]);
        bytes.chunks(2).map(pair).collect()
    }
}

impl Display {
    /// Every register that it writes, besides the value's.
    pub fn registers(&self) -> impl Iterator<Item = Register> + '_ {
        let texts = self.stale.iter().flat_map(|stale| (stale.register..).take(stale.words.len()));
        let words = self.beside.iter().map(|beside| beside.register);
        words.chain(texts).map(|offset| Register { table: Table::Holding, offset })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_lies_in_registers_as_its_display_reads_it() {
        assert_eq!(Stale::words("----", 2), [0x2d2d, 0x2d2d]);
        assert_eq!(Stale::words("-a-", 2), [0x2d61, 0x2d20]);
        assert_eq!(Stale::words("--", 1), [0x2d, 0x2d]);
    }
}
