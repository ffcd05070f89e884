//! Calculates the lengths of Modbus frames, from which the load of a serial line is calculated.
//!
//! A value without a register, for example an OPC UA node, counts as the shortest request.

use super::functions::WriteFunction;
use crate::Device;
use crate::plan::ReadRequest;
use isotherm_core::codec::{Address, Register, Table};

/// Returns the register of an address. An address that is not a register, such as an OPC UA node, counts as a holding
/// register, which has the shortest request.
pub(crate) fn register_for(address: &Address) -> Register {
    address.register().unwrap_or(holding(0))
}

pub(crate) const fn holding(offset: u16) -> Register {
    Register { table: Table::Holding, offset }
}

/// Returns the lengths of a read request and of its answer, in bytes with unit and checksum. Both are 0 for a request
/// that reads no registers.
pub(crate) fn read_frames(request: &ReadRequest) -> (usize, usize) {
    request.span().map_or((0, 0), |(from, count)| cells_read(from.table, count))
}

/// Returns the lengths of a request and its answer for reading this many registers, in bytes with unit and checksum.
pub(crate) fn read_cells(address: &Address, registers: u16) -> (usize, usize) {
    cells_read(register_for(address).table, registers)
}

pub(crate) fn registers_read(count: u16) -> (usize, usize) {
    cells_read(Table::Holding, count)
}

pub(crate) fn cells_read(table: Table, count: u16) -> (usize, usize) {
    let count = usize::from(count);
    (8, 5 + if table.is_bits() { count.div_ceil(8) } else { 2 * count })
}

pub(crate) fn write_frames(device: &Device, at: Register, registers: u16) -> (usize, usize) {
    match device.functions.writes(registers) {
        Some(WriteFunction::Multiple) if !at.table.is_bits() => (9 + 2 * usize::from(registers), 8),
        _ => (8, 8),
    }
}
