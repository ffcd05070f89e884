//! Encoding and decoding of values of the Sparkplug data types.

use super::payload::{PropertyRaw, Raw};

/// Data types of Sparkplug B that isotherm writes or reads, with their numbers in the specification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum DataType {
    /// Signed integer, 8 bits.
    Int8 = 1,
    /// Signed integer, 16 bits.
    Int16 = 2,
    /// Signed integer, 32 bits.
    Int32 = 3,
    /// Signed integer, 64 bits.
    Int64 = 4,
    /// Unsigned integer, 8 bits.
    UInt8 = 5,
    /// Unsigned integer, 16 bits.
    UInt16 = 6,
    /// Unsigned integer, 32 bits.
    UInt32 = 7,
    /// Unsigned integer, 64 bits.
    UInt64 = 8,
    /// Real number, 32 bits.
    Float = 9,
    /// Real number, 64 bits.
    Double = 10,
    /// Boolean.
    Boolean = 11,
    /// Text.
    String = 12,
    /// Milliseconds since 1970.
    DateTime = 13,
}

/// Value of one of the Sparkplug data types.
#[derive(Clone, Debug, PartialEq)]
pub enum Datum {
    /// Value of one of the signed integer types.
    Signed(i64),
    /// Value of one of the unsigned integer types.
    Unsigned(u64),
    /// Value of one of the types for real numbers.
    Real(f64),
    /// Boolean.
    Flag(bool),
    /// Text.
    Text(String),
    /// Milliseconds since 1970.
    Date(u64),
}

impl DataType {
    /// All supported data types.
    pub const ALL: [DataType; 13] = [
        DataType::Int8,
        DataType::Int16,
        DataType::Int32,
        DataType::Int64,
        DataType::UInt8,
        DataType::UInt16,
        DataType::UInt32,
        DataType::UInt64,
        DataType::Float,
        DataType::Double,
        DataType::Boolean,
        DataType::String,
        DataType::DateTime,
    ];

    /// Returns the number of the type in messages, from the specification.
    pub const fn number(self) -> u32 {
        self as u32
    }

    /// Returns the data type with this number; `None` if the type is not supported.
    pub fn from_number(number: u32) -> Option<DataType> {
        DataType::ALL.into_iter().find(|kind| kind.number() == number)
    }

    /// Encodes a value of this type. Returns `None` if the value is out of range or of another kind. `Float` rounds a
    /// real number to 32 bits. A negative number of 8 or 16 bits is encoded in its width, without sign extension.
    pub fn write(self, datum: &Datum) -> Option<Raw> {
        Some(match (self, datum) {
            (DataType::Int8, Datum::Signed(value)) => {
                Raw::Int(i8::try_from(*value).ok()?.cast_unsigned().into())
            }
            (DataType::Int16, Datum::Signed(value)) => {
                Raw::Int(i16::try_from(*value).ok()?.cast_unsigned().into())
            }
            (DataType::Int32, Datum::Signed(value)) => Raw::Int(i32::try_from(*value).ok()?.cast_unsigned()),
            (DataType::Int64, Datum::Signed(value)) => Raw::Long(value.cast_unsigned()),
            (DataType::UInt8, Datum::Unsigned(value)) => Raw::Int(u8::try_from(*value).ok()?.into()),
            (DataType::UInt16, Datum::Unsigned(value)) => Raw::Int(u16::try_from(*value).ok()?.into()),
            (DataType::UInt32, Datum::Unsigned(value)) => Raw::Int(u32::try_from(*value).ok()?),
            (DataType::UInt64, Datum::Unsigned(value)) => Raw::Long(*value),
            (DataType::Float, Datum::Real(value)) => Raw::Float(single(*value)?),
            (DataType::Double, Datum::Real(value)) => Raw::Double(*value),
            (DataType::Boolean, Datum::Flag(value)) => Raw::Boolean(*value),
            (DataType::String, Datum::Text(value)) => Raw::String(value.clone()),
            (DataType::DateTime, Datum::Date(value)) => Raw::Long(*value),
            _ => return None,
        })
    }

    /// Decodes a value of this type. Returns `None` if the encoding belongs to another type, or if the value is out of
    /// range.
    ///
    /// Some senders encode a negative number of 8 or 16 bits in its width, others extend its sign to 32 bits. Both
    /// encodings are accepted.
    pub fn read(self, raw: &Raw) -> Option<Datum> {
        Some(match (self, raw) {
            (DataType::Int8, Raw::Int(value)) => Datum::Signed(narrow(*value, 8)?),
            (DataType::Int16, Raw::Int(value)) => Datum::Signed(narrow(*value, 16)?),
            (DataType::Int32, Raw::Int(value)) => Datum::Signed(value.cast_signed().into()),
            (DataType::Int64, Raw::Long(value)) => Datum::Signed(value.cast_signed()),
            (DataType::UInt8, Raw::Int(value)) => Datum::Unsigned(u8::try_from(*value).ok()?.into()),
            (DataType::UInt16, Raw::Int(value)) => Datum::Unsigned(u16::try_from(*value).ok()?.into()),
            (DataType::UInt32, Raw::Int(value)) => Datum::Unsigned((*value).into()),
            (DataType::UInt64, Raw::Long(value)) => Datum::Unsigned(*value),
            (DataType::Float, Raw::Float(value)) => Datum::Real((*value).into()),
            (DataType::Double, Raw::Double(value)) => Datum::Real(*value),
            (DataType::Boolean, Raw::Boolean(value)) => Datum::Flag(*value),
            (DataType::String, Raw::String(value)) => Datum::Text(value.clone()),
            (DataType::DateTime, Raw::Long(value)) => Datum::Date(*value),
            _ => return None,
        })
    }
}

impl Raw {
    /// Converts the encoded value of a metric to the encoded value of a property. Returns `None` for bytes, which a
    /// property cannot contain.
    pub fn into_property(self) -> Option<PropertyRaw> {
        Some(match self {
            Raw::Int(value) => PropertyRaw::Int(value),
            Raw::Long(value) => PropertyRaw::Long(value),
            Raw::Float(value) => PropertyRaw::Float(value),
            Raw::Double(value) => PropertyRaw::Double(value),
            Raw::Boolean(value) => PropertyRaw::Boolean(value),
            Raw::String(value) => PropertyRaw::String(value),
            Raw::Bytes(_) => return None,
        })
    }
}

/// Decodes a signed number of `bits` bits, whether or not its sign is extended to 32 bits. Returns `None` if it is out
/// of range.
fn narrow(value: u32, bits: u32) -> Option<i64> {
    let (sign, extended) = (1u32 << (bits - 1), u32::MAX << (bits - 1));
    let is_cut = value >> bits == 0;
    let value = if is_cut && value & sign != 0 { value | extended } else { value };
    let is_within = value < sign || value >= extended;
    is_within.then(|| value.cast_signed().into())
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "the value is rounded; a value out of the range of f32 is refused"
)]
fn single(value: f64) -> Option<f32> {
    let rounded = value as f32;
    (rounded.is_finite() || !value.is_finite()).then_some(rounded)
}
