//! CANopen objects: their entry in the object dictionary, and conversion between their bytes and registers.

use std::fmt;

use super::{DataType, Encoded};

/// Entry of the object dictionary of a CANopen node. Formatted in the notation of the profile: `7130:01`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Entry {
    /// Index of the object in the dictionary, for example 0x7130.
    pub index: u16,
    /// Sub-index of the entry within the object.
    pub sub: u8,
}

impl Entry {
    /// Creates the entry of this index and sub-index.
    pub const fn new(index: u16, sub: u8) -> Entry {
        Entry { index, sub }
    }
}

impl fmt::Display for Entry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04X}:{:02X}", self.index, self.sub)
    }
}

/// CANopen object with the type of its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Object {
    /// Entry in the node's object dictionary.
    pub entry: Entry,
    /// Type of the value. It always has a whole number of bytes, because an SDO transfers bytes.
    pub data_type: DataType,
}

impl Object {
    /// Creates the object of this index and sub-index, with a value of this type.
    pub const fn new(index: u16, sub: u8, data_type: DataType) -> Object {
        Object { entry: Entry::new(index, sub), data_type }
    }

    /// Returns the number of bytes of the value.
    pub const fn size(&self) -> usize {
        self.data_type.width().div_ceil(8) as usize
    }

    /// Converts bytes from the node into registers, most significant register first. Returns `None` if the number of
    /// bytes differs from [`Object::size`].
    pub fn registers(&self, bytes: &[u8]) -> Option<Encoded> {
        if bytes.len() != self.size() || bytes.len() > 8 {
            return None;
        }
        let mut eight = [0; 8];
        eight[..bytes.len()].copy_from_slice(bytes);
        Some(self.data_type.encode(u64::from_le_bytes(eight)))
    }

    /// Converts registers, most significant register first, into the bytes of an SDO transfer.
    pub fn bytes(&self, registers: &[u16]) -> Vec<u8> {
        Encoded::of(registers).bits().to_le_bytes()[..self.size().min(8)].to_vec()
    }
}

/// Formats index and sub-index of the object, for example as `7130:01`.
impl fmt::Display for Object {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.entry.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_object_s_bytes_are_its_registers_turned_round() {
        let position = Object::new(0x6004, 0, DataType::I32);
        assert_eq!(position.registers(&[0x78, 0x56, 0x34, 0x12]).unwrap().registers(), [0x1234, 0x5678]);
        assert_eq!(position.bytes(&[0x1234, 0x5678]), [0x78, 0x56, 0x34, 0x12]);
        assert_eq!(position.registers(&[0x78, 0x56]), None);
        let status = Object::new(0x6150, 1, DataType::unsigned(8));
        assert_eq!((status.size(), status.registers(&[3]).unwrap().registers()), (1, [3].as_slice()));
        assert_eq!((position.to_string(), status.to_string()), ("6004:00".to_owned(), "6150:01".to_owned()));
    }
}
