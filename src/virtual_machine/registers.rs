//! The four tables of one virtual device.

use crate::codec::{Address, DataType, Encoding, Table};

/// Registers and bits of a device: every address up to the last one in use exists.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Bank {
    coils: Vec<u16>,
    discretes: Vec<u16>,
    inputs: Vec<u16>,
    holdings: Vec<u16>,
}

impl Bank {
    /// Makes room for this many cells from `address` on.
    pub(super) fn reserve(&mut self, address: Address, count: u16) {
        let needed = usize::from(address.offset) + usize::from(count);
        let Some(cells) = self.table_mut(address.table) else { return };
        if cells.len() < needed {
            cells.resize(needed, 0);
        }
    }

    /// The cells from `offset` on; bits are 0 or 1. `None` where one of them does not exist.
    pub(super) fn read(&self, address: Address, count: u16) -> Option<&[u16]> {
        let first = usize::from(address.offset);
        self.table(address.table).get(first..first + usize::from(count))
    }

    /// Puts values into the cells from `offset` on; `None`, and nothing changed, where one does not exist.
    pub(super) fn write(&mut self, address: Address, values: &[u16]) -> Option<()> {
        let first = usize::from(address.offset);
        let cells = self.table_mut(address.table)?.get_mut(first..first + values.len())?;
        cells.copy_from_slice(values);
        Some(())
    }

    /// Puts a value there; one bit of a register leaves the others as they are.
    pub(super) fn put(&mut self, address: Address, encoding: &Encoding, words: &[u16]) -> Option<()> {
        let DataType::Bit(bit) = encoding.data_type else { return self.write(address, words) };
        let mask = 1 << bit;
        let before = self.read(address, 1)?.first().copied()?;
        let after = words.first().copied()? & mask;
        self.write(address, &[before & !mask | after])
    }

    fn table(&self, table: Table) -> &[u16] {
        match table {
            Table::Coil => &self.coils,
            Table::Discrete => &self.discretes,
            Table::Input => &self.inputs,
            Table::Holding => &self.holdings,
            Table::Object | Table::Process => &[],
        }
    }

    fn table_mut(&mut self, table: Table) -> Option<&mut Vec<u16>> {
        Some(match table {
            Table::Coil => &mut self.coils,
            Table::Discrete => &mut self.discretes,
            Table::Input => &mut self.inputs,
            Table::Holding => &mut self.holdings,
            Table::Object | Table::Process => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_write_beyond_the_last_register_changes_nothing() {
        let mut bank = Bank::default();
        let at = |offset| Address { table: Table::Holding, offset };
        bank.reserve(at(4), 2);
        assert_eq!(bank.write(at(5), &[1, 2]), None);
        assert_eq!(bank.read(at(0), 6), Some([0; 6].as_slice()));
        assert_eq!(bank.write(at(4), &[7, 8]), Some(()));
        assert_eq!(bank.read(at(3), 3), Some([0, 7, 8].as_slice()));
        assert_eq!(bank.read(at(65535), 125), None);
    }
}
