//! `verify` of a device: values that are read before arming and again in operation, and compared with expected values.

use std::fmt;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::document::{Section, entries};
use crate::duration::{Timespan, shown};
use crate::kinds::can::fields;
use crate::kinds::modbus::functions::Functions;
use crate::kinds::opcua::nodes;
use crate::tables::KeyContext;
use crate::tables::register::{Bits, Cell, TypeWord, WordOrderWord, cell, fits, plain, word_order};
use isotherm_core::codec::{Address, DataType, Encoding, Object};
use isotherm_core::continuity::{CheckFailure, Difference};
use isotherm_core::reading::Reason;

/// Default period of a check.
const EVERY: Duration = Duration::from_secs(60);

/// Register, object or node that is read before arming and in operation.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Verify")]
pub(crate) struct RawVerify {
    /// Register, coil, discrete input, or bits of a register, for example "holding:256", "coil:268", "holding:116.5",
    /// "holding:116.4-7".
    register: Option<String>,
    /// CANopen: index and sub-index in hexadecimal, for example "6110:01".
    #[schemars(regex(pattern = "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"))]
    pub(crate) sdo: Option<String>,
    /// OPC UA: node, for example "ns=2;s=/Nck/State". Requires `type`.
    node: Option<String>,
    /// Type of the value. Default: "bool" for a single bit, otherwise "u16". Required for a node.
    #[serde(rename = "type")]
    kind: Option<TypeWord>,
    /// Order of the registers. Required for 32 bits and more.
    word_order: Option<WordOrderWord>,
    /// Expected value. A mismatch prevents arming.
    #[schemars(required)]
    equals: Option<i64>,
    /// Meaning of the value, for messages, for example "data format: engineering units".
    what: Option<String>,
    /// Remedy for a different value, for messages.
    remedy: Option<String>,
    /// Period of the check in operation. The gateway extends the period if the checks would take more than 1 % of the
    /// line's time. Default "1min".
    every: Option<Timespan>,
}

/// Register, object or node whose value must equal a number in the profile, for example a type code or a data format.
#[derive(Clone, Debug, PartialEq)]
pub struct Expected {
    /// First register, bit, object or node.
    pub address: Address,
    /// Encoding of the value. Its scale is 1, because raw values are compared.
    pub encoding: Encoding,
    /// Value that the profile expects.
    pub equals: i64,
    /// Meaning of the value, which messages show next to the value.
    pub what: String,
    /// Remedy if the device has a different value, for messages.
    pub remedy: String,
    /// Period of the check in operation. The gateway extends it if the checks would take too much of the line's time.
    pub every: Duration,
}

impl Expected {
    /// Returns the preview of the check with this period.
    pub(crate) fn preview(&self, period: Duration) -> Section {
        let Expected { equals, what, .. } = self;
        let mut section = Section::default();
        let every = shown(period);
        section.line(format!("    before arming and every {every}, {self} must read {equals}: {what}"));
        entries!(section, every, register = self.to_string(), equals, what);
        section
    }

    /// Compares the read registers with the expected value. Returns the difference, or `None` if the values are equal.
    pub fn mismatch(&self, registers: &[u16]) -> Option<Difference> {
        match self.encoding.counts(registers) {
            Some(counts) if counts.0 == self.equals => None,
            Some(counts) => Some(self.differs(CheckFailure::Value(counts.to_string()))),
            None => Some(self.differs(CheckFailure::Value(Reason::BadReply.to_string()))),
        }
    }

    /// Creates the difference for a register that the device reports as missing. `why` is the answer of the device.
    pub fn absent(&self, why: impl fmt::Display) -> Difference {
        self.differs(CheckFailure::Absent(why.to_string()))
    }

    /// Creates the difference for a value that could not be read. `why` is the reason.
    pub fn unreadable(&self, why: impl fmt::Display) -> Difference {
        self.differs(CheckFailure::Unreadable(why.to_string()))
    }

    fn differs(&self, is: CheckFailure) -> Difference {
        let (meaning, remedy) = (self.what.clone(), self.remedy.clone());
        Difference { what: self.to_string(), was: self.equals.to_string(), is, meaning, remedy }
    }
}

