//! `bad` of a signal: raw values that mean "no measurement".

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use crate::tables::KeyContext;
use isotherm_core::codec::{Encoding, Sentinel};
use isotherm_core::reading::Reason;

/// Raw value that means "no measurement": a number, or a number with its meaning.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum BadValue {
    Number(i64),
    Named(RawSentinel),
}

/// Raw value with its meaning.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Sentinel")]
pub(crate) struct RawSentinel {
    /// Raw count, before scaling.
    #[schemars(required)]
    raw: Option<i64>,
    /// Meaning of the raw value.
    #[schemars(required, schema_with = "meanings")]
    means: Option<String>,
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
    let meanings = Reason::MEANINGS.map(|(meaning, _)| meaning);
    schemars::json_schema!({ "type": "string", "enum": meanings })
}

/// Resolves the raw values that mean "no measurement", with their meanings.
pub(crate) fn sentinels(bad: Option<&Vec<BadValue>>, at: &KeyContext<'_>) -> Vec<Sentinel> {
    let mut sentinels = Vec::new();
    for (place, bad) in bad.into_iter().flatten().enumerate() {
        match bad {
            BadValue::Number(raw) => sentinels.push(Sentinel::from(*raw)),
            BadValue::Named(RawSentinel { raw: Some(raw), means: Some(meaning) }) => {
                let known = Reason::MEANINGS.iter().find(|(known, _)| known == meaning);
                sentinels.extend(known.map(|(_, means)| Sentinel { raw: *raw, means: *means }));
            }
            BadValue::Named(RawSentinel { raw, .. }) => {
                let key = if raw.is_none() { "raw" } else { "means" };
                let help = "write the raw value, or the raw value with its meaning, as { raw = -512, means = \
                            \"open circuit\" }";
                at.item(place).key(key).missing(format!("`{key}` is missing"), help);
            }
        }
    }
    sentinels
}

/// Reports raw values that the type cannot hold. They would never be detected, so the reading of a broken sensor would
/// be accepted.
pub(super) fn sentinels_fit(at: &KeyContext<'_>, encoding: &Encoding) {
    let Some((low, high)) = encoding.data_type.integer_range() else { return };
    for bad in encoding.bad.iter().filter(|bad| !(low..=high).contains(&i128::from(bad.raw))) {
        let help = format!("allowed: {low} to {high}, the raw counts that this type can hold");
        at.invalid(format!("{} cannot contain {}", encoding.data_type.name(), bad.raw), help);
    }
}
