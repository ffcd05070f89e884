//! The profile as the TOML writes it. The JSON schema is generated from these types, and each layer is walked
//! against that schema: the doc comments here are what editors and error messages say.
//!
//! Every key is an `Option`, also the required ones: what is missing or wrong is reported by the walk and left out,
//! and the rest can still be checked.

use std::collections::BTreeMap;

use schemars::generate::SchemaSettings;
use schemars::transform::RecursiveTransform;
use schemars::{JsonSchema, Schema};
use serde::Deserialize;
use serde_json::Value;

mod axis;
mod can;
mod fieldbus;
mod probe;
mod set;
mod verify;

pub(crate) use axis::{
    Carries, Component, DatumWord, FaultAction, FaultActionWord, InputValue, Inputs, ModelKind, OutsideWord,
    RawAxis, RawBeside, RawModel, RawOutput, RawSlope, RawStale, RawTerm, ReadBackValue, ReferenceValue,
    ReferenceWord, ShareWord, VerifyWord, WritesWord,
};
pub(crate) use can::{
    BadValue, ByteOrderWord, RawEmergency, RawFrame, RawMultiplex, RawPdo, RawSentinel, RawSetup, RawSync,
};
pub(crate) use fieldbus::{
    BusType, ChannelValue, FunctionWord, ParityWord, RawBus, RawCapture, RawDevice, RawQuirks, RawSignal,
    RawTls, TypeWord, WordOrderWord,
};
pub(crate) use probe::{RawGains, RawProbe};
pub(crate) use set::{RawHandshake, RawRestart, RawSet};
pub(crate) use verify::{ExpectValue, RawVerify};

/// A duration: "300ms", "10s", "3min", "2h", "90d".
#[derive(Clone, Debug, Deserialize)]
#[serde(transparent)]
pub(crate) struct Span(pub(crate) String);

impl Span {
    /// How editors know a duration, and how the walk knows one: a required key has this schema itself, not a `$ref`.
    pub(crate) const PATTERN: &'static str = "^\\s*(\\d+\\s*[a-zA-Zµ]+\\s*)+$";
}

impl JsonSchema for Span {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Duration".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> Schema {
        schemars::json_schema!({
            "description": "A duration with its unit, as \"300ms\", \"10s\", \"3min\", \"2h\" or \"90d\".",
            "type": "string",
            "pattern": Span::PATTERN,
            "examples": ["300ms", "10s", "3min"],
        })
    }
}

/// One machine: its buses, devices, signals, axes and outputs.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "isotherm machine profile")]
pub(crate) struct RawProfile {
    /// What the machine is.
    #[schemars(required)]
    pub(crate) machine: Option<RawMachine>,
    /// The physical lines, by name.
    #[serde(default)]
    pub(crate) bus: BTreeMap<String, RawBus>,
    /// What hangs on the lines, by name.
    #[serde(default)]
    pub(crate) device: BTreeMap<String, RawDevice>,
    /// What is read, by name.
    #[serde(default)]
    pub(crate) signal: BTreeMap<String, RawSignal>,
    /// What is computed, by name.
    #[serde(default)]
    pub(crate) axis: BTreeMap<String, RawAxis>,
    /// What is written, by name.
    #[serde(default)]
    pub(crate) output: BTreeMap<String, RawOutput>,
    /// Outputs that a control must see together or not at all, by name.
    #[serde(default)]
    pub(crate) set: BTreeMap<String, RawSet>,
    /// A register that counts while the gateway lives, so that the CNC can see it die.
    pub(crate) heartbeat: Option<RawHeartbeat>,
    /// Page, API and metrics.
    pub(crate) web: Option<RawWeb>,
    /// Publishing to a broker.
    pub(crate) mqtt: Option<RawMqtt>,
    /// State and logs.
    pub(crate) history: Option<RawHistory>,
}

/// What the machine is.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Machine")]
pub(crate) struct RawMachine {
    /// Used in topics, metrics and file names.
    #[schemars(required, regex(pattern = "^[a-z0-9-]+$"))]
    pub(crate) name: Option<String>,
    /// One line for people.
    pub(crate) description: Option<String>,
    /// The signal whose rising edge starts machine-on time t. Default: the first good reading starts it.
    pub(crate) on: Option<String>,
    /// The signal whose rising edge captures the references given as "zero".
    pub(crate) zero: Option<String>,
    /// Captured references are the mean over this long. Default "0s": the first good reading.
    pub(crate) settle: Option<Span>,
    /// When an axis begins to write: by itself once all is verified and good, or when a person says so. Default "auto".
    pub(crate) arm: Option<ArmWord>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ArmWord {
    Auto,
    Manual,
}

/// A register that counts while the gateway lives.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Heartbeat")]
pub(crate) struct RawHeartbeat {
    /// The device it is written to.
    #[schemars(required)]
    pub(crate) device: Option<String>,
    /// A holding register, 16 bits.
    #[schemars(required)]
    pub(crate) register: Option<String>,
    /// How often it counts.
    #[schemars(required)]
    pub(crate) every: Option<Span>,
}

/// Page, API and metrics.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Web")]
pub(crate) struct RawWeb {
    /// Host and port. Default "127.0.0.1:8080"; port 0 takes any free one.
    pub(crate) listen: Option<String>,
    /// A file with the token that clients must send; required as soon as it listens beyond loopback.
    pub(crate) token_file: Option<String>,
}

/// Publishing to a broker.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code, reason = "read by the schema, refused by the check")]
#[schemars(rename = "Mqtt")]
pub(crate) struct RawMqtt {
    /// The broker's address: "mqtt://host:1883".
    #[schemars(required)]
    pub(crate) broker: Option<String>,
    /// How a message is written.
    pub(crate) format: Option<MqttFormat>,
    /// The Sparkplug group, or the first part of every topic.
    pub(crate) group: Option<String>,
}

#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum MqttFormat {
    Json,
    SparkplugB,
}

/// State and logs.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "History")]
pub(crate) struct RawHistory {
    /// Where state, ledger and log are kept. Default: the platform's state directory.
    pub(crate) directory: Option<String>,
    /// How long logs are kept. Default "90d".
    pub(crate) keep: Option<Span>,
}

/// The JSON Schema of a profile, draft 2020-12. Editors complete from it; the loader checks against it.
pub fn schema() -> Value {
    let settings = SchemaSettings::draft2020_12()
        .for_deserialize()
        .with_transform(RecursiveTransform(without_null as fn(&mut Schema)));
    settings.into_generator().into_root_schema_for::<RawProfile>().to_value()
}

/// TOML has no null: an optional key is absent.
fn without_null(schema: &mut Schema) {
    let Some(object) = schema.as_object_mut() else { return };
    if let Some(Value::Array(types)) = object.get_mut("type") {
        types.retain(|kind| kind != "null");
        if let [only] = types.as_slice() {
            let only = only.clone();
            object.insert("type".to_owned(), only);
        }
    }
    if let Some(Value::Array(words)) = object.get_mut("enum") {
        words.retain(|word| !word.is_null());
    }
    if let Some(Value::Array(choices)) = object.get_mut("anyOf") {
        choices.retain(|choice| choice.get("type").is_none_or(|kind| kind != "null"));
        if let [Value::Object(only)] = choices.as_slice() {
            let only = only.clone();
            object.remove("anyOf");
            for (key, value) in only {
                object.entry(key).or_insert(value);
            }
        }
    }
    if object.get("default").is_some_and(Value::is_null) {
        object.remove("default");
    }
}
