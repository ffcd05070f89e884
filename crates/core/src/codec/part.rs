//! Part of a register: adjacent bits of one or two registers that hold a separate value.
//!
//! Some devices put a value and its status into one register. An example is a temperature in bits 4 to 15, and flags in
//! bits 0 to 3. Bit 0 is the least significant bit of the whole value, after word order and byte order were applied.

use std::fmt;

/// Adjacent bits of one or two registers, which hold one value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Part {
    first: u8,
    last: u8,
    whole: Whole,
}

/// Type of the registers from which a part is taken. `I16` and `I32` mean that the part itself has a sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Whole {
    /// One register, with an unsigned part.
    U16,
    /// One register, with a part in two's complement.
    I16,
    /// Two registers, with an unsigned part.
    U32,
    /// Two registers, with a part in two's complement.
    I32,
}

impl Whole {
    /// Returns the number of bits of the registers.
    pub const fn width(self) -> u8 {
        match self {
            Whole::U16 | Whole::I16 => 16,
            Whole::U32 | Whole::I32 => 32,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Whole::U16 => "u16",
            Whole::I16 => "i16",
            Whole::U32 => "u32",
            Whole::I32 => "i32",
        }
    }
}

impl Part {
    /// Creates the part from bit `first` to bit `last`. Returns `None` if it has fewer than two bits, or if it ends
    /// beyond the registers.
    pub const fn new(first: u8, last: u8, whole: Whole) -> Option<Part> {
        if first < last && last < whole.width() { Some(Part { first, last, whole }) } else { None }
    }

    /// Returns the number of bits of the part.
    pub const fn length(self) -> u8 {
        self.last - self.first + 1
    }

    /// Returns the number of registers from which the part is taken.
    pub const fn registers(self) -> u16 {
        (self.whole.width() / 16) as u16
    }

    /// Returns the type of the registers, with the sign of the part, as the profile names it.
    pub const fn type_name(self) -> &'static str {
        self.whole.name()
    }

    /// Returns the smallest and the largest raw count of the part.
    pub const fn range(self) -> (i128, i128) {
        let length = self.length();
        match self.whole {
            Whole::U16 | Whole::U32 => (0, (1 << length) - 1),
            Whole::I16 | Whole::I32 => (-(1 << (length - 1)), (1 << (length - 1)) - 1),
        }
    }

    /// Returns a mask of the registers: the bits of the part are one, all other bits are zero.
    pub const fn mask(self) -> u64 {
        ((1 << self.length()) - 1) << self.first
    }

    /// Extracts the part from the bits of the registers, and returns its raw count.
    pub(super) fn count(self, bits: u64) -> i128 {
        let beyond = 64 - u32::from(self.length());
        let top = (bits & self.mask()) >> self.first << beyond;
        match self.whole {
            Whole::U16 | Whole::U32 => i128::from(top >> beyond),
            // Shifting arithmetically right extends the sign bit.
            Whole::I16 | Whole::I32 => i128::from(top.cast_signed() >> beyond),
        }
    }

    /// Shifts the lowest bits of this count to the position of the part in the registers. All other bits of
    /// the result are zero.
    pub(super) const fn placed(self, count: u64) -> u64 {
        count << self.first & self.mask()
    }
}

/// Formats the first and the last bit, for example as `4-7`.
impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{}", self.first, self.last)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::codec::{DataType, Encoding, Scale, WordOrder};

    fn encoding(part: Part) -> Encoding {
        Encoding {
            data_type: DataType::Part(part),
            word_order: WordOrder::MswFirst,
            byte_swap: false,
            scale: Scale::ONE,
            offset: 0.0,
            bias: 0,
            bad: Vec::new(),
        }
    }

    #[test]
    fn a_part_of_a_register_is_read_alone() {
        let read = |first, last, whole, registers: &[u16]| {
            encoding(Part::new(first, last, whole).unwrap()).decode(registers)
        };
        assert_eq!(read(4, 7, Whole::U16, &[0xabcd]), Ok(12.0));
        assert_eq!(read(0, 3, Whole::U16, &[0xabcd]), Ok(13.0));
        assert_eq!(read(4, 15, Whole::U16, &[0xff80]), Ok(4088.0));
        assert_eq!(read(4, 15, Whole::I16, &[0xff80]), Ok(-8.0));
        assert_eq!(read(0, 15, Whole::I16, &[0xffff]), Ok(-1.0));
        assert_eq!(read(8, 27, Whole::U32, &[0x1234, 0x5678]), Ok(f64::from(0x23456)));
        assert_eq!(read(8, 31, Whole::I32, &[0xffff, 0xfe00]), Ok(-2.0));
    }

    #[test]
    fn a_part_has_at_least_two_bits_and_ends_in_its_registers() {
        assert!(Part::new(4, 4, Whole::U16).is_none() && Part::new(7, 4, Whole::U16).is_none());
        assert!(Part::new(4, 16, Whole::U16).is_none() && Part::new(4, 16, Whole::U32).is_some());
        assert!(Part::new(0, 31, Whole::I32).is_some() && Part::new(0, 32, Whole::I32).is_none());
    }

    #[test]
    fn byte_order_and_word_order_apply_before_the_part_is_taken() {
        let part = encoding(Part::new(8, 27, Whole::U32).unwrap());
        let swapped = Encoding { word_order: WordOrder::LswFirst, byte_swap: true, ..part.clone() };
        assert_eq!(part.decode(&[0x1234, 0x5678]), swapped.decode(&[0x7856, 0x3412]));
        assert_eq!(part.occupied().registers(), [0x0fff, 0xff00]);
        assert_eq!(swapped.occupied().registers(), [0x00ff, 0xff0f]);
    }

    proptest! {
        #[test]
        fn a_count_that_fits_is_read_as_it_was_placed(first in 0u8..31, length in 2u8..=32, is_signed: bool, count: u32, around: u32) {
            let whole = if is_signed { Whole::I32 } else { Whole::U32 };
            let Some(part) = Part::new(first, first + length - 1, whole) else { return Ok(()) };
            let (low, high) = part.range();
            let count = low + i128::from(count) % (high - low + 1);
            let bits = DataType::Part(part).bits_of(count) | u64::from(around) & !part.mask();
            prop_assert_eq!(part.count(bits), count);
        }
    }
}
