//! The function codes of Modbus that a device may be sent.

use schemars::JsonSchema;
use serde::Deserialize;

use isotherm_core::codec::{Address, Table};

/// A function code as `functions` names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "FunctionWord", description = "")]
pub(super) enum Function {
    ReadCoils,
    ReadDiscrete,
    ReadHolding,
    ReadInput,
    WriteCoil,
    WriteSingle,
    WriteCoils,
    WriteMultiple,
}

/// The function codes that may be sent to a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::struct_excessive_bools, reason = "eight independent permissions")]
pub struct Functions {
    /// 01
    pub read_coils: bool,
    /// 02
    pub read_discrete: bool,
    /// 03
    pub read_holding: bool,
    /// 04
    pub read_input: bool,
    /// 05
    pub write_coil: bool,
    /// 06
    pub write_single: bool,
    /// 15
    pub write_coils: bool,
    /// 16
    pub write_multiple: bool,
}

/// A function code that writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WriteFunction {
    /// 06: one register.
    Single,
    /// 16: any number of registers.
    Multiple,
}

impl WriteFunction {
    /// The code on the wire.
    pub const fn code(self) -> u8 {
        match self {
            WriteFunction::Single => 6,
            WriteFunction::Multiple => 16,
        }
    }
}

impl Functions {
    /// Every function.
    pub const ALL: Functions = Functions {
        read_coils: true,
        read_discrete: true,
        read_holding: true,
        read_input: true,
        write_coil: true,
        write_single: true,
        write_coils: true,
        write_multiple: true,
    };

    /// Those that are named.
    pub(super) fn of(named: &[Function]) -> Functions {
        let has = |function| named.contains(&function);
        Functions {
            read_coils: has(Function::ReadCoils),
            read_discrete: has(Function::ReadDiscrete),
            read_holding: has(Function::ReadHolding),
            read_input: has(Function::ReadInput),
            write_coil: has(Function::WriteCoil),
            write_single: has(Function::WriteSingle),
            write_coils: has(Function::WriteCoils),
            write_multiple: has(Function::WriteMultiple),
        }
    }

    /// Whether this function code may be sent; 0 is what is no function of Modbus.
    pub const fn allow(&self, function: u8) -> bool {
        match function {
            0 => true,
            1 => self.read_coils,
            2 => self.read_discrete,
            3 => self.read_holding,
            4 => self.read_input,
            5 => self.write_coil,
            6 => self.write_single,
            15 => self.write_coils,
            16 => self.write_multiple,
            _ => false,
        }
    }

    /// May this table be read?
    pub const fn reads(self, table: Table) -> bool {
        match table {
            Table::Coil => self.read_coils,
            Table::Discrete => self.read_discrete,
            Table::Holding => self.read_holding,
            Table::Input => self.read_input,
        }
    }

    /// May what is there be read? A value inside frames comes by itself.
    pub const fn reads_at(self, address: &Address) -> bool {
        match address {
            Address::Modbus(register) => self.reads(register.table),
            Address::Object(_) | Address::Node(_) | Address::Sensor(_) => true,
            Address::Frame(_) => false,
        }
    }

    /// What writes this many holding registers: 06 for a single one where it may be sent, else 16.
    pub const fn writes(self, registers: u16) -> Option<WriteFunction> {
        if registers == 1 && self.write_single {
            Some(WriteFunction::Single)
        } else if self.write_multiple {
            Some(WriteFunction::Multiple)
        } else {
            None
        }
    }

    /// The function code of that; 0 where nothing writes it.
    pub(crate) fn write_code(self, registers: u16) -> u8 {
        self.writes(registers).map_or(0, WriteFunction::code)
    }
}
