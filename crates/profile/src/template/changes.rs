//! Compares two texts of a template and lists the changes.

use std::collections::BTreeMap;

use toml::{Table, Value};

/// Keys whose values are only texts for users. They have no effect on a machine.
const NOTES: [&str; 6] = ["notes", "remedy", "source", "title", "unverified", "what"];

/// Lists the keys that are only in one of two texts, or differ: `channel.tc.scale: 0.1 → 0.01`. Comments and
/// order are ignored. Changed texts for users give only one entry, "its notes changed". If a template cannot
/// be parsed, the only entry is "the whole template".
#[must_use]
pub fn changes(before: &str, now: &str) -> Vec<String> {
    let (Ok(before), Ok(now)) = (before.parse::<Table>(), now.parse::<Table>()) else {
        return vec!["the whole template".to_owned()];
    };
    let [mut before, now] = [before, now].map(|table| {
        let mut values = BTreeMap::new();
        flatten("", &Value::Table(table), &mut values);
        values
    });
    let mut changes = Vec::new();
    let mut have_notes_changed = before.keys().any(|key| is_note(key) && !now.contains_key(key));
    before.retain(|key, _| !is_note(key) || now.contains_key(key));
    for (key, value) in now {
        match before.remove(&key) {
            Some(old) if old == value => {}
            _ if is_note(&key) => have_notes_changed = true,
            Some(old) => changes.push(format!("{key}: {old} → {value}")),
            None => changes.push(format!("{key}: {value} (new)")),
        }
    }
    changes.extend(before.into_iter().map(|(key, old)| format!("{key}: {old} (removed)")));
    if have_notes_changed {
        changes.push("its notes changed".to_owned());
    }
    changes
}

/// Returns whether the value of a key is a text for users: `unverified` or `channel.tc.unverified`.
fn is_note(key: &str) -> bool {
    NOTES.contains(&key.rsplit('.').next().unwrap_or_default())
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
