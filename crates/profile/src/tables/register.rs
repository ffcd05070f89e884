//! Registers and types in a profile (`register`, `type`, `word_order`, `scale`), and their display.

use std::fmt;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer};

use super::KeyContext;
use crate::document::{Json, Section, entries};
use crate::schema_of::schema_of;
pub use cell::{Bits, Cell};
use isotherm_core::codec::{Address, DataType, Encoding, Register, Scale, Table, WordOrder};

mod cell;

/// Type of a value, as named in a profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TypeWord(pub(crate) DataType);

impl TypeWord {
    const ALL: [DataType; 18] = [
        DataType::Bool,
        DataType::unsigned(8),
        DataType::signed(8),
        DataType::U16,
        DataType::I16,
        DataType::unsigned(24),
        DataType::signed(24),
        DataType::U32,
        DataType::I32,
        DataType::U64,
        DataType::I64,
        DataType::F32,
        DataType::F64,
        DataType::Decimal24(0),
        DataType::Bcd(4),
        DataType::Bcd(8),
        DataType::SignMagnitude(16),
        DataType::SignMagnitude(32),
    ];
}

impl<'de> Deserialize<'de> for TypeWord {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<TypeWord, D::Error> {
        let word = String::deserialize(deserializer)?;
        let found = TypeWord::ALL.into_iter().find(|known| known.name() == word);
        found.map(TypeWord).ok_or_else(|| serde::de::Error::custom(format!("`{word}` is not a type")))
    }
}

schema_of!(TypeWord as "TypeWord": { "type": "string", "enum": TypeWord::ALL.map(DataType::name) });

/// Order of the registers of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(description = "")]
pub(crate) enum WordOrderWord {
    MswFirst,
    LswFirst,
}

/// Single bit: a coil, a discrete input, a whole register (0 or not), or one bit of a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flag {
    /// Register, coil or discrete input.
    pub address: Register,
    /// Bit of the register, 0 to 15. `None` for a coil, a discrete input, or a whole register.
    pub bit: Option<u8>,
}

impl Flag {
    /// Returns the register value of a strobe signal that is on: only its bit is set.
    pub const fn raised(self) -> u16 {
        match self.bit {
            Some(bit) => 1 << bit,
            None => 1,
        }
    }

    /// Returns whether the bit is set in the register value `content`.
    pub const fn is_up(self, content: u16) -> bool {
        match self.bit {
            Some(bit) => content >> bit & 1 == 1,
            None => content != 0,
        }
    }

    /// Formats the bit in Modicon notation, for example as `30017.0`.
    pub fn modicon(self) -> String {
        let number = self.address.modicon();
        self.bit.map_or_else(|| number.clone(), |bit| format!("{number}.{bit}"))
    }
}

impl FromStr for Flag {
    type Err = String;

    /// Parses `coil:20`, `input:16` or `input:16.0`.
    ///
    /// # Errors
    /// A sentence with the allowed notations.
    fn from_str(text: &str) -> Result<Flag, String> {
        let (register, bit) = match text.split_once('.') {
            Some((register, bit)) => (register, Some(bit.trim())),
            None => (text, None),
        };
        let address: Register = register.parse()?;
        let Some(bit) = bit else { return Ok(Flag { address, bit: None }) };
        if matches!(address.table, Table::Coil | Table::Discrete) {
            return Err(format!("{address} is one bit already: write it without `.{bit}`"));
        }
        match bit.parse() {
            Ok(bit @ 0..=15) => Ok(Flag { address, bit: Some(bit) }),
            _ => Err(format!("`{bit}` is not a bit of a register; allowed: 0 to 15")),
        }
    }
}

impl fmt::Display for Flag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.bit {
            Some(bit) => write!(f, "{}.{bit}", self.address),
            None => write!(f, "{}", self.address),
        }
    }
}

/// Address as the preview shows it: in one or two notations. Only a register has two notations.
pub(crate) struct Notation {
    /// Zero-based notation of a register, for example `holding:104`. For another address, its only notation: `object
    /// 6150:01`; `0x185, 16 bits from 0 up (Intel), signed`.
    protocol: String,
    /// One-based Modicon notation: `40105`. Empty if the address is not a register.
    modicon: String,
}

