//! Registers and bits of one virtual device.

use std::collections::HashMap;

use isotherm_core::codec::{Address, DataType, Encoding, Register, Table};

/// Registers and bits of a Modbus device. Every address up to the highest used address exists. Each value of
/// a CAN device is stored as registers too, at a separate address.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Bank {
    coils: Vec<u16>,
    discretes: Vec<u16>,
    inputs: Vec<u16>,
    holdings: Vec<u16>,
    values: HashMap<Address, Vec<u16>>,
}

impl Bank {
    /// Creates `count` cells (registers or bits) from `address` on, if they do not exist. Returns all cells of their
    /// table, and the index of the cell at `address`.
    pub(super) fn reserve(&mut self, address: &Address, count: u16) -> (&mut [u16], usize) {
        let (cells, first) = match address {
            Address::Modbus(Register { table, offset }) => (self.table_mut(*table), usize::from(*offset)),
            _ => (self.values.entry(address.clone()).or_default(), 0),
        };
        let needed = first + usize::from(count);
        if cells.len() < needed {
            cells.resize(needed, 0);
        }
        (cells, first)
    }

    /// Writes values to the registers or bits from `address` on, and creates those that do not exist.
    pub(super) fn set(&mut self, address: &Address, values: &[u16]) {
        let count = values.len();
        let (cells, first) = self.reserve(address, u16::try_from(count).unwrap_or(u16::MAX));
        cells[first..first + count].copy_from_slice(values);
    }

    /// Returns the content of the registers or bits from `address` on; bits are 0 or 1. Returns `None` if one of them
    /// does not exist.
    pub(super) fn read(&self, address: &Address, count: u16) -> Option<&[u16]> {
        match address {
            Address::Modbus(register) => self.registers(*register, count),
            _ => self.values.get(address)?.get(..usize::from(count)),
        }
    }

    /// Writes values to the registers or bits from `address` on. If one of them does not exist, changes nothing and
    /// returns `None`.
    pub(super) fn write(&mut self, address: &Address, values: &[u16]) -> Option<()> {
        let cells = match address {
            Address::Modbus(Register { table, offset }) => {
                self.table_mut(*table).get_mut(usize::from(*offset)..)?
            }
            _ => self.values.get_mut(address)?,
        };
        cells.get_mut(..values.len())?.copy_from_slice(values);
        Some(())
    }

    /// Writes an encoded value. For a value that is a part of its registers, the other bits are unchanged. For example,
    /// a write of the digits of a display does not change its number of decimals.
    pub(super) fn put(&mut self, address: &Address, encoding: &Encoding, words: &[u16]) {
        if !matches!(encoding.data_type, DataType::Bit(_) | DataType::Part(_) | DataType::Decimal24(_)) {
            return self.set(address, words);
        }
        let (before, first) = self.reserve(address, encoding.data_type.registers());
        let occupied = encoding.occupied();
        for ((cell, word), mask) in before[first..].iter_mut().zip(words).zip(occupied.registers()) {
            *cell = *cell & !mask | word & mask;
        }
    }

    /// Returns the content of `count` registers or bits from this address on; `None` if one of them does not exist.
    pub(super) fn registers(&self, Register { table, offset }: Register, count: u16) -> Option<&[u16]> {
        let cells = match table {
            Table::Coil => &self.coils,
            Table::Discrete => &self.discretes,
            Table::Input => &self.inputs,
            Table::Holding => &self.holdings,
        };
        cells.get(usize::from(offset)..)?.get(..usize::from(count))
    }

    fn table_mut(&mut self, table: Table) -> &mut Vec<u16> {
        match table {
            Table::Coil => &mut self.coils,
            Table::Discrete => &mut self.discretes,
            Table::Input => &mut self.inputs,
            Table::Holding => &mut self.holdings,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::codec::{Object, Part, Scale, Whole, WordOrder};

    #[test]
    fn a_write_beyond_the_last_register_changes_nothing() {
        let mut bank = Bank::default();
        let at = |offset| Address::Modbus(Register { table: Table::Holding, offset });
        bank.reserve(&at(4), 2);
        assert_eq!(bank.write(&at(5), &[1, 2]), None);
        assert_eq!(bank.read(&at(0), 6), Some([0; 6].as_slice()));
        assert_eq!(bank.write(&at(4), &[7, 8]), Some(()));
        assert_eq!(bank.read(&at(3), 3), Some([0, 7, 8].as_slice()));
        assert_eq!(bank.read(&at(65535), 125), None);
    }

    #[test]
    fn two_parts_of_one_register_do_not_change_each_other() {
        let mut bank = Bank::default();
        let at = Address::Modbus(Register { table: Table::Input, offset: 3 });
        let of = |data_type| Encoding {
            data_type,
            word_order: WordOrder::MswFirst,
            byte_swap: false,
            scale: Scale::ONE,
            offset: 0.0,
            bias: 0,
            bad: Vec::new(),
        };
        let part = |first, last| of(DataType::Part(Part::new(first, last, Whole::U16).unwrap()));
        for (encoding, value) in [(part(4, 15), 235.0), (part(0, 3), 5.0), (part(4, 15), 236.0)] {
            bank.put(&at, &encoding, encoding.encode(value).registers());
        }
        assert_eq!(bank.read(&at, 1), Some([236 << 4 | 5].as_slice()));
        let (digits, decimals) = (of(DataType::Decimal24(0)), part(8, 11));
        for (encoding, value) in [(decimals, 2.0), (digits.clone(), -5.0), (digits, -6.0)] {
            bank.put(&at, &encoding, encoding.encode(value).registers());
        }
        assert_eq!(bank.read(&at, 2), Some([0x1200, 6].as_slice()));
    }

    #[test]
    fn each_value_of_a_can_device_stands_alone() {
        let mut bank = Bank::default();
        let at = |sub| Address::Object(Object::new(0x2000, sub, DataType::U64));
        bank.reserve(&at(0), 2);
        bank.reserve(&at(1), 4);
        assert_eq!(bank.write(&at(0), &[1, 2]), Some(()));
        assert_eq!(bank.write(&at(0), &[1, 2, 3]), None);
        assert_eq!(bank.write(&at(1), &[3, 4, 5, 6]), Some(()));
        assert_eq!(bank.read(&at(0), 2), Some([1, 2].as_slice()));
        assert_eq!(bank.read(&at(1), 4), Some([3, 4, 5, 6].as_slice()));
        assert_eq!(bank.read(&at(2), 1), None);
    }
}
