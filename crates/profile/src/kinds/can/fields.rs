//! Resolves the keys that describe values on CAN: objects of a node, and values in process data and frames.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::tables::KeyContext;
use crate::tables::register::{TypeWord, is_of_registers};
use isotherm_core::codec::{
    Address, BitField, BitKind, ByteOrder, CanId, CanMatch, DataType, Entry, Field, Object, Selector,
};

/// Length of a classic CAN frame (not CAN FD) in bytes.
const CLASSIC: usize = 8;

/// Value in a CANopen process data object (PDO).
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Pdo")]
pub(crate) struct RawPdo {
    /// CAN identifier of the process data object. Alternative: `number`.
    #[schemars(range(min = 1, max = 2047))]
    cob_id: Option<u32>,
    /// Number of the process data object, if it has the default identifier of its node. Number 1 is 0x180 + node for
    /// reading, and 0x200 + node for writing.
    #[schemars(range(min = 1, max = 4))]
    number: Option<u8>,
    /// Position of the first bit of the value, which is the least significant bit: byte · 8 + bit.
    #[schemars(required)]
    start: Option<u16>,
    /// Number of bits.
    #[schemars(required)]
    length: Option<u16>,
    /// Whether the value is signed (two's complement). Default false.
    signed: Option<bool>,
    /// Whether the value is a float (IEEE 754, 32 or 64 bits). Default false.
    float: Option<bool>,
    /// For writing: the bytes of the frame before the value is inserted, in hexadecimal, for example "00 00 00 00 00 00
    /// 01 00". Default: zeros, as many bytes as the values need.
    pub(crate) fill: Option<String>,
}

/// Value in a raw CAN frame.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Frame")]
pub(crate) struct RawFrame {
    /// CAN identifier. Above 0x7FF it has 29 bits.
    #[schemars(required, range(min = 0, max = 536_870_911))]
    id: Option<u32>,
    /// Whether an identifier up to 0x7FF has 29 bits. Larger identifiers always have 29 bits. Default: false up to
    /// 0x7FF.
    extended: Option<bool>,
    /// Whether the frame is a CAN FD frame of up to 64 bytes. Default false.
    fd: Option<bool>,
    /// First bit, counted as in a DBC file: byte · 8 + bit. It is the least significant bit for order "little", and the
    /// most significant bit for "big".
    #[schemars(required)]
    start: Option<u16>,
    /// Number of bits.
    #[schemars(required)]
    length: Option<u16>,
    /// Byte order: "little" (Intel) or "big" (Motorola). Required for more than one bit, because devices differ.
    order: Option<ByteOrderWord>,
    /// Whether the value is signed (two's complement). Default false.
    signed: Option<bool>,
    /// Whether the value is a float (IEEE 754, 32 or 64 bits). Default false.
    float: Option<bool>,
    /// Multiplexer: a number in the frame that selects whether the frame contains this value.
    multiplex: Option<RawMultiplex>,
    /// For writing: the bytes of the frame before the value is inserted, in hexadecimal. Default: zeros, as many bytes
    /// as the values need.
    pub(crate) fill: Option<String>,
}

/// Multiplexer of a frame: a number that selects which values the frame contains.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Multiplex")]
struct RawMultiplex {
    /// First bit of the multiplexer, counted as for the value of the frame.
    #[schemars(required)]
    start: Option<u16>,
    /// Number of bits.
    #[schemars(required)]
    length: Option<u16>,
    /// Value of the multiplexer in the selected frames.
    #[schemars(required)]
    equals: Option<u64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "ByteOrder")]
enum ByteOrderWord {
    Little,
    Big,
}

/// Sender of a frame: the device or the gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sender {
    Device,
    Gateway,
}

