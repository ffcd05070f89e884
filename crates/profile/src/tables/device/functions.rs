//! Modbus function codes that may be sent to a device.

use schemars::JsonSchema;
use serde::Deserialize;

use isotherm_core::codec::{Address, Table};

/// Function code, as named in `functions`.
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

/// Function codes that may be sent to a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "eight independent permissions")]
pub struct Functions {
    /// Function 01 is allowed.
    pub read_coils: bool,
    /// Function 02 is allowed.
    pub read_discrete: bool,
    /// Function 03 is allowed.
    pub read_holding: bool,
    /// Function 04 is allowed.
    pub read_input: bool,
    /// Function 05 is allowed.
    pub write_coil: bool,
    /// Function 06 is allowed.
    pub write_single: bool,
    /// Function 15 is allowed.
    pub write_coils: bool,
    /// Function 16 is allowed.
    pub write_multiple: bool,
}

/// Function code for writing registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WriteFunction {
    /// Function 06, one register.
    Single,
    /// Function 16, any number of registers.
    Multiple,
}

impl WriteFunction {
    /// Function code on the wire.
    pub const fn code(self) -> u8 {
        match self {
            WriteFunction::Single => 6,
            WriteFunction::Multiple => 16,
        }
    }
}

impl Functions {
    /// All functions are allowed.
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

    /// Returns the permissions for the named functions.
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

    /// Returns whether this function code may be sent. 0 means an exchange without a Modbus function.
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

    /// Returns whether this table may be read.
    pub const fn reads(self, table: Table) -> bool {
        match table {
            Table::Coil => self.read_coils,
            Table::Discrete => self.read_discrete,
            Table::Holding => self.read_holding,
            Table::Input => self.read_input,
        }
    }

    /// Returns whether this address may be read. A value in frames is not requested.
    pub const fn reads_at(self, address: &Address) -> bool {
        match address {
            Address::Modbus(register) => self.reads(register.table),
            Address::Object(_) | Address::Node(_) | Address::Sensor(_) => true,
            Address::Frame(_) => false,
        }
    }

    /// Returns the function that writes this number of holding registers. For one register it is 06 if allowed,
    /// otherwise
    /// 16. `None` if neither is allowed.
    pub const fn writes(self, registers: u16) -> Option<WriteFunction> {
        if registers == 1 && self.write_single {
            Some(WriteFunction::Single)
        } else if self.write_multiple {
            Some(WriteFunction::Multiple)
        } else {
            None
        }
    }

    /// Returns the function code for writing this number of registers. 0 if there is none.
    pub(crate) fn write_code(self, registers: u16) -> u8 {
        self.writes(registers).map_or(0, WriteFunction::code)
    }
}
