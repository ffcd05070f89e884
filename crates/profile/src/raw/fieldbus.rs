//! `[bus.*]`, `[device.*]` and `[signal.*]` as written.

use std::collections::BTreeMap;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use super::{BadValue, ExpectValue, RawEmergency, RawFrame, RawPdo, RawSetup, RawSync, RawVerify, Span};
use isotherm_core::codec::{DataType, WordOrder};

/// One physical line.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Bus")]
pub(crate) struct RawBus {
    /// What it speaks.
    #[serde(rename = "type")]
    #[schemars(required)]
    pub(crate) kind: Option<BusType>,
    /// Host and port of a line over TCP: "192.168.0.10:502". With `tls` the port may be left out: 802.
    pub(crate) address: Option<String>,
    /// Longest wait for one answer. Default "500ms", or half the shortest poll period of its devices if that is less.
    pub(crate) timeout: Option<Span>,
    /// How long a write that was not answered may still arrive, held back on its way: `timeout` to "10min". Default "30s";
    /// on a modbus-rtu line, where nothing holds it back, twice `timeout`.
    pub(crate) late: Option<Span>,
    /// Modbus/TCP Security: the certificate files of a modbus-tcp line.
    pub(crate) tls: Option<RawTls>,
    /// What all its devices need to be treated like.
    pub(crate) quirks: Option<RawQuirks>,
    /// Serial port of a modbus-rtu line: "/dev/serial/by-id/usb-…".
    pub(crate) port: Option<String>,
    /// Bits per second of a modbus-rtu line; required.
    #[schemars(range(min = 300, max = 4_000_000))]
    pub(crate) baud: Option<u32>,
    /// Parity of a modbus-rtu line. Default "none".
    pub(crate) parity: Option<ParityWord>,
    /// Stop bits of a modbus-rtu line, 1 or 2. Default 1.
    #[schemars(range(min = 1, max = 2))]
    pub(crate) stop_bits: Option<u8>,
    /// Network interface of a CAN line: "can0".
    pub(crate) interface: Option<String>,
    /// SYNC that is sent on a CAN line. Default: none.
    pub(crate) sync: Option<RawSync>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum BusType {
    ModbusTcp,
    ModbusRtu,
    ModbusRtuOverTcp,
    Can,
}

#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ParityWord {
    None,
    Even,
    Odd,
}

/// Certificate files of Modbus/TCP Security, in PEM form.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Tls")]
pub(crate) struct RawTls {
    /// Who signs the device's certificate, or that very certificate.
    #[schemars(required)]
    pub(crate) ca: Option<String>,
    /// The gateway's certificate.
    #[schemars(required)]
    pub(crate) cert: Option<String>,
    /// The gateway's private key.
    #[schemars(required)]
    pub(crate) key: Option<String>,
    /// The name in the device's certificate. Default: the host of `address`.
    pub(crate) name: Option<String>,
}

/// Ways in which a device is peculiar.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Quirks")]
pub(crate) struct RawQuirks {
    /// Silence after connecting. Default "0s".
    pub(crate) pause_after_connect: Option<Span>,
    /// Silence between two requests. Default "0s".
    pub(crate) pause_between_requests: Option<Span>,
    /// Reads are not merged at all. Default false.
    pub(crate) one_request_per_field: Option<bool>,
    /// Largest number of registers in one read. Default 125.
    #[schemars(range(min = 1, max = 125))]
    pub(crate) max_registers_per_request: Option<u16>,
    /// Unused registers that a merged read may bridge; 0 for a device that refuses registers it does not have. Default 8.
    #[schemars(range(max = 124))]
    pub(crate) max_gap: Option<u16>,
    /// The connection is closed after each answer, for a device that lets in one client at a time. Default false.
    pub(crate) close_after_each: Option<bool>,
}

