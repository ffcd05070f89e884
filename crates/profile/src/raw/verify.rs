//! What is read before arming, as written.

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use super::{TypeWord, WordOrderWord};

/// What a check of the template must find.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(untagged)]
pub(crate) enum ExpectValue {
    Number(i64),
    Word(ExpectWord),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ExpectWord {
    Unchecked,
}

impl JsonSchema for ExpectValue {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Expect".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        schemars::json_schema!({ "anyOf": [{ "type": "integer" }, { "type": "string", "enum": ["unchecked"] }] })
    }
}

/// One register, or one object, that is read before arming.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Verify")]
pub(crate) struct RawVerify {
    /// A register, a bit, or one bit of a register: "holding:256", "coil:268", "holding:116.5".
    pub(crate) register: Option<String>,
    /// CANopen: index and subindex, hexadecimal: "6110:01".
    #[schemars(regex(pattern = "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"))]
    pub(crate) sdo: Option<String>,
    /// How the value lies there. Default: "bool" for a bit, else "u16".
    #[serde(rename = "type")]
    pub(crate) kind: Option<TypeWord>,
    /// Which register comes first; required for 32 bits and more.
    pub(crate) word_order: Option<WordOrderWord>,
    /// What it must be; a mismatch refuses to arm.
    #[schemars(required)]
    pub(crate) equals: Option<i64>,
    /// What that is, for people: "data format: engineering units".
    pub(crate) what: Option<String>,
    /// What to do where it reads something else.
    pub(crate) remedy: Option<String>,
}
