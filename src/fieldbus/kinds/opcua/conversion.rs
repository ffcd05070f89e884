//! Conversion of numbers and node identifiers between the OPC UA library and the profile.

use ::opcua::types::{ByteString, Guid, NodeId, Variant, VariantScalarTypeId};
use isotherm_core::codec::{DataType, Identifier, Scalar};

/// Returns the number in a value of OPC UA; `None` if the value is not a number.
pub fn scalar(value: &Variant) -> Option<Scalar> {
    let (data_type, bits) = match value {
        Variant::Boolean(value) => (DataType::Bool, u64::from(*value)),
        Variant::SByte(value) => (DataType::signed(8), u64::from(value.cast_unsigned())),
        Variant::Byte(value) => (DataType::unsigned(8), u64::from(*value)),
        Variant::Int16(value) => (DataType::I16, u64::from(value.cast_unsigned())),
        Variant::UInt16(value) => (DataType::U16, u64::from(*value)),
        Variant::Int32(value) => (DataType::I32, u64::from(value.cast_unsigned())),
        Variant::UInt32(value) => (DataType::U32, u64::from(*value)),
        Variant::Int64(value) => (DataType::I64, value.cast_unsigned()),
        Variant::UInt64(value) => (DataType::U64, *value),
        Variant::Float(value) => (DataType::F32, u64::from(value.to_bits())),
        Variant::Double(value) => (DataType::F64, value.to_bits()),
        _ => return None,
    };
    Some(Scalar { data_type, bits })
}

/// Returns the profile's type for an OPC UA type of number; `None` for other types.
pub fn number_type(kind: VariantScalarTypeId) -> Option<DataType> {
    Some(match kind {
        VariantScalarTypeId::Boolean => DataType::Bool,
        VariantScalarTypeId::SByte => DataType::signed(8),
        VariantScalarTypeId::Byte => DataType::unsigned(8),
        VariantScalarTypeId::Int16 => DataType::I16,
        VariantScalarTypeId::UInt16 => DataType::U16,
        VariantScalarTypeId::Int32 => DataType::I32,
        VariantScalarTypeId::UInt32 => DataType::U32,
        VariantScalarTypeId::Int64 => DataType::I64,
        VariantScalarTypeId::UInt64 => DataType::U64,
        VariantScalarTypeId::Float => DataType::F32,
        VariantScalarTypeId::Double => DataType::F64,
        _ => return None,
    })
}

/// Returns a number as a value of OPC UA with the type of its node; `None` if OPC UA has no such type.
pub fn variant(Scalar { data_type, bits }: Scalar) -> Option<Variant> {
    let [a, b, c, d, ..] = bits.to_le_bytes();
    let (byte, word, double) = (a, u16::from_le_bytes([a, b]), u32::from_le_bytes([a, b, c, d]));
    Some(match data_type {
        DataType::Bool => Variant::Boolean(bits != 0),
        DataType::Signed(8) => Variant::SByte(byte.cast_signed()),
        DataType::Unsigned(8) => Variant::Byte(byte),
        DataType::I16 => Variant::Int16(word.cast_signed()),
        DataType::U16 => Variant::UInt16(word),
        DataType::I32 => Variant::Int32(double.cast_signed()),
        DataType::U32 => Variant::UInt32(double),
        DataType::I64 => Variant::Int64(bits.cast_signed()),
        DataType::U64 => Variant::UInt64(bits),
        DataType::F32 => Variant::Float(f32::from_bits(double)),
        DataType::F64 => Variant::Double(f64::from_bits(bits)),
        DataType::Bit(_)
        | DataType::Part(_)
        | DataType::Bcd(_)
        | DataType::SignMagnitude(_)
        | DataType::Decimal24(_)
        | DataType::Signed(_)
        | DataType::Unsigned(_) => return None,
    })
}

/// Returns the identifier of a node in the namespace with this index; `None` if the identifier is invalid.
pub fn node_id(namespace: u16, identifier: &Identifier) -> Option<NodeId> {
    Some(match identifier {
        Identifier::Number(number) => NodeId::new(namespace, *number),
        Identifier::Text(text) => NodeId::new(namespace, text.as_str()),
        Identifier::Guid(text) => NodeId::new(namespace, text.parse::<Guid>().ok()?),
        Identifier::Opaque(text) => NodeId::new(namespace, ByteString::from_base64(text)?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_number_goes_to_the_server_and_comes_back_as_it_was() {
        let numbers = [
            (DataType::Bool, 1),
            (DataType::signed(8), 0x80),
            (DataType::unsigned(8), 0xfe),
            (DataType::I16, 0x8001),
            (DataType::U16, 0xfffe),
            (DataType::I32, 0x8000_0001),
            (DataType::U32, 0xffff_fffe),
            (DataType::I64, 0x8000_0000_0000_0001),
            (DataType::U64, u64::MAX - 1),
            (DataType::F32, u64::from(27.5f32.to_bits())),
            (DataType::F64, (-0.25f64).to_bits()),
        ];
        for (data_type, bits) in numbers {
            let number = Scalar { data_type, bits };
            let sent = variant(number).unwrap();
            assert_eq!(scalar(&sent), Some(number));
            assert_eq!(sent.scalar_type_id().and_then(number_type), Some(data_type));
        }
        assert_eq!(scalar(&Variant::from("27.5")), None);
    }
}
