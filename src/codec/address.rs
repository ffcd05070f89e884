//! Register addresses in both notations people use: `input:0` (protocol, zero-based) and `30001` (Modicon, one-based).

use std::fmt;
use std::str::FromStr;

/// The four tables of a Modbus device, and the two that the values of a CAN device are kept in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Table {
    /// Single bits, read and written. Modicon 0xxxx.
    Coil,
    /// Single bits, read only. Modicon 1xxxx.
    Discrete,
    /// 16-bit registers, read only. Modicon 3xxxx.
    Input,
    /// 16-bit registers, read and written. Modicon 4xxxx.
    Holding,
    /// CANopen objects, read and written by SDO; the address is a place in the device's list of objects.
    Object,
    /// Values inside CAN frames; the address is a place in the device's list of fields.
    Process,
}

/// A place in one table, as the protocol counts it: from zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address {
    /// Which table.
    pub table: Table,
    /// Zero-based protocol address.
    pub offset: u16,
}

impl Table {
    /// Those of Modbus.
    const ALL: [Table; 4] = [Table::Coil, Table::Discrete, Table::Input, Table::Holding];

    /// The word of the profile for it.
    pub const fn name(self) -> &'static str {
        match self {
            Table::Coil => "coil",
            Table::Discrete => "discrete",
            Table::Input => "input",
            Table::Holding => "holding",
            Table::Object => "object",
            Table::Process => "process",
        }
    }

    /// Its cells are single bits.
    pub const fn is_bits(self) -> bool {
        matches!(self, Table::Coil | Table::Discrete)
    }

    /// It belongs to a CAN device.
    pub const fn is_can(self) -> bool {
        matches!(self, Table::Object | Table::Process)
    }

    /// A master may write to it.
    pub const fn is_writable(self) -> bool {
        matches!(self, Table::Coil | Table::Holding | Table::Object | Table::Process)
    }

    /// The function code that reads it; 0 where none does.
    pub const fn read_function(self) -> u8 {
        match self {
            Table::Coil => 1,
            Table::Discrete => 2,
            Table::Holding => 3,
            Table::Input => 4,
            Table::Object | Table::Process => 0,
        }
    }

    /// The first digit of its Modicon numbers.
    const fn digit(self) -> Option<u32> {
        match self {
            Table::Coil => Some(0),
            Table::Discrete => Some(1),
            Table::Input => Some(3),
            Table::Holding => Some(4),
            Table::Object | Table::Process => None,
        }
    }
}

impl Address {
    /// The one-based Modicon number: five digits, six above 9999. Empty for what is no register.
    pub fn modicon(self) -> String {
        let number = u32::from(self.offset) + 1;
        match self.table.digit() {
            Some(digit) if number > 9999 => format!("{digit}{number:05}"),
            Some(digit) => format!("{digit}{number:04}"),
            None => String::new(),
        }
    }
}

impl FromStr for Address {
    type Err = String;

    /// # Errors
    /// A sentence that says what is allowed.
    fn from_str(text: &str) -> Result<Address, String> {
        if let Some((table, offset)) = text.split_once(':') {
            let table =
                Table::ALL.into_iter().find(|known| known.name() == table.trim()).ok_or_else(|| {
                    format!("`{table}` is no register table; allowed: coil, discrete, input, holding")
                })?;
            let offset = offset.trim().parse().map_err(|_| {
                format!(
                    "`{}` is no address; allowed: 0 to 65535 (zero-based protocol address)",
                    offset.trim()
                )
            })?;
            return Ok(Address { table, offset });
        }
        modicon(text.trim()).ok_or_else(|| {
            format!(
                "`{text}` is no register; write a zero-based protocol address (\"input:0\", \"holding:100\") or a \
                 one-based Modicon number (\"30001\", \"40101\")"
            )
        })
    }
}

fn modicon(text: &str) -> Option<Address> {
    if !(text.len() == 5 || text.len() == 6) || !text.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let (digit, number) = text.split_at(1);
    let table = Table::ALL.into_iter().find(|table| digit.parse().ok() == table.digit())?;
    let number: u32 = number.parse().ok()?;
    let offset = u16::try_from(number.checked_sub(1)?).ok()?;
    Some(Address { table, offset })
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.table.name(), self.offset)
    }
}
