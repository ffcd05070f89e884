//! Bits of a CAN frame ↔ numbers: any first bit, any length up to 64, in both byte orders.
//!
//! Bits are numbered as in a DBC file: bit `n` is bit `n % 8` of byte `n / 8`, 0 the least significant. An Intel value
//! begins at its least significant bit and runs upwards; a Motorola value begins at its most significant bit, runs down
//! to bit 0 of that byte and goes on at bit 7 of the next.

use std::fmt;

use super::{DataType, Encoded};
use crate::reading::Reason;

/// Which end of a value comes first in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ByteOrder {
    /// The least significant bit; `@1` of a DBC file.
    Intel,
    /// The most significant bit; `@0` of a DBC file.
    Motorola,
}

/// What the bits of a value are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BitKind {
    /// A whole number from zero.
    Unsigned,
    /// A whole number in two's complement.
    Signed,
    /// IEEE 754, 32 or 64 bits.
    Float,
}

/// A value inside a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BitField {
    start: u16,
    length: u8,
    order: ByteOrder,
    kind: BitKind,
}

impl BitField {
    /// Most bytes of a frame, CAN FD.
    pub const LONGEST_FRAME: usize = 64;

    /// A field; `None` where its length is none of its kind's (1 to 64; a float has 32 or 64) or it ends outside of 64
    /// bytes.
    pub fn new(start: u16, length: u16, order: ByteOrder, kind: BitKind) -> Option<BitField> {
        let fits_kind = match kind {
            BitKind::Float => matches!(length, 32 | 64),
            BitKind::Unsigned | BitKind::Signed => matches!(length, 1..=64),
        };
        let field = BitField { start, length: u8::try_from(length).ok()?, order, kind };
        (fits_kind && field.bytes() <= BitField::LONGEST_FRAME).then_some(field)
    }

    /// How many bytes a frame must have to hold it.
    pub fn bytes(&self) -> usize {
        let (start, length) = (usize::from(self.start), usize::from(self.length));
        match self.order {
            ByteOrder::Intel => (start + length).div_ceil(8),
            // What lies left of the first bit in its byte counts as if it were taken.
            ByteOrder::Motorola => start / 8 + (7 - start % 8 + length).div_ceil(8),
        }
    }

    /// The type of its value: the usual word where it has one, else as many bits as it has.
    pub fn data_type(&self) -> DataType {
        match (self.kind, self.length) {
            (BitKind::Float, 32) => DataType::F32,
            (BitKind::Float, _) => DataType::F64,
            (BitKind::Unsigned, 1) => DataType::Bool,
            (BitKind::Unsigned, length) => DataType::unsigned(length),
            (BitKind::Signed, length) => DataType::signed(length),
        }
    }

    /// Its bits in a frame, the least significant first; longer frames are fine.
    ///
    /// # Errors
    /// The frame is too short to hold it.
    pub fn bits(&self, frame: &[u8]) -> Result<u64, Reason> {
        if frame.len() < self.bytes() {
            return Err(Reason::ShortFrame);
        }
        Ok(self.places().fold(0, |bits, (rank, byte, bit)| bits | u64::from(frame[byte] >> bit & 1) << rank))
    }

    /// Its value in a frame as registers, the most significant first, for an [`Encoding`](super::Encoding) of its
    /// [`data_type`](BitField::data_type).
    ///
    /// # Errors
    /// The frame is too short to hold it.
    pub fn registers(&self, frame: &[u8]) -> Result<Encoded, Reason> {
        Ok(self.data_type().encode(self.bits(frame)?))
    }

    /// Puts bits into a frame, of which it has as many as the field; nothing else in the frame changes.
    ///
    /// # Errors
    /// The frame is too short to hold it.
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

    /// Whether the two share a bit.
    pub fn overlaps(&self, other: &BitField) -> bool {
        self.places().any(|(_, byte, bit)| other.places().any(|(_, b, i)| (byte, bit) == (b, i)))
    }

    /// Each of its bits: its rank in the value, its byte, its place in there.
    fn places(&self) -> impl Iterator<Item = (usize, usize, usize)> {
        let (start, length, order) = (usize::from(self.start), usize::from(self.length), self.order);
        (0..length).map(move |step| match order {
            ByteOrder::Intel => (step, (start + step) / 8, (start + step) % 8),
            ByteOrder::Motorola => {
                // From the left end of the first byte.
                let from_left = start / 8 * 8 + 7 - start % 8 + step;
                (length - 1 - step, from_left / 8, 7 - from_left % 8)
            }
        })
    }
}

/// `22 bits from 18 up (Intel), unsigned`.
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
