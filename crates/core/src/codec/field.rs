//! A value inside CAN frames: in which, where in there, and what must stand beside it.

use std::fmt;

use super::{BitField, CanMatch, Encoded};
use crate::reading::Reason;

/// A value inside frames.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Field {
    /// The frames it is in.
    pub frames: CanMatch,
    /// They are CAN FD frames; a classic one that is long enough does as well.
    pub is_fd: bool,
    /// Where in there.
    pub bits: BitField,
    /// Only in frames for which all of these hold.
    pub multiplex: Vec<Selector>,
}

/// A value that says what else is in a frame.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Selector {
    /// Where it is.
    pub bits: BitField,
    /// The smallest and the largest of the values at which the frame holds the field.
    pub values: Vec<(u64, u64)>,
}

impl Field {
    /// Its value in a frame as registers, the most significant first; `None` where the frame holds another value there.
    pub fn read(&self, frame: &[u8]) -> Option<Result<Encoded, Reason>> {
        for selector in &self.multiplex {
            match selector.bits.bits(frame) {
                Ok(value) if selector.selects(value) => {}
                Ok(_) => return None,
                Err(short) => return Some(Err(short)),
            }
        }
        Some(self.bits.registers(frame))
    }
}

impl Selector {
    fn selects(&self, value: u64) -> bool {
        self.values.iter().any(|(from, to)| (*from..=*to).contains(&value))
    }
}

/// `0x185, 16 bits from 0 up (Intel), signed`.
impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}", self.frames, self.bits)?;
        self.multiplex.iter().try_for_each(|selector| write!(f, ", {selector}"))
    }
}

/// `where bits 0..3 are 2 or 5 to 7`.
impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = |(from, to): &(u64, u64)| match from == to {
            true => from.to_string(),
            false => format!("{from} to {to}"),
        };
        let values: Vec<String> = self.values.iter().map(value).collect();
        write!(f, "where {} is {}", self.bits, values.join(" or "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::{BitKind, ByteOrder, CanId};

    fn bits(start: u16, length: u16) -> BitField {
        BitField::new(start, length, ByteOrder::Intel, BitKind::Unsigned).unwrap()
    }

    #[test]
    fn a_multiplexed_value_is_only_in_the_frames_that_say_so() {
        let frames = CanMatch::exactly(CanId::standard(0x100).unwrap());
        let selector = Selector { bits: bits(0, 4), values: vec![(2, 2), (5, 7)] };
        let field = Field { frames, is_fd: false, bits: bits(8, 16), multiplex: vec![selector] };
        assert_eq!(field.read(&[0xf1, 0x34, 0x12]), None);
        for chosen in [0xf2, 0x05, 0x07] {
            assert_eq!(field.read(&[chosen, 0x34, 0x12]).unwrap().unwrap().registers(), [0x1234]);
        }
        assert_eq!(field.read(&[2, 0x34]), Some(Err(Reason::ShortFrame)));
        assert_eq!(field.read(&[]), Some(Err(Reason::ShortFrame)));
    }
}
