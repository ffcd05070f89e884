//! Addresses of values: registers, CANopen objects, CAN frames, nodes of an OPC UA server, sensors of this computer,
//! and texts.
//!
//! Registers have two notations: `input:0` (protocol address, zero-based) and `30001` (Modicon number, one-based).

use std::fmt;
use std::str::FromStr;

use super::{Field, Node, Object, PcSensor, TextValue};

/// Address of a value on a bus of any kind, or of a sensor of this computer.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Address {
    /// First of the Modbus registers of the value, or its coil or discrete input.
    Modbus(Register),
    /// CANopen object, read and written by SDO.
    Object(Object),
    /// Field of CAN frames that a node sends without a request.
    Frame(Field),
    /// Node of an OPC UA server, which the gateway reads or writes as one value.
    Node(Node),
    /// Temperature sensor that the kernel of this computer reads, for example on a 1-Wire bus.
    Sensor(PcSensor),
    /// Number in a line of text that the device sends.
    Text(TextValue),
}

/// The four tables of a Modbus device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Table {
    /// Single bits that can be read and written, with Modicon numbers 0xxxx.
    Coil,
    /// Single bits that can only be read, with Modicon numbers 1xxxx.
    Discrete,
    /// 16-bit registers that can only be read, with Modicon numbers 3xxxx.
    Input,
    /// 16-bit registers that can be read and written, with Modicon numbers 4xxxx.
    Holding,
}

/// Register, coil or discrete input of a Modbus device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Register {
    /// Table that contains the register, coil or discrete input.
    pub table: Table,
    /// Zero-based protocol address.
    pub offset: u16,
}

impl Table {
    const ALL: [Table; 4] = [Table::Coil, Table::Discrete, Table::Input, Table::Holding];

    /// Returns the name of the table in the profile: `coil`, `discrete`, `input` or `holding`.
    pub const fn name(self) -> &'static str {
        match self {
            Table::Coil => "coil",
            Table::Discrete => "discrete",
            Table::Input => "input",
            Table::Holding => "holding",
        }
    }

    /// Returns whether the Modbus table consists of single bits, not of registers.
    pub const fn is_bits(self) -> bool {
        matches!(self, Table::Coil | Table::Discrete)
    }

    /// Returns whether a Modbus client can write to the table.
    pub const fn is_writable(self) -> bool {
        matches!(self, Table::Coil | Table::Holding)
    }

    /// Returns the Modbus function code for reading the table.
    pub const fn read_function(self) -> u8 {
        match self {
            Table::Coil => 1,
            Table::Discrete => 2,
            Table::Holding => 3,
            Table::Input => 4,
        }
    }

    /// Returns the first digit of the Modicon numbers of the table.
    const fn digit(self) -> u32 {
        match self {
            Table::Coil => 0,
            Table::Discrete => 1,
            Table::Input => 3,
            Table::Holding => 4,
        }
    }
}

impl Address {
    /// Returns the first register of the value. `None` for any other kind of address.
    pub const fn register(&self) -> Option<Register> {
        if let Address::Modbus(register) = self { Some(*register) } else { None }
    }

    /// Returns the OPC UA node of the value. `None` for any other kind of address.
    pub const fn node(&self) -> Option<&Node> {
        if let Address::Node(node) = self { Some(node) } else { None }
    }

    /// Returns the sensor of this computer. `None` for any other kind of address.
    pub const fn sensor(&self) -> Option<&PcSensor> {
        if let Address::Sensor(sensor) = self { Some(sensor) } else { None }
    }

    /// Returns the value in a line of text. `None` for any other kind of address.
    pub const fn text(&self) -> Option<&TextValue> {
        if let Address::Text(text) = self { Some(text) } else { None }
    }

    /// Returns whether the value arrives in CAN frames, without a request.
    pub const fn is_in_frames(&self) -> bool {
        matches!(self, Address::Frame(_))
    }

    /// Returns whether the value is a coil or discrete input.
    pub fn is_bit(&self) -> bool {
        self.register().is_some_and(|register| register.table.is_bits())
    }
}

impl Register {
    /// Returns the one-based Modicon number: five digits, or six digits above 9999.
    pub fn modicon(self) -> String {
        let (digit, number) = (self.table.digit(), u32::from(self.offset) + 1);
        if number > 9999 { format!("{digit}{number:05}") } else { format!("{digit}{number:04}") }
    }
}

impl FromStr for Register {
    type Err = String;

    /// Parses a register in either notation: `holding:100` or `40101`.
    ///
    /// # Errors
    /// Returns a sentence with the allowed notations.
    fn from_str(text: &str) -> Result<Register, String> {
        if let Some((table, offset)) = text.split_once(':') {
            let table =
                Table::ALL.into_iter().find(|known| known.name() == table.trim()).ok_or_else(|| {
                    format!("`{table}` is not a register table; allowed: coil, discrete, input, holding")
                })?;
            let offset = offset.trim().parse().map_err(|_| {
                format!(
                    "`{}` is not an address; allowed: 0 to 65535 (zero-based protocol address)",
                    offset.trim()
                )
            })?;
            return Ok(Register { table, offset });
        }
        modicon(text.trim()).ok_or_else(|| {
            format!(
                "`{text}` is not a register; write a zero-based protocol address (\"input:0\", \"holding:100\") or a \
                 one-based Modicon number (\"30001\", \"40101\")"
            )
        })
    }
}

fn modicon(text: &str) -> Option<Register> {
    if !(text.len() == 5 || text.len() == 6) || !text.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let (digit, number) = text.split_at(1);
    let table = Table::ALL.into_iter().find(|table| digit.parse() == Ok(table.digit()))?;
    let number: u32 = number.parse().ok()?;
    let offset = u16::try_from(number.checked_sub(1)?).ok()?;
    Some(Register { table, offset })
}

impl From<Register> for Address {
    fn from(register: Register) -> Address {
        Address::Modbus(register)
    }
}

impl fmt::Display for Register {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.table.name(), self.offset)
    }
}

/// Formats the address for messages: `holding:104 (40105)`, `object 6150:01`, `0x20c, 32 bits from 0 up (Intel),
/// signed`, `node ns=2;i=5`, `sensor w1:28-0316a2794f01`, `text "{number} mm"`.
impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Address::Modbus(register) => write!(f, "{register} ({})", register.modicon()),
            Address::Object(object) => write!(f, "object {object}"),
            Address::Frame(field) => write!(f, "{field}"),
            Address::Node(node) => write!(f, "node {node}"),
            Address::Sensor(sensor) => write!(f, "sensor {sensor}"),
            Address::Text(text) => write!(f, "{text}"),
        }
    }
}
