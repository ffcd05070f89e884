//! Requests to Modbus units: reads of registers or bits, and writes of coils or holding registers.

use std::fmt;

use crate::fieldbus::listed::Listed;
use isotherm_core::codec::{Register, Table};
use isotherm_profile::Functions;

/// One request to one Modbus unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModbusRequest<'a> {
    /// Read of registers or bits. The table determines the function code, 01 to 04.
    Read {
        /// Table and address of the first register or bit.
        from: Register,
        /// Number of registers or bits.
        count: u16,
    },
    /// Write of one coil, with function 05.
    WriteCoil {
        /// Zero-based address of the coil.
        at: u16,
        /// New state of the coil: on or off.
        value: bool,
    },
    /// Write of one holding register, with function 06.
    WriteSingle {
        /// Zero-based address of the holding register.
        at: u16,
        /// New value of the register.
        value: u16,
    },
    /// Write of consecutive holding registers, with function 16.
    WriteMultiple {
        /// Zero-based address of the first holding register.
        at: u16,
        /// New values, lowest address first.
        values: &'a [u16],
    },
}

impl<'a> ModbusRequest<'a> {
    /// Returns the request that writes holding registers from `at`, with a function that the device supports.
    pub const fn write_holding(at: u16, values: &'a [u16], functions: Functions) -> ModbusRequest<'a> {
        match values {
            [value] if functions.write_single => ModbusRequest::WriteSingle { at, value: *value },
            values => ModbusRequest::WriteMultiple { at, values },
        }
    }

    /// Returns the Modbus function code, for example 3 for a read of holding registers.
    pub const fn function(self) -> u8 {
        match self {
            ModbusRequest::Read { from, .. } => from.table.read_function(),
            ModbusRequest::WriteCoil { .. } => 5,
            ModbusRequest::WriteSingle { .. } => 6,
            ModbusRequest::WriteMultiple { .. } => 16,
        }
    }

    /// Returns whether the request only reads.
    pub const fn is_read(self) -> bool {
        matches!(self, ModbusRequest::Read { .. })
    }

    /// Returns whether one Modbus message can carry the request.
    pub fn fits(self) -> bool {
        let (at, count, most) = match self {
            ModbusRequest::Read { from, count } => {
                (from.offset, count, if from.table.is_bits() { 2000 } else { 125 })
            }
            ModbusRequest::WriteCoil { at, .. } | ModbusRequest::WriteSingle { at, .. } => (at, 1, 1),
            ModbusRequest::WriteMultiple { at, values } => {
                (at, u16::try_from(values.len()).unwrap_or(u16::MAX), 123)
            }
        };
        (1..=most).contains(&count) && u32::from(at) + u32::from(count) <= 65536
    }
}

/// Formats the request: `read input:0..7`, `write holding:104 = 1 65535`.
impl fmt::Display for ModbusRequest<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let at = |table, offset| Register { table, offset };
        match *self {
            ModbusRequest::Read { from, count: 1 } => write!(f, "read {from}"),
            ModbusRequest::Read { from, count } => {
                write!(f, "read {from}..{}", u32::from(from.offset) + u32::from(count).saturating_sub(1))
            }
            ModbusRequest::WriteCoil { at: coil, value } => {
                write!(f, "write {} = {}", at(Table::Coil, coil), u8::from(value))
            }
            ModbusRequest::WriteSingle { at: register, value } => {
                write!(f, "write {} = {value}", at(Table::Holding, register))
            }
            ModbusRequest::WriteMultiple { at: register, values } => {
                write!(f, "write {} ={}", at(Table::Holding, register), Listed(values))
            }
        }
    }
}
