//! Data types of values: for each type, the number of registers, the number of bits, and the range of raw counts.

use super::{Encoded, Part};

/// Largest number on a display with six digits, and largest count of the type [`DataType::Decimal24`].
const SIX_DIGITS: i128 = 999_999;

/// Representation of a number in registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DataType {
    /// One coil or discrete input. In a register, zero is false and any other value is true.
    Bool,
    /// Unsigned 16 bits.
    U16,
    /// Signed 16 bits, two's complement.
    I16,
    /// Unsigned 32 bits.
    U32,
    /// Signed 32 bits.
    I32,
    /// Unsigned 64 bits.
    U64,
    /// Signed 64 bits.
    I64,
    /// IEEE 754, 32 bits.
    F32,
    /// IEEE 754, 64 bits.
    F64,
    /// One bit of a register; bit 0 is the least significant.
    Bit(u8),
    /// Adjacent bits of one or two registers.
    Part(Part),
    /// Two registers of a display with six digits. They contain a sign, the number of decimals (0 to 5) and a magnitude
    /// of 24 bits.
    Decimal24(u8),
    /// Binary-coded decimal without a sign: this number of digits (4 or 8), with four bits each.
    Bcd(u8),
    /// Sign and magnitude in this number of bits (16 or 32). The highest bit is the sign: 1 means a negative number.
    SignMagnitude(u8),
    /// Unsigned integer of this number of bits (1 to 64), in a CAN frame, a CANopen object or registers. A
    /// width that has a named type, such as [`DataType::U16`], uses the named type. Unused bits of the first
    /// register are ignored.
    Unsigned(u8),
    /// Signed integer in two's complement, with this number of bits. In all other respects like [`DataType::Unsigned`].
    Signed(u8),
}

impl DataType {
    /// Data types with a fixed name in profiles, such as `u16`. Types whose number of bits the profile states
    /// ([`DataType::Unsigned`], …) are not in this list.
    pub const ALL: [DataType; 9] = [
        DataType::Bool,
        DataType::U16,
        DataType::I16,
        DataType::U32,
        DataType::I32,
        DataType::U64,
        DataType::I64,
        DataType::F32,
        DataType::F64,
    ];

    /// Returns the number of registers that a value of this type occupies.
    pub const fn registers(self) -> u16 {
        match self {
            DataType::Bool | DataType::Bit(_) | DataType::U16 | DataType::I16 => 1,
            DataType::U32 | DataType::I32 | DataType::F32 | DataType::Decimal24(_) => 2,
            DataType::U64 | DataType::I64 | DataType::F64 => 4,
            DataType::Part(part) => part.registers(),
            DataType::Bcd(digits) => digits.div_ceil(4) as u16,
            DataType::SignMagnitude(bits) => bits.div_ceil(16) as u16,
            DataType::Unsigned(bits) | DataType::Signed(bits) => bits.div_ceil(16) as u16,
        }
    }

    /// Returns the number of bits of a value of this type.
    pub const fn width(self) -> u8 {
        match self {
            DataType::Bool | DataType::Bit(_) => 1,
            DataType::U16 | DataType::I16 => 16,
            DataType::U32 | DataType::I32 | DataType::F32 | DataType::Decimal24(_) => 32,
            DataType::U64 | DataType::I64 | DataType::F64 => 64,
            DataType::Part(part) => part.length(),
            DataType::Bcd(digits) => 4 * digits,
            DataType::SignMagnitude(bits) => bits,
            DataType::Unsigned(bits) | DataType::Signed(bits) => bits,
        }
    }

    /// Returns the unsigned type of this width: a named type, or [`DataType::Unsigned`].
    pub const fn unsigned(bits: u8) -> DataType {
        match bits {
            16 => DataType::U16,
            32 => DataType::U32,
            64 => DataType::U64,
            _ => DataType::Unsigned(bits),
        }
    }

    /// Returns the signed type of this width: a named type, or [`DataType::Signed`].
    pub const fn signed(bits: u8) -> DataType {
        match bits {
            16 => DataType::I16,
            32 => DataType::I32,
            64 => DataType::I64,
            _ => DataType::Signed(bits),
        }
    }

    /// Splits the bits of a value into registers, most significant first.
    pub fn encode(self, bits: u64) -> Encoded {
        let len = usize::from(self.registers());
        let mut registers = [0u16; 4];
        for (place, word) in registers.iter_mut().take(len).enumerate() {
            let [low, high, ..] = (bits >> (16 * (len - 1 - place))).to_le_bytes();
            *word = u16::from_le_bytes([low, high]);
        }
        Encoded { registers, len, saturated: false }
    }

