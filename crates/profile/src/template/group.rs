//! Helper functions for the groups of a template file. A group is a table that describes similar channels, checks or
//! targets.

use serde_json::{Map, Value};

use crate::source_map::{SourceMap, child};

/// Group of similar channels, checks or targets: its keys with their values.
pub(super) type Group = Map<String, Value>;

pub(super) fn text<'v>(table: &'v Group, key: &str) -> Option<&'v str> {
    table.get(key).and_then(Value::as_str)
}

pub(super) fn texts(table: &Group, key: &str) -> Vec<String> {
    let list = table.get(key).and_then(Value::as_array);
    list.into_iter().flatten().filter_map(Value::as_str).map(str::to_owned).collect()
}

/// Returns the names of all tables of one kind, for example of all signals, in the order of the file.
pub(super) fn in_order(profile: &Map<String, Value>, table: &str, spans: &SourceMap) -> Vec<String> {
    let names = profile.get(table).and_then(Value::as_object);
    let mut names: Vec<String> = names.into_iter().flat_map(Map::keys).cloned().collect();
    names.sort_by_cached_key(|name| spans.rank(&child(table, name)));
    names
}
