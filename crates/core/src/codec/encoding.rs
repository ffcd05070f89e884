//! Encoding of a value: type, word order, scale, offset, bias and sentinels. A sentinel is a raw value that means "no
//! measurement".

use std::fmt;

use super::data_type::{integer_of, is_value};
use super::float::{as_float, as_integer, float_bits, float_of, same};
use super::{DataType, Encoded, Scale};
use crate::quantity::Counts;
use crate::reading::Reason;

/// Order of the registers of a value that occupies several registers. There is no default, because devices differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WordOrder {
    /// The most significant word is at the lowest address.
    MswFirst,
    /// The least significant word is at the lowest address.
    LswFirst,
}

/// Conversion between registers and an engineering value: `value = raw · scale + offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoding {
    /// Type of the raw value in the registers, for example `i16`.
    pub data_type: DataType,
    /// Order of the registers. It has no effect on a value of one register.
    pub word_order: WordOrder,
    /// Whether the two bytes of each register are exchanged.
    pub byte_swap: bool,
    /// Scale: engineering units per count of the raw value.
    pub scale: Scale,
    /// Engineering value of a raw count of zero.
    pub offset: f64,
    /// Number that is added to a raw count before the count is sent. Only outputs use a bias; LinuxCNC requires 32768.
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
        self.decode_by(registers, self.scale)
    }

    /// Returns the engineering value of the registers, with the scale multiplied by 10 to the power of `exponent`.
    ///
    /// # Errors
    /// As [`Encoding::decode`].
    pub fn decode_at(&self, registers: &[u16], exponent: i8) -> Result<f64, Reason> {
        self.decode_by(registers, self.scale.times_power_of_ten(exponent))
    }

    fn decode_by(&self, registers: &[u16], scale: Scale) -> Result<f64, Reason> {
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
            _ if !is_value(self.data_type, bits) => return Err(Reason::NotANumber),
            _ => {
                let raw = integer_of(self.data_type, bits);
                self.sentinel(|bad| i128::from(bad) == raw)?;
                as_float(raw - i128::from(self.bias))
            }
        };
        let value = scale.scaled(raw) + self.offset;
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

    /// Returns the whole counts in the registers, without the bias. `None` for a floating-point type, if the number of
    /// registers is wrong, or if a binary-coded decimal contains an invalid digit.
    pub fn counts(&self, registers: &[u16]) -> Option<Counts> {
        self.data_type.integer_range()?;
        let bits = self.gather(registers).ok().filter(|bits| is_value(self.data_type, *bits))?;
        let raw = integer_of(self.data_type, bits);
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

    /// Returns a mask of the bits that the value occupies in its registers, lowest address first. All bits are set,
    /// unless the value is smaller than its registers.
    pub fn occupied(&self) -> Encoded {
        let bits = match self.data_type {
            DataType::Bool => u64::MAX,
            DataType::Bit(bit) => 1 << bit,
            DataType::Part(part) => part.mask(),
            // The value consists of sign and magnitude. The number of decimals in the same registers is not part of it.
            DataType::Decimal24(_) => 0x10ff_ffff,
            data_type => u64::MAX >> (64 - data_type.width()),
        };
        self.scatter(bits, false)
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
