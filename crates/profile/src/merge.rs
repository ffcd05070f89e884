//! Merges the layers of a profile. Tables are merged key by key. Every other value is replaced by the value of the
//! later layer.
//!
//! The crate `config` is used only for merging. Its conversions would turn "100" into 100, and 3.7 into 4 if an integer
//! is required. Therefore each layer is checked against the schema before, and the result is not converted. `config`
//! parses key paths (`a.b[0]`) only in top-level keys, which are plain words in a checked layer.

use std::collections::HashMap;

use config::{ConfigError, Source};
use serde_json::Value;

/// Layer of the profile, already checked against the schema.
#[derive(Clone, Debug)]
struct Layer(Value);

impl Source for Layer {
    fn clone_into_box(&self) -> Box<dyn Source + Send + Sync> {
        Box::new(self.clone())
    }

    fn collect(&self) -> Result<HashMap<String, config::Value>, ConfigError> {
        serde_json::from_value(self.0.clone()).map_err(|why| ConfigError::Foreign(Box::new(why)))
    }
}

/// Merges all layers, later ones over earlier ones. Returns the error of the crate `config` if merging fails.
pub(crate) fn merged(layers: &[Value]) -> Result<Value, ConfigError> {
    let start = config::Config::builder();
    let builder = layers.iter().fold(start, |builder, layer| builder.add_source(Layer(layer.clone())));
    builder.build()?.try_deserialize()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn tables_are_merged_and_lists_are_replaced() {
        let below =
            json!({ "bus": { "cell": { "address": "a:1", "timeout": "1s" } }, "x": { "list": [1, 2, 3] } });
        let above = json!({ "bus": { "cell": { "address": "b:2" } }, "x": { "list": [4] } });
        let together =
            json!({ "bus": { "cell": { "address": "b:2", "timeout": "1s" } }, "x": { "list": [4] } });
        assert_eq!(merged(&[below, above]).unwrap(), together);
    }

    #[test]
    fn keys_keep_their_case_and_their_hyphens_and_values_their_type() {
        let layer = json!({ "axis": { "Z-1": { "Kz": 2.0, "kz": 3, "text": "3", "a.b[0]": true, "empty": {}, "none": [] } } });
        assert_eq!(merged(std::slice::from_ref(&layer)).unwrap(), layer);
    }
}
