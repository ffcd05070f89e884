//! The tables of one virtual device.

use crate::codec::{Address, DataType, Encoding, Table};

/// Registers and bits of a device: every address up to the last one in use exists. The values of a CAN device are kept
/// as registers too, each address of theirs with room for the longest.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Bank {
    coils: Vec<u16>,
    discretes: Vec<u16>,
    inputs: Vec<u16>,
    holdings: Vec<u16>,
    objects: Vec<u16>,
    processes: Vec<u16>,
}

/// The registers of a value of 64 bits.
const LONGEST: usize = 4;

impl Bank {
    /// Makes room for this many cells from `address` on.
    pub(super) fn reserve(&mut self, address: Address, count: u16) {
        let needed = first(address) + usize::from(count);
        let cells = self.table_mut(address.table);
        if cells.len() < needed {
            cells.resize(needed, 0);
        }
    }

    /// The cells from `offset` on; bits are 0 or 1. `None` where one of them does not exist.
    pub(super) fn read(&self, address: Address, count: u16) -> Option<&[u16]> {
        let first = first(address);
        self.table(address.table).get(first..first + usize::from(count))
    }

    /// Puts values into the cells from `offset` on; `None`, and nothing changed, where one does not exist.
    pub(super) fn write(&mut self, address: Address, values: &[u16]) -> Option<()> {
        let first = first(address);
        let cells = self.table_mut(address.table).get_mut(first..first + values.len())?;
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
            Table::Object => &self.objects,
            Table::Process => &self.processes,
        }
    }

    fn table_mut(&mut self, table: Table) -> &mut Vec<u16> {
        match table {
            Table::Coil => &mut self.coils,
            Table::Discrete => &mut self.discretes,
            Table::Input => &mut self.inputs,
            Table::Holding => &mut self.holdings,
            Table::Object => &mut self.objects,
            Table::Process => &mut self.processes,
        }
    }
}

fn first(address: Address) -> usize {
    usize::from(address.offset) * if address.table.is_can() { LONGEST } else { 1 }
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

    #[test]
    fn long_values_of_a_can_device_do_not_run_into_each_other() {
        let mut bank = Bank::default();
        let at = |offset| Address { table: Table::Object, offset };
        bank.reserve(at(0), 2);
        bank.reserve(at(1), 4);
        assert_eq!(bank.write(at(0), &[1, 2]), Some(()));
        assert_eq!(bank.write(at(1), &[3, 4, 5, 6]), Some(()));
        assert_eq!(bank.read(at(0), 2), Some([1, 2].as_slice()));
        assert_eq!(bank.read(at(1), 4), Some([3, 4, 5, 6].as_slice()));
        assert_eq!(bank.read(Address { table: Table::Process, offset: 0 }, 1), None);
    }
}
