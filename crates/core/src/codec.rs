//! Conversion between registers or frame bits and numbers: addresses, types, word order, scale, sentinels, saturation.
//!
//! A value occupies one to four 16-bit registers, or one coil. Integers are compared with their sentinels *before*
//! scaling. Some modules send −512 for an open circuit, which would scale to a plausible −32.0 °C.

use std::fmt;

use crate::quantity::Counts;
use crate::reading::Reason;

mod address;
mod bits;
mod can;
mod checksum;
mod control_view;
mod counter;
mod data_type;
mod field;
mod node;
mod object;
mod pc_sensor;
mod scale;

pub use address::{Address, Register, Table};
pub use bits::{BitField, BitKind, ByteOrder};
pub use can::{CanId, CanMatch, Frame};
pub use checksum::checksum;
pub use control_view::{ControlView, Inadmissible};
pub use counter::{Counter, Motion, Tracked};
pub use data_type::DataType;
pub use field::{Field, Selector};
pub use node::{Identifier, Namespace, Node, NodeId, Scalar};
pub use object::{Entry, Object};
pub use pc_sensor::{Channel, PcSensor};
pub use scale::Scale;

use data_type::integer_of;

/// Order of the registers of a value that occupies several registers. There is no default, because devices differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WordOrder {
    /// The most significant word at the lowest address.
    MswFirst,
    /// The least significant word at the lowest address.
    LswFirst,
}

/// Conversion between registers and an engineering value: `value = raw · scale + offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoding {
    /// Type of the raw value.
    pub data_type: DataType,
    /// Order of the registers. It has no effect on a value of one register.
    pub word_order: WordOrder,
    /// Whether the two bytes of each register are exchanged.
    pub byte_swap: bool,
    /// Engineering units per count.
    pub scale: Scale,
    /// Engineering value of a raw count of zero.
    pub offset: f64,
    /// Number that is added to a raw count before it is sent. Only outputs use a bias; LinuxCNC requires 32768.
    pub bias: i64,
    /// Raw values that mean "no measurement".
    pub bad: Vec<Sentinel>,
}

/// Raw value that a device sends when it has no measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sentinel {
    /// The raw count, before scaling.
    pub raw: i64,
    /// Meaning of the raw value. [`Reason::Sentinel`] if the meaning is unknown.
    pub means: Reason,
}

/// One value as registers that were read or will be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoded {
    registers: [u16; 4],
    len: usize,
    /// Whether the value did not fit its type and was limited to the nearest value that fits.
    pub saturated: bool,
}

impl Encoded {
    /// Creates a value from registers that were read, lowest address first. Registers after the fourth are ignored.
    pub fn of(registers: &[u16]) -> Encoded {
        let mut kept = [0; 4];
        let len = registers.len().min(kept.len());
        kept[..len].copy_from_slice(&registers[..len]);
        Encoded { registers: kept, len, saturated: false }
    }

    /// Returns the registers, lowest address first.
    pub fn registers(&self) -> &[u16] {
        &self.registers[..self.len]
    }

    /// Returns the bits of the registers as one integer, most significant register first. Inverse of
    /// [`DataType::encode`].
    pub fn bits(&self) -> u64 {
        self.registers().iter().fold(0, |bits, word| bits << 16 | u64::from(*word))
    }
}

impl Encoding {
    /// Returns the engineering value of one coil or discrete input.
    ///
    /// # Errors
    /// [`Reason::NotANumber`] if scale and offset give NaN or infinity.
    pub fn decode_bit(&self, bit: bool) -> Result<f64, Reason> {
        let value = f64::from(u8::from(bit)) * self.scale.get() + self.offset;
        if value.is_finite() { Ok(value) } else { Err(Reason::NotANumber) }
    }

    /// Returns the engineering value of the registers, lowest address first. The number of registers must be
    /// `data_type.registers()`.
    ///
    /// # Errors
    /// Returns why the registers have no value: a sentinel, NaN or infinity, or a wrong number of registers.
    pub fn decode(&self, registers: &[u16]) -> Result<f64, Reason> {
        let bits = self.gather(registers)?;
        let raw = match self.data_type {
            DataType::F32 | DataType::F64 => {
                let value = float_of(self.data_type, bits);
                if !value.is_finite() {
                    return Err(Reason::NotANumber);
                }
                self.sentinel(|raw| same(value, as_float(i128::from(raw))))?;
                value
            }
            _ => {
                let raw = integer_of(self.data_type, bits);
                self.sentinel(|bad| i128::from(bad) == raw)?;
                as_float(raw - i128::from(self.bias))
            }
        };
        let value = self.scale.scaled(raw) + self.offset;
        if value.is_finite() { Ok(value) } else { Err(Reason::NotANumber) }
    }

    /// Returns the registers nearest to `value`. Whole counts are rounded half away from zero, and limited to the range
    /// of the type. NaN is encoded as zero and reported as saturated; no caller passes NaN.
    pub fn encode(&self, value: f64) -> Encoded {
        let scaled = self.scale.unscaled(value - self.offset);
        let (bits, saturated) = match self.data_type.integer_range() {
            None => float_bits(self.data_type, scaled),
            Some((low, high)) => {
                let counts = if scaled.is_nan() { 0 } else { as_integer(scaled.round()) };
                let wanted = counts.saturating_add(i128::from(self.bias));
                let fits = wanted.clamp(low, high);
                (self.data_type.bits_of(fits), fits != wanted || scaled.is_nan())
            }
        };
        self.scatter(bits, saturated)
    }

