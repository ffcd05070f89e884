//! One layer against the JSON schema: unknown keys, wrong types, wrong words, numbers that are none. Nothing is ever
//! coerced. What is wrong is reported and left out, so that the rest can still be checked.

use serde_json::{Map, Value};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{ProfileError, allowed};
use crate::place::{Places, child, element};
use crate::raw::Span;

/// Walks one layer.
pub(crate) struct Walk<'a> {
    pub(crate) schema: &'a Value,
    pub(crate) origin: usize,
    pub(crate) places: &'a mut Places,
    pub(crate) errors: &'a mut Vec<ProfileError>,
}

/// The schema behind a `$ref`.
pub(crate) fn resolved<'a>(root: &'a Value, schema: &'a Value) -> &'a Value {
    let target =
        schema.get("$ref").and_then(Value::as_str).and_then(|name| root.pointer(name.strip_prefix('#')?));
    target.unwrap_or(schema)
}

/// The types a value may have.
pub(crate) fn types<'a>(root: &'a Value, schema: &'a Value) -> Vec<&'a str> {
    let schema = resolved(root, schema);
    match schema.get("anyOf").and_then(Value::as_array) {
        Some(choices) => choices.iter().flat_map(|choice| types(root, choice)).collect(),
        None => schema.get("type").and_then(Value::as_str).into_iter().collect(),
    }
}

impl Walk<'_> {
    /// What is right in a table.
    pub(crate) fn table(&mut self, schema: &Value, path: &str, table: &DeTable<'_>) -> Value {
        let schema = resolved(self.schema, schema);
        let known = schema.get("properties").and_then(Value::as_object);
        let free = schema.get("additionalProperties").filter(|free| free.is_object());
        let mut entries: Vec<_> = table.iter().collect();
        entries.sort_by_key(|(key, _)| key.span().start);
        let mut right = Map::new();
        for (key, value) in entries {
            let name: &str = key.get_ref();
            let path = child(path, name);
            self.places.record(self.origin, &path, key.span(), value.span());
            let Some(wanted) = known.and_then(|known| known.get(name)).or(free) else {
                let words = known.into_iter().flat_map(Map::keys).map(String::as_str);
                self.error(
                    key.span().start,
                    &path,
                    format!("unknown key `{name}`"),
                    Some(allowed(name, words)),
                );
                continue;
            };
            if let Some(value) = self.value(wanted, &path, value) {
                right.insert(name.to_owned(), value);
            }
        }
        Value::Object(right)
    }

    /// The value, if it is one that the schema allows.
    pub(crate) fn value(
        &mut self,
        schema: &Value,
        path: &str,
        value: &Spanned<DeValue<'_>>,
    ) -> Option<Value> {
        let described = schema;
        let at = value.span().start;
        let schema = Self::choice(resolved(self.schema, schema), value.get_ref());
        let wanted = schema.get("type").and_then(Value::as_str).unwrap_or_default();
        let duration = schema.get("pattern").is_some_and(|pattern| pattern == Span::PATTERN);
        match (value.get_ref(), wanted) {
            (DeValue::Table(table), "object") => Some(self.table(schema, path, table)),
            (DeValue::Array(items), "array") => {
                self.places.forget_inside(path);
                let before = self.errors.len();
                let mut right = Vec::new();
                for (index, item) in items.iter().enumerate() {
                    let path = element(path, index);
                    self.places.record(self.origin, &path, item.span(), item.span());
                    let item_schema = schema.get("items").unwrap_or(&Value::Null);
                    right.extend(self.value(item_schema, &path, item));
                }
                if right.len() == items.len() {
                    self.length(schema, path, at, right.len())?;
                    return Some(Value::Array(right));
                }
                debug_assert!(self.errors.len() > before, "an entry was dropped without a word");
                None
            }
            (DeValue::String(text), "string") => self.text(schema, duration, path, at, text),
            (DeValue::Boolean(yes), "boolean") => Some(Value::Bool(*yes)),
            (DeValue::Integer(number), "integer" | "number") => {
                let Ok(number) = i64::from_str_radix(number.as_str(), number.radix()) else {
                    self.error(at, path, format!("{number} is too large"), None);
                    return None;
                };
                self.bounds(schema, path, at, number)?;
                Some(Value::from(number))
            }
            (DeValue::Float(number), "number") => {
                let finite = number.as_str().parse::<f64>().ok().filter(|number| number.is_finite());
                if finite.is_none() {
                    let help = Some("a finite number is wanted".to_owned());
                    self.error(at, path, format!("`{number}` is no number"), help);
                }
                finite.map(Value::from)
            }
            (found, _) => {
                let help = described.get("description").or(schema.get("description")).and_then(Value::as_str);
                let message = wrong_type(&types(self.schema, schema), found, duration);
                self.error(at, path, message, help.map(str::to_owned));
                None
            }
        }
    }

    /// Of several alternatives the one of the value's type.
    fn choice<'s>(schema: &'s Value, value: &DeValue<'_>) -> &'s Value {
        let Some(choices) = schema.get("anyOf").and_then(Value::as_array) else { return schema };
        let fits = |choice: &&Value| {
            let kind = choice.get("type").and_then(Value::as_str);
            match value {
                DeValue::Integer(_) => matches!(kind, Some("integer" | "number")),
                DeValue::Float(_) => kind == Some("number"),
                DeValue::String(_) => kind == Some("string"),
                DeValue::Table(_) => kind == Some("object"),
                DeValue::Array(_) => kind == Some("array"),
                DeValue::Boolean(_) | DeValue::Datetime(_) => false,
            }
        };
        choices.iter().find(fits).unwrap_or(schema)
    }

    fn text(&mut self, schema: &Value, duration: bool, path: &str, at: usize, text: &str) -> Option<Value> {
        if let Some(words) = schema.get("enum").and_then(Value::as_array) {
            let words: Vec<&str> = words.iter().filter_map(Value::as_str).collect();
            if !words.contains(&text) {
                self.error(
                    at,
                    path,
                    format!("`{text}` is not a word known here"),
                    Some(allowed(text, words)),
                );
                return None;
            }
        }
        if duration && let Err(why) = humantime::parse_duration(text) {
            let help = Some(
                "write a number with its unit, as \"300ms\", \"10s\", \"3min\", \"2h\" or \"90d\"".to_owned(),
            );
            self.error(at, path, format!("`{text}` is no duration: {why}"), help);
            return None;
        }
        Some(Value::from(text))
    }

    fn length(&mut self, schema: &Value, path: &str, at: usize, length: usize) -> Option<()> {
        let exact =
            schema.get("maxItems").and_then(Value::as_u64).and_then(|most| usize::try_from(most).ok());
        if let Some(exact) = exact.filter(|exact| *exact != length) {
            self.error(at, path, format!("{exact} values are wanted here, not {length}"), None);
            return None;
        }
        Some(())
    }

    fn bounds(&mut self, schema: &Value, path: &str, at: usize, number: i64) -> Option<()> {
        let bound = |name| schema.get(name).and_then(Value::as_i64);
        let (least, most) = (bound("minimum"), bound("maximum"));
        if least.is_some_and(|least| number < least) || most.is_some_and(|most| number > most) {
            let range = match (least, most) {
                (Some(least), Some(most)) => format!("{least} to {most}"),
                (Some(least), None) => format!("{least} and more"),
                (_, most) => format!("up to {}", most.unwrap_or(i64::MAX)),
            };
            self.error(
                at,
                path,
                format!("{number} is outside what is allowed"),
                Some(format!("allowed: {range}")),
            );
            return None;
        }
        Some(())
    }

    fn error(&mut self, at: usize, path: &str, message: String, help: Option<String>) {
        self.errors.push(self.places.at_byte(self.origin, at, path, message, help));
    }
}

