//! `[mqtt]`, which the gateway does not speak yet.

use schemars::JsonSchema;
use serde::Deserialize;

use super::At;

/// Publishing to a broker.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code, reason = "read by the schema, refused by the check")]
#[schemars(rename = "Mqtt")]
pub(crate) struct RawMqtt {
    /// The broker's address: "mqtt://host:1883".
    #[schemars(required)]
    broker: Option<String>,
    /// How a message is written.
    format: Option<MqttFormat>,
    /// The Sparkplug group, or the first part of every topic.
    group: Option<String>,
}

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum MqttFormat {
    Json,
    SparkplugB,
}

pub(super) fn refuse(at: &At<'_>) {
    at.error(at.check.spans.at_key(&at.path, "not built yet: publishing over MQTT", None));
}