    /// Returns the name of the type in the profile.
    pub const fn name(self) -> &'static str {
        match self {
            DataType::Bool | DataType::Bit(_) => "bool",
            DataType::Decimal24(_) => "decimal24",
            DataType::Part(part) => part.type_name(),
            DataType::Bcd(4) => "bcd16",
            DataType::Bcd(_) => "bcd32",
            DataType::SignMagnitude(16) => "sm16",
            DataType::SignMagnitude(_) => "sm32",
            DataType::U16 => "u16",
            DataType::I16 => "i16",
            DataType::U32 => "u32",
            DataType::I32 => "i32",
            DataType::U64 => "u64",
            DataType::I64 => "i64",
            DataType::F32 => "f32",
            DataType::F64 => "f64",
            DataType::Unsigned(8) => "u8",
            DataType::Signed(8) => "i8",
            DataType::Unsigned(24) => "u24",
            DataType::Signed(24) => "i24",
            DataType::Unsigned(_) => "unsigned",
            DataType::Signed(_) => "signed",
        }
    }

    /// Returns the smallest and the largest raw count of an integer type. `None` for floating point.
    pub const fn integer_range(self) -> Option<(i128, i128)> {
        Some(match self {
            DataType::Bool | DataType::Bit(_) => (0, 1),
            DataType::Decimal24(_) => (-SIX_DIGITS, SIX_DIGITS),
            DataType::Part(part) => part.range(),
            DataType::Bcd(digits) => (0, 10i128.pow(digits as u32) - 1),
            DataType::SignMagnitude(bits) => (1 - (1 << (bits - 1)), (1 << (bits - 1)) - 1),
            DataType::U16 => (0, u16::MAX as i128),
            DataType::I16 => (i16::MIN as i128, i16::MAX as i128),
            DataType::U32 => (0, u32::MAX as i128),
            DataType::I32 => (i32::MIN as i128, i32::MAX as i128),
            DataType::U64 => (0, u64::MAX as i128),
            DataType::I64 => (i64::MIN as i128, i64::MAX as i128),
            DataType::Unsigned(bits) => (0, (1 << bits) - 1),
            DataType::Signed(bits) => (-(1 << (bits - 1)), (1 << (bits - 1)) - 1),
            DataType::F32 | DataType::F64 => return None,
        })
    }
}

impl DataType {
    /// Encodes a raw count as bits. The count must be in the range of the type.
    pub(super) fn bits_of(self, raw: i128) -> u64 {
        match self {
            DataType::Bit(bit) => to_bits(raw) << bit,
            DataType::Part(part) => part.placed(to_bits(raw)),
            DataType::Bcd(digits) => {
                let digit = |place: u8| to_bits(raw / 10i128.pow(u32::from(place)) % 10) << (4 * place);
                (0..digits).map(digit).sum()
            }
            DataType::SignMagnitude(bits) => u64::from(raw < 0) << (bits - 1) | to_bits(raw.abs()),
            DataType::Decimal24(decimals) => {
                let sign = u64::from(raw < 0);
                sign << 28 | u64::from(decimals) << 24 | to_bits(raw.abs())
            }
            DataType::Signed(bits) if bits < 64 => to_bits(raw) & ((1 << bits) - 1),
            _ => to_bits(raw),
        }
    }
}

/// Returns whether the bits are a value of this type. Only bits of a binary-coded decimal can be invalid: they may
/// contain a digit from A to F.
pub(super) fn is_value(data_type: DataType, bits: u64) -> bool {
    match data_type {
        DataType::Bcd(digits) => (0..digits).all(|place| digit(bits, place) <= 9),
        _ => true,
    }
}

/// Returns the four bits of one digit of a binary-coded decimal. Place 0 is the last digit.
fn digit(bits: u64, place: u8) -> i128 {
    i128::from(bits >> (4 * place) & 0xf)
}

fn to_bits(raw: i128) -> u64 {
    let bytes = raw.to_le_bytes();
    let mut low = [0u8; 8];
    low.copy_from_slice(&bytes[..8]);
    u64::from_le_bytes(low)
}

/// Decodes the bits of a value of this integer type into a raw count.
pub(super) fn integer_of(data_type: DataType, bits: u64) -> i128 {
    let beyond = 64 - u32::from(data_type.width());
    match data_type {
        DataType::Bool => i128::from(bits != 0),
        DataType::Bit(bit) => i128::from(bits >> bit & 1),
        DataType::Part(part) => part.count(bits),
        DataType::Bcd(digits) => (0..digits).rev().fold(0, |number, place| 10 * number + digit(bits, place)),
        DataType::SignMagnitude(width) => {
            let magnitude = i128::from(bits & ((1 << (width - 1)) - 1));
            if bits >> (width - 1) & 1 == 1 { -magnitude } else { magnitude }
        }
        DataType::Decimal24(_) => {
            let magnitude = i128::from(bits & 0x00ff_ffff);
            if bits >> 28 & 1 == 1 { -magnitude } else { magnitude }
        }
        // Shifting left and arithmetically right extends the sign bit.
        DataType::I16 | DataType::I32 | DataType::I64 | DataType::Signed(_) => {
            i128::from((bits << beyond).cast_signed() >> beyond)
        }
        _ => i128::from(bits << beyond >> beyond),
    }
}
