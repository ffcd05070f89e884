//! Document that is output in two forms: as lines of text and as JSON.

use std::fmt;

use serde::{Serialize, Serializer};
use serde_json::Value;

/// Part of a document: its lines of text, and the JSON object with the same content.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Section {
    lines: Vec<String>,
    json: Vec<(&'static str, Json)>,
}

/// JSON value whose objects keep the order of their keys. `serde_json::Value` would sort the keys.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Json {
    Value(Value),
    List(Vec<Json>),
    Object(Vec<(&'static str, Json)>),
}

impl Section {
    /// Adds a line to the text. The JSON object is not changed.
    pub(crate) fn line(&mut self, line: impl Into<String>) {
        self.lines.push(line.into());
    }

    /// Adds lines of text, each with `label` before it. An `Option` counts as a list of one line or no line.
    pub(crate) fn lines<T: fmt::Display>(&mut self, label: &str, lines: impl IntoIterator<Item = T>) {
        self.lines.extend(lines.into_iter().map(|line| format!("{label}{line}")));
    }

    /// Adds the lines of another section. The caller adds the JSON of that section separately.
    pub(crate) fn lines_of(&mut self, other: &Section) {
        self.lines.extend(other.lines.iter().cloned());
    }

    /// Adds a scalar, or a list of scalars, to the JSON object.
    pub(crate) fn entry(&mut self, key: &'static str, value: impl Serialize) {
        self.json(key, Json::Value(serde_json::to_value(value).unwrap_or_default()));
    }

    /// Adds a key to the JSON object. Unlike the value of `entry`, this value may be an object or a list of objects.
    pub(crate) fn json(&mut self, key: &'static str, json: impl Into<Json>) {
        self.json.push((key, json.into()));
    }

    /// Adds a nested section: its lines, and its JSON under `key`. If `part` is `None`, the JSON is `null`.
    pub(crate) fn part(&mut self, key: &'static str, part: Option<Section>) {
        part.iter().for_each(|part| self.lines_of(part));
        self.json(key, part);
    }

    /// Adds nested sections: their lines, and their JSON as a list under `key`.
    pub(crate) fn parts(&mut self, key: &'static str, parts: impl Iterator<Item = Section>) {
        let parts: Vec<Section> = parts.collect();
        parts.iter().for_each(|part| self.lines_of(part));
        self.json(key, parts);
    }
}

/// Adds entries to the JSON object of a section. An entry is `key = value`, or only `key` if a variable has the name of
/// the key.
macro_rules! entries {
    ($section:ident, $($key:ident $(= $value:expr)?),+) => {
        $($section.entry(stringify!($key), $crate::document::entries!(@value $key $($value)?));)+
    };
    (@value $key:ident) => { $key };
    (@value $key:ident $value:expr) => { $value };
}
pub(crate) use entries;

impl From<u16> for Json {
    fn from(number: u16) -> Json {
        Json::Value(number.into())
    }
}

impl From<Section> for Json {
    fn from(section: Section) -> Json {
        Json::Object(section.json)
    }
}

impl<T: Into<Json>> From<Option<T>> for Json {
    fn from(json: Option<T>) -> Json {
        json.map_or(Json::Value(Value::Null), T::into)
    }
}

impl<T: Into<Json>> From<Vec<T>> for Json {
    fn from(list: Vec<T>) -> Json {
        Json::List(list.into_iter().map(T::into).collect())
    }
}

impl Serialize for Json {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Json::Value(value) => value.serialize(serializer),
            Json::List(list) => list.serialize(serializer),
            Json::Object(entries) => serializer.collect_map(entries.iter().map(|(key, json)| (key, json))),
        }
    }
}

impl Serialize for Section {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.json.iter().map(|(key, json)| (key, json)))
    }
}

impl fmt::Display for Section {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.lines.iter().try_for_each(|line| writeln!(f, "{line}"))
    }
}

/// Formats a number with at most `digits` decimals, without trailing zeros. Rounding hides the last digits of binary
/// fractions, such as 0.30000000000000004.
pub(crate) fn figure(number: f64, digits: usize) -> String {
    format!("{number:.digits$}").trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Groups values by key, in the order of the first occurrence of each key.
pub(crate) fn grouped<K: PartialEq, V>(pairs: impl IntoIterator<Item = (K, V)>) -> Vec<(K, Vec<V>)> {
    let mut groups: Vec<(K, Vec<V>)> = Vec::new();
    for (key, value) in pairs {
        match groups.iter_mut().find(|(known, _)| *known == key) {
            Some((_, values)) => values.push(value),
            None => groups.push((key, vec![value])),
        }
    }
    groups
}