impl fmt::Display for Expected {
    /// Formats the address: `coil:268 (00269)`, `holding:116.5 (40117.5)`, `object 6110:01`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.address, self.encoding.data_type) {
            (Address::Modbus(register), DataType::Bit(bit)) => {
                write!(f, "{register}.{bit} ({}.{bit})", register.modicon())
            }
            (Address::Modbus(register), DataType::Part(part)) => {
                write!(f, "{register}.{part} ({}.{part})", register.modicon())
            }
            (address, _) => write!(f, "{address}"),
        }
    }
}

impl RawVerify {
    /// Resolves a check of a Modbus device.
    pub(crate) fn register(&self, at: &KeyContext<'_>, functions: Functions) -> Option<Expected> {
        if self.sdo.is_some() {
            return None;
        }
        let place = at.key("register");
        let help = "write `register`, as \"coil:268\" or \"holding:256\"";
        place.missing("`register` is missing: which register does the check read?", help);
        let cell = cell(&place, self.register.as_ref()?)?;
        let table = cell.address.table;
        if !functions.reads(table) {
            let message = format!(
                "{} cannot be read: reading {} registers is not among the `functions` of the device",
                cell.address,
                table.name()
            );
            place.invalid(message, "add this function, if the device supports it, or remove the check");
        }
        let kind = self.kind.map(|TypeWord(kind)| kind);
        let data_type = match cell.bits {
            Bits::One(bit) => DataType::Bit(bit),
            Bits::Range(first, last) => Cell::part(at, (first, last), kind)?,
            Bits::All if table.is_bits() => DataType::Bool,
            Bits::All => kind.unwrap_or(DataType::U16),
        };
        let equals = self.equal(at, data_type)?;
        let word_order = word_order(&at.key("word_order"), Some(data_type), self.word_order)?;
        fits(&place, cell.address, data_type);
        let encoding = Encoding { word_order, ..plain(data_type) };
        Some(self.expected(at, cell.address.into(), encoding, equals))
    }

    /// Resolves a check of a CANopen node.
    pub(crate) fn object(&self, at: &KeyContext<'_>) -> Option<Expected> {
        let help = "remove this key, and write sdo = \"6110:01\"";
        at.not_applicable(&["register", "word_order"], "a Modbus device", help);
        if self.register.is_none() {
            at.key("sdo").missing(
                "`sdo` is missing: which object does the check read?",
                "write `sdo`, as \"6110:01\"",
            );
        }
        let entry = fields::entry(&at.key("sdo"), self.sdo.as_ref()?);
        let kind = self.kind.unwrap_or(TypeWord(DataType::U16));
        let data_type = fields::object_type(&at.key("type"), kind)?;
        let equals = self.equal(at, data_type)?;
        let address = Address::Object(Object { entry: entry?, data_type });
        Some(self.expected(at, address, plain(data_type), equals))
    }

    /// Resolves a check of an OPC UA server.
    pub(crate) fn node(&self, at: &KeyContext<'_>) -> Option<Expected> {
        let help = "write node = \"ns=2;s=…\" instead of `register`";
        at.not_applicable(&["register", "word_order", "sdo"], "a device on another kind of line", help);
        let node = nodes::compared(at, self.node.as_ref(), self.kind)?;
        let data_type = node.taken_as();
        let equals = self.equal(at, data_type)?;
        Some(self.expected(at, Address::Node(node), plain(data_type), equals))
    }

    /// Returns the expected value, after checking that the type can hold it.
    fn equal(&self, at: &KeyContext<'_>, data_type: DataType) -> Option<i64> {
        let Some((low, high)) = data_type.integer_range() else {
            let help = "use an integer type: u16, i16, u32, i32, …";
            return at.key("type").reject("a check cannot compare floating-point values exactly", help);
        };
        let equals = self.equals?;
        if !(low..=high).contains(&i128::from(equals)) {
            let message = format!("{} cannot contain {equals}", data_type.name());
            at.key("equals").invalid(message, format!("allowed: {low} to {high}"));
        }
        Some(equals)
    }

    fn expected(&self, at: &KeyContext<'_>, address: Address, encoding: Encoding, equals: i64) -> Expected {
        let what = self.what.clone().unwrap_or_else(|| "as the profile expects it".to_owned());
        let every = at.key("every").period(self.every).unwrap_or(EVERY);
        Expected { address, encoding, equals, what, remedy: self.remedy.clone().unwrap_or_default(), every }
    }
}
