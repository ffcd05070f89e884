//! What belongs to a CAN line, as written.

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use super::{Span, TypeWord};

/// SYNC, sent to all nodes of a line.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Sync")]
pub(crate) struct RawSync {
    /// Its CAN identifier. Default 0x80.
    #[schemars(range(min = 1, max = 2047))]
    pub(crate) cob_id: Option<u32>,
    /// How often it is sent.
    #[schemars(required)]
    pub(crate) every: Option<Span>,
}

/// One object that is written before start.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Setup")]
pub(crate) struct RawSetup {
    /// Index and subindex, hexadecimal: "1800:05".
    #[schemars(required, regex(pattern = "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"))]
    pub(crate) sdo: Option<String>,
    /// How the value lies in the object.
    #[serde(rename = "type")]
    #[schemars(required)]
    pub(crate) kind: Option<TypeWord>,
    /// What is written.
    #[schemars(required)]
    pub(crate) value: Option<i64>,
    /// What that is, for people: "TPDO1 every 100 ms".
    pub(crate) what: Option<String>,
}

/// What an emergency code of the device means.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Emergency")]
pub(crate) struct RawEmergency {
    /// The code.
    #[schemars(required, range(min = 0, max = 65535))]
    pub(crate) code: Option<u16>,
    /// Which bits of it count: 0xFF00 for a class of codes. Default 0xFFFF.
    #[schemars(range(min = 0, max = 65535))]
    pub(crate) mask: Option<u16>,
    /// What it means.
    #[schemars(required)]
    pub(crate) means: Option<String>,
}

/// A value inside a CANopen process data object.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Pdo")]
pub(crate) struct RawPdo {
    /// CAN identifier. Either this or `number`.
    #[schemars(range(min = 1, max = 2047))]
    pub(crate) cob_id: Option<u32>,
    /// Number of the process data object, where it has the usual identifier of its node: 1 is 0x180 + node for what is
    /// read, 0x200 + node for what is written.
    #[schemars(range(min = 1, max = 4))]
    pub(crate) number: Option<u8>,
    /// First bit, the least significant one: byte · 8 + bit.
    #[schemars(required)]
    pub(crate) start: Option<u16>,
    /// Number of bits.
    #[schemars(required)]
    pub(crate) length: Option<u16>,
    /// Two's complement. Default false.
    pub(crate) signed: Option<bool>,
    /// IEEE 754, 32 or 64 bits. Default false.
    pub(crate) float: Option<bool>,
    /// Written: the whole frame in hexadecimal, before the value is put in: "00 00 00 00 00 00 01 00". Default: zeros,
    /// as many bytes as the values need.
    pub(crate) fill: Option<String>,
}

/// A value inside a raw CAN frame.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Frame")]
pub(crate) struct RawFrame {
    /// CAN identifier; above 0x7FF it has 29 bits.
    #[schemars(required, range(min = 0, max = 536_870_911))]
    pub(crate) id: Option<u32>,
    /// The identifier has 29 bits though it is small. Default: true above 0x7FF.
    pub(crate) extended: Option<bool>,
    /// A CAN FD frame, up to 64 bytes. Default false.
    pub(crate) fd: Option<bool>,
    /// First bit, as a DBC file counts: byte · 8 + bit; the least significant one where `order` is "little", the most
    /// significant one where it is "big".
    #[schemars(required)]
    pub(crate) start: Option<u16>,
    /// Number of bits.
    #[schemars(required)]
    pub(crate) length: Option<u16>,
    /// Byte order: "little" (Intel) or "big" (Motorola). Required for more than one bit: devices differ.
    pub(crate) order: Option<ByteOrderWord>,
    /// Two's complement. Default false.
    pub(crate) signed: Option<bool>,
    /// IEEE 754, 32 or 64 bits. Default false.
    pub(crate) float: Option<bool>,
    /// Only frames in which another value says so.
    pub(crate) multiplex: Option<RawMultiplex>,
    /// Written: the whole frame in hexadecimal, before the value is put in. Default: zeros, as many bytes as the values
    /// need.
    pub(crate) fill: Option<String>,
}

/// The value that says what else a frame holds.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Multiplex")]
pub(crate) struct RawMultiplex {
    /// First bit, counted as that of the frame's value.
    #[schemars(required)]
    pub(crate) start: Option<u16>,
    /// Number of bits.
    #[schemars(required)]
    pub(crate) length: Option<u16>,
    /// What it must be.
    #[schemars(required)]
    pub(crate) equals: Option<u64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "ByteOrder")]
pub(crate) enum ByteOrderWord {
    Little,
    Big,
}

/// A raw value that means "no measurement": the number, or what the device says by it as well.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum BadValue {
    Number(i64),
    Named(RawSentinel),
}

/// A raw value with what the device says by it.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Sentinel")]
pub(crate) struct RawSentinel {
    /// The raw count, before scaling.
    #[schemars(required)]
    pub(crate) raw: Option<i64>,
    /// What the device says by it.
    #[schemars(required, schema_with = "meanings")]
    pub(crate) means: Option<String>,
}

impl JsonSchema for BadValue {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Bad".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let named = RawSentinel::json_schema(generator);
        schemars::json_schema!({ "anyOf": [{ "type": "integer" }, named] })
    }
}

fn meanings(_: &mut SchemaGenerator) -> Schema {
    let words: Vec<&str> = isotherm_core::reading::Reason::MEANINGS.iter().map(|(words, _)| *words).collect();
    schemars::json_schema!({ "type": "string", "enum": words })
}