/// One unit on a line.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Device")]
pub(crate) struct RawDevice {
    /// The line it hangs on.
    #[schemars(required)]
    pub(crate) bus: Option<String>,
    /// Modbus unit identifier; required on a Modbus line.
    pub(crate) unit: Option<u8>,
    /// Poll period of its signals. Default "1s".
    pub(crate) every: Option<Span>,
    /// A device template that gives channels their registers, types and sentinels.
    pub(crate) template: Option<String>,
    /// Which of the template's variants it is, as "T" for a thermocouple's type.
    pub(crate) variant: Option<String>,
    /// Added to every register of the template, where its maker leaves open at which register it begins.
    pub(crate) base: Option<u16>,
    /// What the template's checks must find on this device, by their names; "unchecked" leaves one out.
    pub(crate) expect: Option<BTreeMap<String, ExpectValue>>,
    /// The only function codes it may be sent. Default: all.
    pub(crate) functions: Option<Vec<FunctionWord>>,
    /// What it needs to be treated like, over the bus's quirks.
    pub(crate) quirks: Option<RawQuirks>,
    /// CAN: a DBC file beside the profile that describes its frames.
    pub(crate) dbc: Option<String>,
    /// CAN, with a DBC file: its J1939 source address. Its messages are parameter groups, and only its own are taken.
    pub(crate) source_address: Option<u8>,
    /// CANopen node number.
    #[schemars(range(min = 1, max = 127))]
    pub(crate) node: Option<u8>,
    /// CANopen: whether it is started by NMT, at the beginning and after each boot-up. Default true.
    pub(crate) start: Option<bool>,
    /// CANopen: its heartbeat missed this long, or never seen this long, is a fault. Default: not watched.
    pub(crate) heartbeat: Option<Span>,
    /// CANopen: objects written before each start, in this order.
    pub(crate) setup: Option<Vec<RawSetup>>,
    /// CANopen: what its emergency codes mean, beside those of CiA 301.
    pub(crate) emergency: Option<Vec<RawEmergency>>,
    /// Registers (CANopen: objects) read before arming; a mismatch refuses to arm.
    pub(crate) verify: Option<Vec<RawVerify>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum FunctionWord {
    ReadCoils,
    ReadDiscrete,
    ReadHolding,
    ReadInput,
    WriteCoil,
    WriteSingle,
    WriteCoils,
    WriteMultiple,
}

/// One value that is read.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Signal")]
pub(crate) struct RawSignal {
    /// Where it is read.
    #[schemars(required)]
    pub(crate) device: Option<String>,
    /// Channel of the device's template: its number or its name.
    #[allow(dead_code, reason = "resolved before the profile is checked")]
    pub(crate) channel: Option<ChannelValue>,
    /// "input:0", "holding:84", "coil:1", "discrete:3": table and zero-based protocol address; or the one-based Modicon
    /// number "30001"; "input:50.3" is bit 3 of a register.
    pub(crate) register: Option<String>,
    /// How the value lies in its registers; required for input and holding registers.
    #[serde(rename = "type")]
    pub(crate) kind: Option<TypeWord>,
    /// Which register comes first; required for 32 bits and more, because devices differ.
    pub(crate) word_order: Option<WordOrderWord>,
    /// The two bytes inside every register are exchanged. Default false.
    pub(crate) byte_swap: Option<bool>,
    /// Engineering units per count, not zero. Default 1.
    pub(crate) scale: Option<f64>,
    /// Engineering value of raw zero. Default 0.
    pub(crate) offset: Option<f64>,
    /// Raw values that mean "no measurement", compared before scaling: [-32768], or with what the device says by them,
    /// [{ raw = -512, means = "open circuit" }].
    pub(crate) bad: Option<Vec<BadValue>>,
    /// Engineering unit. Default: "bool" for a coil or a discrete input, else "1".
    #[serde(default)]
    #[schemars(schema_with = "unit_words")]
    pub(crate) unit: Option<String>,
    /// Smallest and largest believable value, in the unit; outside: bad.
    pub(crate) range: Option<[f64; 2]>,
    /// Fastest believable change, units per second; faster: bad.
    pub(crate) max_rate: Option<f64>,
    /// Older is stale. Default: five polls, and at least three timeouts.
    pub(crate) max_age: Option<Span>,
    /// A condition on other signals that condemns this one: "bed_open == 1".
    pub(crate) fault_when: Option<String>,
    /// May share a read request with its neighbours. Default true.
    pub(crate) merge: Option<bool>,
    /// It counts: what a rollover and a step mean.
    pub(crate) counter: Option<RawCounter>,
    /// CAN: message and signal of the device's DBC file: "Message.Signal".
    pub(crate) dbc: Option<String>,
    /// CANopen process data: { cob_id = 0x185, start = 0, length = 16, signed = true }.
    pub(crate) pdo: Option<RawPdo>,
    /// CANopen object polled every `every`: "7130:01".
    #[schemars(regex(pattern = "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"))]
    pub(crate) sdo: Option<String>,
    /// CAN frame without a DBC file: { id = 0x100, start = 0, length = 16, order = "little", signed = true }.
    pub(crate) frame: Option<RawFrame>,
}

/// A counter of a scale or an encoder.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Counter")]
pub(crate) struct RawCounter {
    /// Fastest motion of the axis, units per second; a larger step is a new reference and no motion.
    #[schemars(required)]
    pub(crate) max_speed: Option<f64>,
    /// Written before each read, where a counter must be told to copy its count into its registers.
    pub(crate) capture: Option<RawCapture>,
}

/// The command that captures a count.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Capture")]
pub(crate) struct RawCapture {
    /// A coil or a holding register of the same device: "holding:132".
    #[schemars(required)]
    pub(crate) register: Option<String>,
    /// What is written there. Default 1.
    pub(crate) value: Option<u16>,
}

/// A channel of a template.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
#[allow(dead_code, reason = "resolved before the profile is checked")]
pub(crate) enum ChannelValue {
    Number(u16),
    Name(String),
}

impl JsonSchema for ChannelValue {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Channel".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        schemars::json_schema!({ "anyOf": [{ "type": "integer", "minimum": 0, "maximum": 65535 }, { "type": "string" }] })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum TypeWord {
    Bool,
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
    Decimal24,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum WordOrderWord {
    MswFirst,
    LswFirst,
}

impl From<TypeWord> for DataType {
    fn from(word: TypeWord) -> DataType {
        match word {
            TypeWord::Bool => DataType::Bool,
            TypeWord::U8 => DataType::unsigned(8),
            TypeWord::I8 => DataType::signed(8),
            TypeWord::U16 => DataType::U16,
            TypeWord::I16 => DataType::I16,
            TypeWord::U32 => DataType::U32,
            TypeWord::I32 => DataType::I32,
            TypeWord::U64 => DataType::U64,
            TypeWord::I64 => DataType::I64,
            TypeWord::F32 => DataType::F32,
            TypeWord::F64 => DataType::F64,
            TypeWord::Decimal24 => DataType::Decimal24(0),
        }
    }
}

impl From<WordOrderWord> for WordOrder {
    fn from(word: WordOrderWord) -> WordOrder {
        match word {
            WordOrderWord::MswFirst => WordOrder::MswFirst,
            WordOrderWord::LswFirst => WordOrder::LswFirst,
        }
    }
}

fn unit_words(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
    schemars::json_schema!({ "type": "string", "enum": crate::Unit::WORDS })
}