fn wrong_type(wanted: &[&str], found: &DeValue<'_>, duration: bool) -> String {
    let found = match found {
        DeValue::String(text) => format!("the text \"{text}\""),
        DeValue::Integer(number) => format!("the number {number}"),
        DeValue::Float(number) => format!("the number {number}"),
        DeValue::Boolean(yes) => yes.to_string(),
        DeValue::Datetime(date) => format!("the date {date}"),
        DeValue::Array(_) => "a list".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    };
    let wanted = wanted.iter().map(|kind| match *kind {
        "string" if duration => "a duration in quotes, as \"10s\",",
        "string" => "a text in quotes",
        "integer" => "a whole number",
        "number" => "a number",
        "boolean" => "true or false",
        "array" => "a list in [ ]",
        _ => "a table",
    });
    format!("{} is wanted here, not {found}", wanted.collect::<Vec<_>>().join(" or "))
}

/// Reports the keys that the merged profile lacks. One that is there but wrong has been reported already.
pub(crate) fn missing(
    root: &Value,
    schema: &Value,
    path: &str,
    value: &Value,
    places: &Places,
    errors: &mut Vec<ProfileError>,
) {
    let schema = resolved(root, schema);
    match value {
        Value::Object(table) => {
            for key in schema
                .get("required")
                .and_then(Value::as_array)
                .into_iter()
                .flatten()
                .filter_map(Value::as_str)
            {
                let path = child(path, key);
                if !table.contains_key(key) && !places.contains(&path) {
                    let what = schema.pointer(&format!("/properties/{key}"));
                    let what = what
                        .and_then(|what| resolved(root, what).get("description").or(what.get("description")));
                    let help = what.and_then(Value::as_str).map(|what| format!("`{key}`: {what}"));
                    errors.push(places.at_key(&path, format!("`{key}` is missing"), help));
                }
            }
            for (key, value) in table {
                let inner = schema
                    .pointer(&format!("/properties/{key}"))
                    .or_else(|| schema.get("additionalProperties"));
                if let Some(inner) = inner {
                    missing(root, inner, &child(path, key), value, places, errors);
                }
            }
        }
        Value::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                if let Some(inner) = schema.get("items") {
                    missing(root, inner, &element(path, index), item, places, errors);
                }
            }
        }
        _ => {}
    }
}
