//! Modbus function codes that may be sent to a device.

use schemars::JsonSchema;
use serde::Deserialize;

use isotherm_core::codec::{Address, Table};

/// Generates the types for function codes. Each line of the macro call has the code, its word in a profile, and the
/// field for its permission.
macro_rules! functions {
    ($($code:literal $word:ident $permission:ident),+) => {
        /// Function code, as the key `functions` of a device names it.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
        #[serde(rename_all = "kebab-case")]
        #[schemars(rename = "FunctionWord", description = "")]
        pub(crate) enum Function {
            $($word,)+
        }

        /// Permissions to send function codes to a device, one for each function code.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[allow(clippy::struct_excessive_bools, reason = "eight independent permissions")]
        pub struct Functions {
            $(
                #[doc = concat!("Function ", $code, " is allowed.")]
                pub $permission: bool,
            )+
        }

        impl Functions {
            /// Permissions with which every function may be sent.
            pub const ALL: Functions = Functions { $($permission: true,)+ };

            /// Returns permissions for only the named functions.
            pub(crate) fn of(named: &[Function]) -> Functions {
                Functions { $($permission: named.contains(&Function::$word),)+ }
            }

            /// Returns whether this function code may be sent. Code 0 means an exchange without a Modbus function,
            /// which is always allowed.
            pub const fn allow(&self, function: u8) -> bool {
                match function {
                    0 => true,
                    $($code => self.$permission,)+
                    _ => false,
                }
            }
        }
    };
}

functions! {
    1 ReadCoils read_coils,
    2 ReadDiscrete read_discrete,
    3 ReadHolding read_holding,
    4 ReadInput read_input,
    5 WriteCoil write_coil,
    6 WriteSingle write_single,
    15 WriteCoils write_coils,
    16 WriteMultiple write_multiple
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
    /// Returns the function code: 6 or 16.
    pub const fn code(self) -> u8 {
        match self {
            WriteFunction::Single => 6,
            WriteFunction::Multiple => 16,
        }
    }
}

impl Functions {
    /// Returns whether this Modbus table may be read: coils, discrete inputs, input registers or holding registers.
    pub const fn reads(self, table: Table) -> bool {
        match table {
            Table::Coil => self.read_coils,
            Table::Discrete => self.read_discrete,
            Table::Holding => self.read_holding,
            Table::Input => self.read_input,
        }
    }

    /// Returns whether this address may be read. Always `false` for a value in CAN frames, which arrives without a
    /// request.
    pub const fn reads_at(self, address: &Address) -> bool {
        match address {
            Address::Modbus(register) => self.reads(register.table),
            _ => !address.is_in_frames(),
        }
    }

    /// Returns the function that writes this number of holding registers. For one register, this is function 06 if
    /// allowed, otherwise function 16. `None` if no allowed function can write them.
    pub const fn writes(self, registers: u16) -> Option<WriteFunction> {
        if registers == 1 && self.write_single {
            Some(WriteFunction::Single)
        } else if self.write_multiple {
            Some(WriteFunction::Multiple)
        } else {
            None
        }
    }

    /// Returns the function code for writing this number of registers. Returns 0 if no allowed function can write them.
    pub(crate) fn write_code(self, registers: u16) -> u8 {
        self.writes(registers).map_or(0, WriteFunction::code)
    }
}