impl RawPdo {
    /// Resolves a value in process data (PDO) of this device: the CAN identifier and the bits of the value. `node` is
    /// the CANopen node number of the device.
    pub(crate) fn resolve(
        &self,
        at: &KeyContext<'_>,
        (device, node): (&str, Option<u8>),
        sender: Sender,
    ) -> Option<Field> {
        let bits = bits(at, (self.start, self.length), ByteOrder::Intel, (self.signed, self.float), CLASSIC);
        let id = match (self.cob_id, self.number) {
            (Some(id), None) => CanId::standard(id),
            (None, Some(number)) => {
                if at.top("device").key(device).key("node").is_left_out() {
                    let help = format!("write node = 5 at device `{device}`, or `cob_id` here");
                    at.key("number").invalid("`number` needs a CANopen node", help);
                }
                CanId::standard(sender.usual_identifier(number, node?))
            }
            (Some(_), Some(_)) => {
                let message =
                    "`cob_id` and `number` exclude each other: both set the identifier of the frame";
                at.key("number").wrong_key(message, "keep one of the two keys");
                None
            }
            (None, None) => {
                if at.key("number").is_left_out() {
                    let help = "write cob_id = 0x185, or number = 1 for the usual identifier of the node";
                    at.key("cob_id")
                        .missing("`cob_id` is missing: what is the CAN identifier of the frame?", help);
                }
                None
            }
        };
        Some(Field { frames: CanMatch::exactly(id?), is_fd: false, bits: bits?, multiplex: Vec::new() })
    }
}

impl RawFrame {
    /// Resolves a value in a raw CAN frame: the CAN identifier and the bits of the value.
    pub(crate) fn resolve(&self, at: &KeyContext<'_>) -> Option<Field> {
        let is_long = self.id.is_some_and(|id| id > CanId::LARGEST_STANDARD);
        if is_long && self.extended == Some(false) {
            let message = "an identifier above 0x7FF has 29 bits";
            at.key("extended").invalid(message, "remove `extended = false`, or correct `id`");
        }
        let needs_order = self.length.is_some_and(|length| length > 1);
        let order = match self.order {
            Some(ByteOrderWord::Big) => ByteOrder::Motorola,
            None if needs_order => {
                let message = "`order` is missing: what is the byte order of the value?";
                let help = "write \"little\" (Intel, `start` is the least significant bit) or \"big\" \
                            (Motorola, `start` is the most significant bit)";
                at.key("order").missing(message, help);
                return None;
            }
            Some(ByteOrderWord::Little) | None => ByteOrder::Intel,
        };
        let is_fd = self.fd.unwrap_or(false);
        let most = if is_fd { BitField::LONGEST_FRAME } else { CLASSIC };
        let bits = bits(at, (self.start, self.length), order, (self.signed, self.float), most);
        let multiplex = match &self.multiplex {
            None => Vec::new(),
            Some(multiplex) => vec![multiplex.resolve(&at.key("multiplex"), order, most)?],
        };
        let id = self.id?;
        let id = if self.extended.unwrap_or(is_long) { CanId::extended(id) } else { CanId::standard(id) };
        Some(Field { frames: CanMatch::exactly(id?), is_fd, bits: bits?, multiplex })
    }
}

impl RawMultiplex {
    fn resolve(&self, at: &KeyContext<'_>, order: ByteOrder, most: usize) -> Option<Selector> {
        let bits = bits(at, (self.start, self.length), order, (None, None), most)?;
        let equals = self.equals?;
        let width = bits.data_type().width();
        if width < 64 && equals >> width != 0 {
            let message = format!("a multiplexer of {width} bits cannot have the value {equals}");
            at.key("equals").invalid(message, format!("allowed: 0 to {}", (1u64 << width) - 1));
        }
        Some(Selector { bits, values: vec![(equals, equals)] })
    }
}

impl Sender {
    /// Returns the default CAN identifier of the process data object with this number, as CiA 301 defines it.
    fn usual_identifier(self, number: u8, node: u8) -> u32 {
        let first = match self {
            Sender::Device => 0x180,
            Sender::Gateway => 0x200,
        };
        first + 0x100 * (u32::from(number) - 1) + u32::from(node)
    }
}

