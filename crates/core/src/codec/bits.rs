//! Conversion between bits of a CAN frame and numbers: any first bit, up to 64 bits, both byte orders.
//!
//! Bits are numbered as in a DBC file: bit `n` is bit `n % 8` of byte `n / 8`, and bit 0 is the least significant. An
//! Intel value begins at its least significant bit and runs upwards. A Motorola value begins at its most significant
//! bit and runs down to bit 0 of that byte. It continues at bit 7 of the next byte.

use std::fmt;

use super::{DataType, Encoded};
use crate::reading::Reason;

/// Byte order of a value in a CAN frame: which end of the value comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ByteOrder {
    /// Least significant byte first; `@1` in a DBC file.
    Intel,
    /// Most significant byte first; `@0` in a DBC file.
    Motorola,
}

/// Interpretation of the bits of a value in a CAN frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BitKind {
    /// Unsigned integer.
    Unsigned,
    /// Signed integer in two's complement.
    Signed,
    /// IEEE 754 float of 32 or 64 bits.
    Float,
}

/// Position and interpretation of a value in a CAN frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BitField {
    start: u16,
    length: u8,
    order: ByteOrder,
    kind: BitKind,
}

impl BitField {
    /// Largest length of a frame in bytes (CAN FD).
    pub const LONGEST_FRAME: usize = 64;

    /// Creates a field. Returns `None` if the length is invalid for the kind, or if the field ends after byte 64.
    /// Integers have 1 to 64 bits, floats 32 or 64.
    pub fn new(start: u16, length: u16, order: ByteOrder, kind: BitKind) -> Option<BitField> {
        let fits_kind = match kind {
            BitKind::Float => matches!(length, 32 | 64),
            BitKind::Unsigned | BitKind::Signed => matches!(length, 1..=64),
        };
        let field = BitField { start, length: u8::try_from(length).ok()?, order, kind };
        (fits_kind && field.bytes() <= BitField::LONGEST_FRAME).then_some(field)
    }

    /// Returns the number of bytes that a frame must have to contain the field.
    pub fn bytes(&self) -> usize {
        let (start, length) = (usize::from(self.start), usize::from(self.length));
        match self.order {
            ByteOrder::Intel => (start + length).div_ceil(8),
            // Bits to the left of the first bit in its byte count as used.
            ByteOrder::Motorola => start / 8 + (7 - start % 8 + length).div_ceil(8),
        }
    }

    /// Returns the type of the value: a named type of this width (for example `u16`), or else a type with exactly this
    /// number of bits.
    pub fn data_type(&self) -> DataType {
        match (self.kind, self.length) {
            (BitKind::Float, 32) => DataType::F32,
            (BitKind::Float, _) => DataType::F64,
            (BitKind::Unsigned, 1) => DataType::Bool,
            (BitKind::Unsigned, length) => DataType::unsigned(length),
            (BitKind::Signed, length) => DataType::signed(length),
        }
    }

    /// Reads the bits from a frame, least significant bit first. The frame may be longer than the field requires.
    ///
    /// # Errors
    /// [`Reason::ShortFrame`] if the frame is too short for the field.
    pub fn bits(&self, frame: &[u8]) -> Result<u64, Reason> {
        if frame.len() < self.bytes() {
            return Err(Reason::ShortFrame);
        }
        Ok(self.places().fold(0, |bits, (rank, byte, bit)| bits | u64::from(frame[byte] >> bit & 1) << rank))
    }

    /// Reads the field from a frame as registers, most significant register first. Decode the registers with an
    /// [`Encoding`](super::Encoding) of the field's [`data_type`](BitField::data_type).
    ///
    /// # Errors
    /// [`Reason::ShortFrame`] if the frame is too short for the field.
    pub fn registers(&self, frame: &[u8]) -> Result<Encoded, Reason> {
        Ok(self.data_type().encode(self.bits(frame)?))
    }

    /// Writes the lowest bits of `bits` into the field of a frame. The other bits of the frame do not change.
    ///
    /// # Errors
    /// [`Reason::ShortFrame`] if the frame is too short for the field.
    pub fn insert(&self, frame: &mut [u8], bits: u64) -> Result<(), Reason> {
        if frame.len() < self.bytes() {
            return Err(Reason::ShortFrame);
        }
        for (rank, byte, bit) in self.places() {
            let ones = u8::from(bits >> rank & 1 == 1);
            frame[byte] = frame[byte] & !(1 << bit) | ones << bit;
        }
        Ok(())
    }

    /// Returns whether the two fields have a bit in common.
    pub fn overlaps(&self, other: &BitField) -> bool {
        self.places().any(|(_, byte, bit)| other.places().any(|(_, b, i)| (byte, bit) == (b, i)))
    }

    /// Returns the bits of the field. Each item is the rank of a bit in the value (0 is the least significant), the
    /// byte of the frame, and the position of the bit in this byte.
    fn places(&self) -> impl Iterator<Item = (usize, usize, usize)> {
        let (start, length, order) = (usize::from(self.start), usize::from(self.length), self.order);
        (0..length).map(move |step| match order {
            ByteOrder::Intel => (step, (start + step) / 8, (start + step) % 8),
            ByteOrder::Motorola => {
                // Bits are counted here from the most significant bit of byte 0.
                let from_left = start / 8 * 8 + 7 - start % 8 + step;
                (length - 1 - step, from_left / 8, 7 - from_left % 8)
            }
        })
    }
}

/// Formats the field, for example as `22 bits from 18 up (Intel), unsigned`.
impl fmt::Display for BitField {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let BitField { start, length, .. } = *self;
        let kind = match self.kind {
            BitKind::Unsigned => "unsigned",
            BitKind::Signed => "signed",
            BitKind::Float => "float",
        };
        match (self.order, length) {
            (_, 1) => write!(f, "bit {start}"),
            (ByteOrder::Intel, _) => write!(f, "{length} bits from {start} up (Intel), {kind}"),
            (ByteOrder::Motorola, _) => write!(f, "{length} bits from {start} down (Motorola), {kind}"),
        }
    }
}

#[cfg(test)]
mod tests;
