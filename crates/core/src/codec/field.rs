//! Fields of CAN frames. A field is one value. Three properties define it: the frames that contain the value,
//! the bits of the value in these frames, and conditions on a multiplexer. A multiplexer is a value that
//! selects which fields a frame contains.

use std::fmt;

use super::{BitField, CanMatch, Encoded};
use crate::reading::Reason;

/// Value in CAN frames: the frames that contain it, and its bits in these frames.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Field {
    /// Frames that contain the value.
    pub frames: CanMatch,
    /// Whether the frames are CAN FD frames. A classic frame of sufficient length is accepted too.
    pub is_fd: bool,
    /// Bits of the value in the frame.
    pub bits: BitField,
    /// Multiplexer conditions on the frame. A frame contains the field only if all conditions are true.
    pub multiplex: Vec<Selector>,
}

/// Multiplexer: a value in a frame that selects which fields the frame contains.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Selector {
    /// Bits of the multiplexer in the frame.
    pub bits: BitField,
    /// Ranges of values, smallest and largest, for which the frame contains the field.
    pub values: Vec<(u64, u64)>,
}

impl Field {
    /// Reads the value from a frame as registers, most significant register first. `None` if the frame does not contain
    /// the field; an error if the frame is too short.
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

/// Formats the field, for example as `0x185, 16 bits from 0 up (Intel), signed`.
impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}", self.frames, self.bits)?;
        self.multiplex.iter().try_for_each(|selector| write!(f, ", {selector}"))
    }
}

/// Formats the condition, for example as `where 4 bits from 0 up (Intel), unsigned is 2 or 5 to 7`.
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