fn bits(
    at: &KeyContext<'_>,
    (start, length): (Option<u16>, Option<u16>),
    order: ByteOrder,
    (signed, float): (Option<bool>, Option<bool>),
    most: usize,
) -> Option<BitField> {
    let kind = match (signed.unwrap_or(false), float.unwrap_or(false)) {
        (true, true) => {
            let help = "remove `signed`: a floating-point number is always signed";
            at.key("signed").wrong_key("`signed` and `float` exclude each other", help);
            BitKind::Float
        }
        (_, true) => BitKind::Float,
        (true, _) => BitKind::Signed,
        (false, false) => BitKind::Unsigned,
    };
    let (start, length) = (start?, length?);
    let (fits_kind, allowed) = match kind {
        BitKind::Float => (matches!(length, 32 | 64), "allowed: 32 and 64"),
        _ => (matches!(length, 1..=64), "allowed: 1 to 64"),
    };
    if !fits_kind {
        return at.key("length").reject(format!("a value cannot have {length} bits"), allowed);
    }
    let field = BitField::new(start, length, order, kind);
    if let Some(field) = field.filter(|field| field.bytes() <= most) {
        return Some(field);
    }
    let needed = field.map_or_else(|| "more than 64".to_owned(), |field| field.bytes().to_string());
    let help = match most {
        CLASSIC if at.path.ends_with("pdo") => "process data has at most 64 bits, numbered from 0",
        CLASSIC => "bits are numbered from 0 to 63; write fd = true if it is a CAN FD frame",
        _ => "bits are numbered from 0 to 511",
    };
    at.key("length").reject(format!("the value needs {needed} bytes, but a frame has at most {most}"), help)
}

/// Parses index and sub-index of a CANopen object, for example "1800:05". Reports an error and returns `None` if the
/// text is invalid.
pub(crate) fn entry(at: &KeyContext<'_>, text: &str) -> Option<Entry> {
    let parsed = text.split_once(':').and_then(|(index, sub)| {
        let is_plain =
            |part: &str, length| part.len() == length && part.bytes().all(|byte| byte.is_ascii_hexdigit());
        let fits = is_plain(index, 4) && is_plain(sub, 2);
        let numbers = (u16::from_str_radix(index, 16).ok()?, u8::from_str_radix(sub, 16).ok()?);
        fits.then_some(Entry::new(numbers.0, numbers.1))
    });
    if parsed.is_none() {
        let help = "write index and subindex in hexadecimal, four digits and two, as \"7130:01\"";
        at.invalid(format!("`{text}` is not a CANopen object"), help);
    }
    parsed
}

/// Returns the CANopen data type for the key `type`. Reports an error and returns `None` if CANopen objects cannot have
/// this type.
pub(crate) fn object_type(at: &KeyContext<'_>, TypeWord(kind): TypeWord) -> Option<DataType> {
    match kind {
        // A BOOLEAN occupies a whole byte.
        DataType::Bool => Some(DataType::unsigned(8)),
        kind if matches!(kind, DataType::Decimal24(_)) || is_of_registers(kind) => {
            let help = "allowed: bool, u8, i8, u16, i16, u24, i24, u32, i32, u64, i64, f32, f64";
            at.reject(format!("{} is a type of Modbus registers", kind.name()), help)
        }
        kind => Some(kind),
    }
}

/// Resolves the CANopen object at the key `sdo` of a signal or an output. The key `type` states the type of its value.
pub(crate) fn object(
    at: &KeyContext<'_>,
    sdo: &str,
    kind: Option<TypeWord>,
    device: &str,
    types: &str,
) -> Option<Address> {
    needs_node(&at.key("sdo"), device);
    let entry = entry(&at.key("sdo"), sdo);
    at.key("type").missing("`type` is missing: which type does the object have?", types);
    let data_type = object_type(&at.key("type"), kind?)?;
    Some(Address::Object(Object { entry: entry?, data_type }))
}

/// Reports an error if this device has no key `node`, because only CANopen nodes have objects.
pub(crate) fn needs_node(at: &KeyContext<'_>, device: &str) {
    if at.top("device").key(device).key("node").is_left_out() {
        let help = format!("write node = 5 at device `{device}`, the node number that is set at the device");
        at.invalid(format!("an object needs a CANopen node, but `{device}` has no `node`"), help);
    }
}

/// Returns the type of the value at this address.
pub(super) fn data_type(address: &Address) -> DataType {
    match address {
        Address::Frame(field) => field.bits.data_type(),
        Address::Object(object) => object.data_type,
        _ => DataType::U16,
    }
}