impl Notation {
    /// Creates the notation of an address with a value of this type.
    pub(crate) fn of(address: &Address, data_type: DataType) -> Notation {
        match (address, data_type) {
            (Address::Modbus(address), DataType::Bit(bit)) => {
                Flag { address: *address, bit: Some(bit) }.into()
            }
            (Address::Modbus(register), DataType::Part(part)) => Notation {
                protocol: format!("{register}.{part}"),
                modicon: format!("{}.{part}", register.modicon()),
            },
            (Address::Modbus(register), _) => (*register).into(),
            (other, _) => Notation { protocol: other.to_string(), modicon: String::new() },
        }
    }
}

impl From<Flag> for Notation {
    fn from(flag: Flag) -> Notation {
        Notation { protocol: flag.to_string(), modicon: flag.modicon() }
    }
}

impl From<Register> for Notation {
    fn from(address: Register) -> Notation {
        Flag { address, bit: None }.into()
    }
}

impl From<Notation> for Json {
    fn from(notation: Notation) -> Json {
        let mut section = Section::default();
        entries!(section, protocol = notation.protocol, modicon = notation.modicon);
        section.into()
    }
}

impl fmt::Display for Notation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.modicon.as_str() {
            "" => f.write_str(&self.protocol),
            modicon => write!(f, "{} ({modicon})", self.protocol),
        }
    }
}

/// Formats the order of a value's registers for the preview. `None` if the value has only one
/// register, or is not in registers.
pub(crate) fn shown_order(address: &Address, encoding: &Encoding) -> Option<String> {
    let is_long = encoding.data_type.registers() > 1 && address.register().is_some();
    is_long.then(|| encoding.word_order.to_string())
}

/// Creates the encoding of an unscaled count: scale 1, no offset, no bias.
pub(crate) fn plain(data_type: DataType) -> Encoding {
    Encoding {
        data_type,
        word_order: WordOrder::MswFirst,
        byte_swap: false,
        scale: Scale::ONE,
        offset: 0.0,
        bias: 0,
        bad: Vec::new(),
    }
}

/// Returns the type of a value that occupies only this register: `U16`, or `Bool` for a coil or a discrete input.
pub(crate) fn one(register: Register) -> DataType {
    if register.table.is_bits() { DataType::Bool } else { DataType::U16 }
}

/// Returns the noun after "per" in the preview of a scale, as in "0.1 µm per count". The noun is "count", or
/// "unit" for an OPC UA node with a floating-point type.
pub(crate) fn one_of(address: &Address) -> &'static str {
    match address.node().map(|node| node.taken_as().integer_range()) {
        Some(None) => "unit",
        _ => "count",
    }
}

/// Parses the register at this key. Reports an error and returns `None` if the text is invalid.
pub(crate) fn register(at: &KeyContext<'_>, text: Option<&String>) -> Option<Register> {
    let text = text?;
    let why = match text.parse::<Register>() {
        Ok(address) => return Some(address),
        Err(why) => why,
    };
    let (table, _) = text.split_once(':').unwrap_or_default();
    let near = crate::error::nearest(table, &["coil", "discrete", "input", "holding"]);
    let near = near.filter(|near| *near != table && !table.is_empty());
    let (message, help) = why.split_once("; ").unwrap_or((&why, "write \"input:0\" or \"30001\""));
    let near = near.map(|near| format!("did you mean `{near}`? ")).unwrap_or_default();
    at.reject(message, format!("{near}{help}"))
}

/// Parses a register, one bit of a register, or several bits. Reports an error and returns `None` if the text is
/// invalid.
pub(crate) fn cell(at: &KeyContext<'_>, text: &String) -> Option<Cell> {
    match text.parse::<Cell>() {
        Ok(cell) => Some(cell),
        Err(_) if !text.contains('.') => {
            register(at, Some(text)).map(|address| Cell { address, bits: Bits::All })
        }
        Err(message) => {
            let help = "write a register as \"input:50\", or one bit of it as \"input:50.3\", or several bits as \
                        \"input:50.4-7\"";
            at.reject(message, help)
        }
    }
}

