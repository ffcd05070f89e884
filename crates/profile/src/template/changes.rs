//! Changes between two texts of a template.

use std::collections::BTreeMap;

use toml::{Table, Value};

/// Lists the keys that are only in one of two texts, or differ: `channel.tc.scale: 0.1 → 0.01`. Comments and order are
/// ignored. If a text cannot be parsed, the list has a single line.
#[must_use]
pub fn changes(before: &str, now: &str) -> Vec<String> {
    let (Ok(before), Ok(now)) = (before.parse::<Table>(), now.parse::<Table>()) else {
        return vec!["all of it".to_owned()];
    };
    let [mut before, now] = [before, now].map(|table| {
        let mut values = BTreeMap::new();
        flatten("", &Value::Table(table), &mut values);
        values
    });
    let mut changes = Vec::new();
    for (key, value) in now {
        match before.remove(&key) {
            Some(old) if old == value => {}
            Some(old) => changes.push(format!("{key}: {old} → {value}")),
            None => changes.push(format!("{key}: {value} (new)")),
        }
    }
    changes.extend(before.into_iter().map(|(key, old)| format!("{key}: {old} (removed)")));
    changes
}

fn flatten(path: &str, value: &Value, values: &mut BTreeMap<String, String>) {
    match value {
        Value::Table(table) => {
            for (key, value) in table {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                flatten(&path, value, values);
            }
        }
        other => {
            values.insert(path.to_owned(), other.to_string());
        }
    }
}