    /// Returns the whole counts in the registers, without the bias. `None` for a floating-point type, or if the number
    /// of registers is wrong.
    pub fn counts(&self, registers: &[u16]) -> Option<Counts> {
        self.data_type.integer_range()?;
        let raw = integer_of(self.data_type, self.gather(registers).ok()?);
        i64::try_from(raw - i128::from(self.bias)).ok().map(Counts)
    }

    /// Encodes counts as registers. The counts are limited to the range of the integer type.
    pub fn encode_counts(&self, counts: Counts) -> Encoded {
        let Some((low, high)) = self.data_type.integer_range() else {
            return self.encode(self.value_of(counts));
        };
        let wanted = i128::from(counts.0) + i128::from(self.bias);
        let fits = wanted.clamp(low, high);
        self.scatter(self.data_type.bits_of(fits), fits != wanted)
    }

    /// Returns the smallest and the largest counts that fit the type, without the bias. `None` for floating point, and
    /// if the counts exceed 64 bits.
    pub fn range_of_counts(&self) -> Option<(Counts, Counts)> {
        let (low, high) = self.data_type.integer_range()?;
        let bias = i128::from(self.bias);
        Some((Counts(i64::try_from(low - bias).ok()?), Counts(i64::try_from(high - bias).ok()?)))
    }

    /// Returns the engineering value of a number of counts.
    pub fn value_of(&self, counts: Counts) -> f64 {
        // Adding zero turns −0 into 0.
        self.scale.scaled(as_float(i128::from(counts.0))) + self.offset + 0.0
    }

    /// Returns the counts nearest to a value, rounded half away from zero.
    pub fn nearest_counts(&self, value: f64) -> Counts {
        let counts = as_integer(self.scale.unscaled(value - self.offset).round());
        Counts(i64::try_from(counts).unwrap_or(if counts < 0 { i64::MIN } else { i64::MAX }))
    }

    fn sentinel(&self, is: impl Fn(i64) -> bool) -> Result<(), Reason> {
        match self.bad.iter().find(|bad| is(bad.raw)) {
            Some(bad) => Err(bad.means),
            None => Ok(()),
        }
    }

    fn gather(&self, registers: &[u16]) -> Result<u64, Reason> {
        if registers.len() != usize::from(self.data_type.registers()) {
            return Err(Reason::BadReply);
        }
        let join = |bits: u64, word: &u16| (bits << 16) | u64::from(self.swap(*word));
        Ok(match self.word_order {
            WordOrder::MswFirst => registers.iter().fold(0, join),
            WordOrder::LswFirst => registers.iter().rev().fold(0, join),
        })
    }

    fn scatter(&self, bits: u64, saturated: bool) -> Encoded {
        let mut encoded = Encoded { saturated, ..self.data_type.encode(bits) };
        let registers = &mut encoded.registers[..encoded.len];
        if self.word_order == WordOrder::LswFirst {
            registers.reverse();
        }
        registers.iter_mut().for_each(|register| *register = self.swap(*register));
        encoded
    }

    fn swap(&self, word: u16) -> u16 {
        if self.byte_swap { word.swap_bytes() } else { word }
    }
}

/// Returns whether two numbers are exactly equal. A module with floats sends its sentinel exactly, for example 9999.0.
#[allow(clippy::float_cmp)]
fn same(a: f64, b: f64) -> bool {
    a == b
}

/// Converts a raw count to a float. Counts beyond 2^53 lose their last digits, but no real scale has so many counts.
#[allow(clippy::cast_precision_loss)]
fn as_float(raw: i128) -> f64 {
    match i64::try_from(raw) {
        // Counts of 64 bits use the fast conversion of the processor.
        Ok(raw) => raw as f64,
        Err(_) => wide_as_float(raw),
    }
}

#[cold]
#[inline(never)]
#[allow(clippy::cast_precision_loss)]
fn wide_as_float(raw: i128) -> f64 {
    raw as f64
}

/// Converts a rounded number to an integer. A number that does not fit becomes the smallest or largest integer.
#[allow(clippy::cast_possible_truncation)]
fn as_integer(rounded: f64) -> i128 {
    const FITS: f64 = 9.0e18;
    if rounded.abs() < FITS { i128::from(rounded as i64) } else { rounded as i128 }
}

fn float_of(data_type: DataType, bits: u64) -> f64 {
    match u32::try_from(bits) {
        Ok(narrow) if data_type == DataType::F32 => f64::from(f32::from_bits(narrow)),
        _ => f64::from_bits(bits),
    }
}

#[allow(clippy::cast_possible_truncation)]
fn float_bits(data_type: DataType, value: f64) -> (u64, bool) {
    let finite = if value.is_nan() { 0.0 } else { value };
    if data_type == DataType::F32 {
        let limit = f64::from(f32::MAX);
        let fits = finite.clamp(-limit, limit);
        return (u64::from((fits as f32).to_bits()), !same(fits, value));
    }
    let fits = finite.clamp(f64::MIN, f64::MAX);
    (fits.to_bits(), !same(fits, value))
}

impl From<i64> for Sentinel {
    /// Creates a sentinel from a raw count whose meaning is unknown.
    fn from(raw: i64) -> Sentinel {
        Sentinel { raw, means: Reason::Sentinel }
    }
}

impl fmt::Display for WordOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            WordOrder::MswFirst => "msw-first",
            WordOrder::LswFirst => "lsw-first",
        })
    }
}

#[cfg(test)]
mod tests;