/// Parses a holding register. Reports an error and returns `None` for any other register.
pub(crate) fn holding(at: &KeyContext<'_>, text: Option<&String>) -> Option<Register> {
    let address = register(at, text)?;
    if address.table == Table::Holding {
        return Some(address);
    }
    let message = if address.table.is_writable() {
        format!("{address} is one bit, which cannot hold this value")
    } else {
        format!("{address} cannot be written: {} registers are read-only", address.table.name())
    };
    at.reject(message, "write to a holding register, as \"holding:100\" or \"40101\"")
}

/// Reports a value whose registers extend beyond the last register address.
pub(crate) fn fits(at: &KeyContext<'_>, address: Register, data_type: DataType) {
    let last = u32::from(address.offset) + u32::from(data_type.registers()) - 1;
    if last > u32::from(u16::MAX) {
        let message = format!("{} at {address} ends at {last}, beyond the last register", data_type.name());
        at.invalid(message, "allowed: addresses up to 65535");
    }
}

/// Resolves the key `word_order`. Without the key, a value of one register has the order `MswFirst`. For a
/// longer value, reports the missing key and returns `None`. Also returns `None` if the type is not known.
pub(crate) fn word_order(
    at: &KeyContext<'_>,
    data_type: Option<DataType>,
    given: Option<WordOrderWord>,
) -> Option<WordOrder> {
    let data_type = data_type?;
    match given {
        Some(WordOrderWord::LswFirst) => Some(WordOrder::LswFirst),
        Some(WordOrderWord::MswFirst) => Some(WordOrder::MswFirst),
        None if data_type.registers() == 1 => Some(WordOrder::MswFirst),
        None => {
            let (name, registers) = (data_type.name(), data_type.registers());
            let message = format!("`word_order` is missing: {name} needs {registers} registers");
            let help = "write \"msw-first\" (most significant register first) or \"lsw-first\"; the manual \
                        of the device says which";
            at.missing(message, help);
            None
        }
    }
}

pub(crate) fn scale(at: &KeyContext<'_>, scale: f64) -> Option<Scale> {
    if scale.abs() < f64::MIN_POSITIVE {
        return at.reject("a scale of zero makes every value the same", "write the value of one count");
    }
    Some(Scale::of(scale))
}

/// Reports a type that the gateway only reads, and returns `None`. Returns any other type unchanged. Devices
/// expect the sign of a 24-bit value in different bits. No device is known that accepts writes of the other
/// types.
pub(crate) fn not_only_read(at: &KeyContext<'_>, data_type: Option<DataType>) -> Option<DataType> {
    let data_type = data_type?;
    if data_type.width() != 24 && !is_of_registers(data_type) {
        return Some(data_type);
    }
    let help = "use \"u16\", \"i16\", \"u32\" or \"i32\", if the device accepts it";
    at.invalid(format!("{} is only read from registers, not written", data_type.name()), help);
    None
}

/// Returns whether only signals in Modbus registers can have this type, so that displays, CANopen objects and OPC UA
/// nodes cannot have it.
pub(crate) const fn is_of_registers(data_type: DataType) -> bool {
    matches!(data_type, DataType::Bcd(_) | DataType::SignMagnitude(_))
}

/// Reports a type of 8 bits, which is smaller than a register.
pub(crate) fn not_smaller_than_a_register(at: &KeyContext<'_>, kind: Option<TypeWord>, help: &str) {
    if let Some(TypeWord(small)) = kind.filter(|kind| kind.0.width() == 8) {
        at.invalid(format!("{} is smaller than a register", small.name()), help);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_is_a_bit_a_register_or_a_bit_of_a_register() {
        let flag = |text: &str| text.parse::<Flag>().unwrap();
        assert_eq!((flag("coil:20").raised(), flag("coil:20").to_string().as_str()), (1, "coil:20"));
        assert_eq!((flag("holding:7").raised(), flag("holding:7.3").raised()), (1, 8));
        assert!(flag("input:7").is_up(4) && !flag("input:7").is_up(0));
        assert!(flag("input:7.2").is_up(4) && !flag("input:7.2").is_up(11));
        assert_eq!((flag("30008.2"), flag("input:7.2").modicon().as_str()), (flag("input:7.2"), "30008.2"));
        for (text, word) in [("coil:2.0", "one bit"), ("input:2.16", "0 to 15"), ("input:2.", "0 to 15")] {
            assert!(text.parse::<Flag>().unwrap_err().contains(word), "{text}");
        }
    }
}
