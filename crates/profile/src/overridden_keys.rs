//! Finds the keys that a layer above the profile sets (local file, environment, `--set`). The gateway reports them
//! together with its settings.

use std::collections::BTreeSet;
use std::fmt;

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

use crate::control_chars::veiled;
use crate::source_map::{SourceMap, child};

/// Longest value that is shown in full, in characters.
const LONGEST: usize = 80;

/// Key set by a layer above the profile.
#[derive(Clone, Debug, PartialEq, Eq, JsonSchema, Serialize)]
pub struct Overridden {
    /// Path of the key, for example `axis.z.limit`. If a file sets a whole table that the profile lacks, this is the
    /// path of the table.
    pub key: String,
    /// Value in the profile. `None` if the profile does not have the key.
    pub profile: Option<String>,
    /// Value of the key after all layers were merged.
    pub now: String,
    /// Layer that sets the key: file with line, `environment ISOTHERM__…`, or `--set key`.
    pub from: String,
    /// Whether the profile names the key in `allow_override`.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub allowed: bool,
}

impl fmt::Display for Overridden {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Overridden { key, profile, now, from, allowed } = self;
        match profile {
            Some(profile) => write!(f, "{key} = {now} instead of the profile's {profile}, from {from}")?,
            None => write!(f, "{key} = {now}, from {from} (not in the profile)")?,
        }
        if *allowed { f.write_str(", as `allow_override` allows") } else { Ok(()) }
    }
}

/// Layers above a profile (local file, environment, `--set`), with the values that they replace.
pub(crate) struct Above<'a> {
    pub(crate) profile: &'a Value,
    pub(crate) layers: &'a [Value],
    /// Keys that the profile names in `allow_override`.
    pub(crate) allowed: Vec<String>,
    /// Number of layers that are files. These layers come first.
    pub(crate) files: usize,
    pub(crate) merged: &'a Value,
    pub(crate) spans: &'a SourceMap,
}

impl Above<'_> {
    /// Returns every key that the layers set. The keys that `allow_override` names come first, then all others. Both
    /// groups are sorted by path.
    pub(crate) fn list(&self) -> Vec<Overridden> {
        let mut found = BTreeSet::new();
        for (place, layer) in self.layers.iter().enumerate() {
            let is_file = place < self.files;
            gather(&mut Vec::new(), Some(self.profile), layer, is_file, &mut found);
        }
        let overridden = |keys: Vec<String>| {
            let path = keys.iter().fold(String::new(), |path, key| child(&path, key));
            let from = self.spans.line_of(&path);
            let now = at(self.merged, &keys).map(short).unwrap_or_default();
            let is_inside = |guard: &String| path.strip_prefix(guard.as_str()).is_some_and(is_subkey);
            let allowed = self.allowed.iter().any(is_inside);
            Overridden { key: path, profile: at(self.profile, &keys).map(short), now, from, allowed }
        };
        let mut listed: Vec<Overridden> = found.into_iter().map(overridden).collect();
        listed.sort_by_key(|one| !one.allowed);
        listed
    }
}

/// Collects the keys that one layer sets. If the layer is a file, a whole table that the profile lacks counts as one
/// key.
fn gather(
    keys: &mut Vec<String>,
    profile: Option<&Value>,
    layer: &Value,
    is_file: bool,
    found: &mut BTreeSet<Vec<String>>,
) {
    let table = layer.as_object().filter(|_| profile.is_some_and(Value::is_object) || !is_file);
    let Some(table) = table else {
        found.insert(keys.clone());
        return;
    };
    for (key, value) in table {
        keys.push(key.clone());
        gather(keys, profile.and_then(|profile| profile.get(key)), value, is_file, found);
        keys.pop();
    }
}

/// Returns whether a path names an allowed key or a key inside it. `rest` is the part of the path after the allowed
/// key.
fn is_subkey(rest: &str) -> bool {
    rest.is_empty() || rest.starts_with('.')
}

fn at<'v>(value: &'v Value, keys: &[String]) -> Option<&'v Value> {
    keys.iter().try_fold(value, |value, key| value.get(key))
}

/// Formats a value. A long value is truncated.
pub(crate) fn short(value: &Value) -> String {
    let text = value.to_string();
    let text = veiled(&text).into_owned();
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}
