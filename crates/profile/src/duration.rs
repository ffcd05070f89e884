//! Durations in a profile: "300ms", "10s", "3min", "2h", "90d".

use std::time::Duration;

use serde::{Deserialize, Deserializer};

use crate::schema_of::schema_of;
use crate::wording::duration_text;

/// Duration that has been parsed from a text of the profile, such as `"300ms"`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Timespan(pub(crate) Duration);

impl Timespan {
    /// Pattern of a duration in the JSON schema, for editors. The schema check recognises a duration by this pattern,
    /// because the schema of a required key has no `$ref` with the name of the type.
    pub(crate) const PATTERN: &'static str = "^\\s*(\\d+\\s*[a-zA-Zµ]+\\s*)+$";
}

impl<'de> Deserialize<'de> for Timespan {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Timespan, D::Error> {
        let text = String::deserialize(deserializer)?;
        humantime::parse_duration(&text).map(Timespan).map_err(serde::de::Error::custom)
    }
}

schema_of!(Timespan as "Duration": {
    "description": "A duration with its unit, as \"300ms\", \"10s\", \"3min\", \"2h\" or \"90d\".",
    "type": "string",
    "pattern": Timespan::PATTERN,
    "examples": ["300ms", "10s", "3min"],
});

/// Formats a duration in the notation of a profile, for example as `1m 30s`.
pub(crate) fn shown(span: Duration) -> String {
    duration_text(span)
}

/// Returns a duration in milliseconds, with the fraction.
pub(crate) fn ms(span: Duration) -> f64 {
    1000.0 * span.as_secs_f64()
}
