//! Checks one layer against the JSON schema: unknown keys, wrong types, unknown words, invalid numbers. Values are
//! never converted. Wrong values are reported and left out, so that the other values can still be checked.

use serde_json::{Map, Value};
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use crate::control_chars::is_unseen;
use crate::duration::Timespan;
use crate::error::{Findings, allowed, nearest};
use crate::source_map::{SourceMap, child, element};
use crate::syntax_errors::{SyntaxError, independent};
use crate::tables::signal::unit::{Scaling, Unit};

/// Maximum number of entries in a list. Each update of an axis computes every term of a model, so the limit bounds the
/// duration of an update.
const MOST_ITEMS: usize = 10_000;
/// Maximum number of commas in a file. The TOML reader needs memory of eighty times the size of a list of short values.
const MOST_COMMAS: usize = 500_000;
/// Largest file, in bytes, for which all syntax errors are reported. The TOML reader needs memory of three hundred
/// times the size of a file that consists of such errors.
const MOST_SEARCHED: usize = 1_000_000;

/// Check of one layer against the JSON schema. It records the positions of the layer's keys, and collects errors.
pub(crate) struct SchemaCheck<'a> {
    pub(crate) schema: &'a Value,
    pub(crate) layer: usize,
    pub(crate) spans: &'a mut SourceMap,
    pub(crate) errors: &'a mut Findings,
    /// Values of `scale` and `offset` in the table whose `unit` is checked, for hints on how to convert a unit.
    pub(crate) beside: Scaling,
}

/// Returns the schema to which a `$ref` refers. A schema without `$ref` is returned unchanged.
pub(crate) fn resolved<'a>(root: &'a Value, schema: &'a Value) -> &'a Value {
    let name = schema.get("$ref").and_then(Value::as_str);
    let target = name.and_then(|name| root.get("$defs")?.get(name.strip_prefix("#/$defs/")?));
    target.unwrap_or(schema)
}

/// Returns the JSON types that a schema allows, for example "integer" and "string".
pub(crate) fn types<'a>(root: &'a Value, schema: &'a Value) -> Vec<&'a str> {
    let schema = resolved(root, schema);
    match schema.get("anyOf").and_then(Value::as_array) {
        Some(choices) => choices.iter().flat_map(|choice| types(root, choice)).collect(),
        None => schema.get("type").and_then(Value::as_str).into_iter().collect(),
    }
}

impl SchemaCheck<'_> {
    /// Parses a TOML file, and reports mistakes. Returns the valid part of its table, and whether the whole file is
    /// valid.
    pub(crate) fn parsed<'t>(&mut self, text: &'t str) -> (DeTable<'t>, bool) {
        if let Some((at, _)) = text.match_indices(',').nth(MOST_COMMAS) {
            let help = format!("a list may have at most {MOST_ITEMS} entries");
            self.error(at, "", format!("the file has more than {MOST_COMMAS} commas"), Some(help));
            return (DeTable::new(), false);
        }
        let (table, problems) = match DeTable::parse(text) {
            Ok(table) => (table.into_inner(), Vec::new()),
            Err(first) if text.len() > MOST_SEARCHED => (DeTable::new(), vec![first]),
            Err(_) => {
                let (table, problems) = DeTable::parse_recoverable(text);
                (table.into_inner(), problems)
            }
        };
        for SyntaxError { at, message, help } in independent(text, &problems) {
            if self.errors.is_full() {
                self.errors.count();
                continue;
            }
            self.error(at, "", message, decimal_comma(text, at).or(help.map(str::to_owned)));
        }
        (table, problems.is_empty())
    }

    /// Returns the valid part of a table. The table is consumed, so that a large machine is not in memory twice.
    pub(crate) fn table(&mut self, schema: &Value, path: &str, table: DeTable<'_>) -> Value {
        let schema = resolved(self.schema, schema);
        let known = schema.get("properties").and_then(Value::as_object);
        let free = schema.get("additionalProperties").filter(|free| free.is_object());
        let mut entries: Vec<_> = table.into_iter().collect();
        entries.sort_by_key(|(key, _)| key.span().start);
        let mut right = Map::new();
        let parent = path;
        let beside = Scaling::among(&entries, self.layer);
        for (key, value) in entries {
            self.beside = beside;
            let name: &str = key.get_ref();
            let inner = known.and_then(|known| known.get(name)).or(free);
            if inner.is_none() && self.errors.is_full() {
                self.errors.count();
                continue;
            }
            let path = child(path, name);
            self.spans.record(self.layer, &path, key.span(), value.span());
            let at = key.span().start;
            let Some(inner) = inner else {
                let words: Vec<&str> = known.into_iter().flat_map(Map::keys).map(String::as_str).collect();
                // One misspelt key is one error: the key that was meant is not missing too.
                if let Some(meant) = nearest(name, &words) {
                    self.mark_meant(child(parent, meant), value.get_ref());
                }
                self.error(at, &path, format!("unknown key `{name}`"), Some(allowed(name, words)));
                continue;
            };
            if name.contains(is_unseen) {
                self.error(at, &path, format!("the name `{name}` {UNSEEN}"), Some(SEEN.to_owned()));
                continue;
            }
            if let Some(value) = self.value(inner, &path, value) {
                right.insert(name.to_owned(), value);
            }
        }
        Value::Object(right)
    }

    /// Marks the known key `path`, of which an unknown key is probably a misspelling. If the unknown key is a table,
    /// also marks all keys in this table.
    fn mark_meant(&mut self, path: String, value: &DeValue<'_>) {
        if let DeValue::Table(table) = value {
            for (key, value) in table.iter() {
                self.mark_meant(child(&path, key.get_ref()), value.get_ref());
            }
        }
        self.spans.mark_meant(path);
    }

    /// Returns the value if the schema allows it. Otherwise reports the mistake and returns `None`.
    pub(crate) fn value(&mut self, schema: &Value, path: &str, value: Spanned<DeValue<'_>>) -> Option<Value> {
        let described = schema;
        let at = value.span().start;
        let value = value.into_inner();
        let schema = Self::choice(resolved(self.schema, schema), &value);
        let kind = schema.get("type").and_then(Value::as_str).unwrap_or_default();
        let is_duration = schema.get("pattern").is_some_and(|pattern| pattern == Timespan::PATTERN);
        let wrong = match (value, kind) {
            (DeValue::Table(table), "object") => return Some(self.table(schema, path, table)),
            (DeValue::Array(items), "array") => return self.list(schema, path, at, items),
            (DeValue::Boolean(yes), "boolean") => return Some(Value::Bool(yes)),
            (DeValue::String(text), "string") => match wrong_text(schema, is_duration, &text, self.beside) {
                None => return Some(Value::from(text)),
                Some((message, help)) => (message, Some(help)),
            },
            (DeValue::Integer(number), "integer" | "number") => {
                match i64::from_str_radix(number.as_str(), number.radix()) {
                    Err(_) => (format!("{number} is too large"), None),
                    Ok(number) => match bounds(schema, number) {
                        None => return Some(Value::from(number)),
                        Some(bounds) => (
                            format!("{number} is outside the allowed range"),
                            Some(format!("allowed: {bounds}")),
                        ),
                    },
                }
            }
            (DeValue::Float(number), "number") => {
                match number.as_str().parse::<f64>().ok().filter(|number| number.is_finite()) {
                    Some(number) => return Some(Value::from(number)),
                    None => (format!("`{number}` is not a number"), Some("write a finite number".to_owned())),
                }
            }
            (found, _) => {
                let help = described.get("description").or(schema.get("description")).and_then(Value::as_str);
                let written = headed(self.schema, schema, path, &found)
                    .or_else(|| written(self.schema, schema, path, &found));
                let help = written.into_iter().chain(help.map(|help| help.replace('\n', " ")));
                let help = Some(help.collect::<Vec<_>>().join("; ")).filter(|help| !help.is_empty());
                (wrong_type(&types(self.schema, schema), &found, is_duration), help)
            }
        };
        self.error(at, path, wrong.0, wrong.1);
        None
    }

    /// Returns the list if all its entries are valid. Otherwise reports the mistakes and returns `None`.
    fn list(&mut self, schema: &Value, path: &str, at: usize, items: DeArray<'_>) -> Option<Value> {
        self.spans.forget_inside(path);
        if items.len() > MOST_ITEMS {
            let message = format!("the list has {} entries: at most {MOST_ITEMS} are allowed", items.len());
            self.error(at, path, message, None);
            return None;
        }
        let item_schema = schema.get("items").unwrap_or(&Value::Null);
        let mut right = Vec::new();
        let written = items.len();
        for (index, item) in items.into_iter().enumerate() {
            let path = element(path, index);
            self.spans.record(self.layer, &path, item.span(), item.span());
            right.extend(self.value(item_schema, &path, item));
        }
        let exact = schema.get("maxItems").and_then(Value::as_u64);
        match exact.filter(|exact| usize::try_from(*exact) != Ok(right.len())) {
            _ if right.len() < written => None,
            Some(exact) => {
                self.error(at, path, format!("expected {exact} values, but found {}", right.len()), None);
                None
            }
            None => Some(Value::Array(right)),
        }
    }

    /// Returns the alternative of a schema (`anyOf`) that allows the type of this value. If the schema has no
    /// alternatives, returns the schema itself.
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

    /// Reports required keys that are missing in the merged profile. A key with a wrong value has been reported
    /// already.
    pub(crate) fn missing(&mut self, schema: &Value, path: &str, value: &Value) {
        let schema = resolved(self.schema, schema);
        let property = |key: &str| schema.get("properties").and_then(|known| known.get(key));
        match value {
            Value::Object(table) => {
                let required = schema.get("required").and_then(Value::as_array).into_iter().flatten();
                for key in required.filter_map(Value::as_str) {
                    let path = child(path, key);
                    let is_reported = self.spans.contains(&path) || self.spans.is_meant(&path);
                    if !table.contains_key(key) && !is_reported {
                        let described =
                            |schema: &Value| Some(schema.get("description")?.as_str()?.replace('\n', " "));
                        let what = property(key)
                            .and_then(|what| described(resolved(self.schema, what)).or(described(what)));
                        let help = what.map(|what| format!("`{key}`: {what}"));
                        self.errors.push(self.spans.at_key(&path, format!("`{key}` is missing"), help));
                    }
                }
                for (key, value) in table {
                    if let Some(inner) = property(key).or_else(|| schema.get("additionalProperties")) {
                        self.missing(inner, &child(path, key), value);
                    }
                }
            }
            Value::Array(items) => {
                let Some(inner) = schema.get("items") else { return };
                for (index, item) in items.iter().enumerate() {
                    self.missing(inner, &element(path, index), item);
                }
            }
            _ => {}
        }
    }

    fn error(&mut self, at: usize, path: &str, message: impl Into<String>, help: Option<String>) {
        if self.errors.is_full() {
            return self.errors.count();
        }
        self.errors.push(self.spans.at_byte(self.layer, at, path, message, help));
    }
}

/// Keyword of the JSON schema. It marks a text that may have line breaks and tabs.
const LINES: &str = "x-lines";

/// Keyword of the JSON schema. It marks a text that is sent to a device, or compared with a text from a device. Such a
/// text may have ASCII control characters.
const CONTROL: &str = "x-control";

/// Part of the message about invisible characters. They could control a terminal or end a line, and so falsify the text
/// after them.
const UNSEEN: &str = "has invisible characters, or a line break";
const SEEN: &str = "write one line, with visible characters only";

/// Returns the mistake in a text and its remedy. `None` if the text is allowed.
fn wrong_text(schema: &Value, is_duration: bool, text: &str, beside: Scaling) -> Option<(String, String)> {
    // A text that its reader parses, for example JSON, may have several lines.
    let has_lines = schema.get(LINES).is_some();
    let has_control = schema.get(CONTROL).is_some();
    let is_allowed = |one: char| {
        (has_lines && matches!(one, '\n' | '\r' | '\t')) || (has_control && one.is_ascii_control())
    };
    if text.contains(|one: char| is_unseen(one) && !is_allowed(one)) {
        return Some((format!("the text `{text}` {UNSEEN}"), SEEN.to_owned()));
    }
    let words = schema.get("enum").and_then(Value::as_array);
    let words: Option<Vec<&str>> = words.map(|words| words.iter().filter_map(Value::as_str).collect());
    if let Some(words) = words.filter(|words| !words.contains(&text)) {
        let help = match words == Unit::WORDS {
            true => Unit::help(text, beside),
            false => meant(text, &words).unwrap_or_else(|| allowed(text, words)),
        };
        return Some((format!("`{text}` is not allowed here"), help));
    }
    let why = humantime::parse_duration(text).err().filter(|_| is_duration)?;
    let help = "write a number with its unit, as \"300ms\", \"10s\", \"3min\", \"2h\" or \"90d\"";
    Some((format!("`{text}` is not a duration: {why}"), help.to_owned()))
}

/// Suggests the word of the profile for a name that OPC UA uses, such as `Float` or `Basic256Sha256`. `None` for any
/// other text.
fn meant(text: &str, words: &[&str]) -> Option<String> {
    const TYPES: [(&str, &str); 11] = [
        ("Boolean", "bool"),
        ("SByte", "i8"),
        ("Byte", "u8"),
        ("Int16", "i16"),
        ("UInt16", "u16"),
        ("Int32", "i32"),
        ("UInt32", "u32"),
        ("Int64", "i64"),
        ("UInt64", "u64"),
        ("Float", "f32"),
        ("Double", "f64"),
    ];
    const POLICIES: [&str; 5] =
        ["Basic128Rsa15", "Basic256", "Basic256Sha256", "Aes128_Sha256_RsaOaep", "Aes256_Sha256_RsaPss"];
    let known = |word: &&str| words.contains(word);
    if let Some((theirs, ours)) = TYPES.into_iter().find(|(theirs, _)| theirs.eq_ignore_ascii_case(text)) {
        return Some(ours).filter(known).map(|ours| format!("write \"{ours}\" for the OPC UA type {theirs}"));
    }
    let name = text.rsplit('#').next().unwrap_or(text);
    let is_policy = POLICIES.iter().any(|policy| policy.eq_ignore_ascii_case(name));
    Some("sign-and-encrypt").filter(|_| is_policy).filter(known).map(|word| {
        format!(
            "this is a security policy: write \"{word}\"; the strongest policy that both ends support is \
             used"
        )
    })
}

/// Suggests the correct header brackets if the profile has a table instead of a list of tables, or a list instead of a
/// table. `None` for other mistakes.
fn headed(root: &Value, schema: &Value, path: &str, found: &DeValue<'_>) -> Option<String> {
    let wanted = types(root, schema);
    let of_tables = || {
        let items = resolved(root, schema).get("items");
        items.is_some_and(|items| types(root, items) == ["object"])
    };
    match found {
        // The path of an entry of a list is no header.
        _ if path.contains('[') => None,
        DeValue::Table(_) if wanted == ["array"] && of_tables() => {
            Some(format!("write [[{path}]], with two brackets, as the header of each entry"))
        }
        DeValue::Array(items) if wanted == ["object"] && !items.is_empty() => {
            let is_table = items.iter().all(|item| matches!(item.get_ref(), DeValue::Table(_)));
            is_table.then(|| format!("write [{path}], with one bracket, as the header"))
        }
        _ => None,
    }
}

/// Suggests how to write a table if the profile has another value in its place. The suggestion lists the required keys.
/// If the value is an allowed word of a key, the suggestion uses it.
fn written(root: &Value, schema: &Value, path: &str, found: &DeValue<'_>) -> Option<String> {
    if types(root, schema) != ["object"] {
        return None;
    }
    let word = found.as_str();
    let properties = schema.get("properties").and_then(Value::as_object)?;
    let required = schema.get("required").and_then(Value::as_array).into_iter().flatten();
    let required: Vec<&str> = required.filter_map(Value::as_str).collect();
    let one = |(name, of): (&String, &Value)| {
        let of = resolved(root, of);
        let words = of.get("enum").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str);
        let meant = words.clone().find(|known| Some(*known) == word);
        if meant.is_none() && !required.contains(&name.as_str()) {
            return None;
        }
        let kind = types(root, of).first().copied().unwrap_or_default();
        let value = match (meant.or(words.clone().next()), kind) {
            (Some(word), _) => format!("\"{word}\""),
            (None, _) if of.get("pattern").is_some_and(|pattern| pattern == Timespan::PATTERN) => {
                "\"10s\"".to_owned()
            }
            (None, "string") => "\"…\"".to_owned(),
            (None, "boolean") => "true".to_owned(),
            (None, "integer") => "1".to_owned(),
            (None, "number") => "1.0".to_owned(),
            (None, "array") => "[ … ]".to_owned(),
            _ => "{ … }".to_owned(),
        };
        Some(format!("{name} = {value}"))
    };
    let keys: Vec<String> = properties.iter().filter_map(one).collect();
    let name = path.rsplit('.').next().unwrap_or(path);
    Some(match keys.as_slice() {
        [] => format!("write a table: [{path}], and its keys below"),
        keys => format!("write {name} = {{ {} }}", keys.join(", ")),
    })
}

/// Suggests a decimal point if the line contains a decimal comma: `limit = 40,0`. `None` for other lines.
fn decimal_comma(text: &str, at: usize) -> Option<String> {
    let begin = text.get(..at)?.rfind('\n').map_or(0, |end| end + 1);
    let line = text.get(begin..)?.lines().next()?;
    let (_, value) = line.split_once('=')?;
    let value = value.split('#').next().unwrap_or_default().trim();
    let (whole, fraction) = value.split_once(',')?;
    let is_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let is_number = is_digits(whole.trim_start_matches(['-', '+'])) && is_digits(fraction);
    is_number.then(|| format!("write a decimal point: {whole}.{fraction}"))
}

/// Returns the allowed range as text if the number is outside of the range.
fn bounds(schema: &Value, number: i64) -> Option<String> {
    let bound = |name| schema.get(name).and_then(Value::as_i64);
    let (least, most) = (bound("minimum"), bound("maximum"));
    let is_outside = least.is_some_and(|least| number < least) || most.is_some_and(|most| number > most);
    is_outside.then(|| match (least, most) {
        (Some(least), Some(most)) => format!("{least} to {most}"),
        (Some(least), None) => format!("{least} and more"),
        (_, most) => format!("up to {}", most.unwrap_or(i64::MAX)),
    })
}

fn wrong_type(wanted: &[&str], found: &DeValue<'_>, is_duration: bool) -> String {
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
        "string" if is_duration => "a duration in quotes, as \"10s\"",
        "string" => "a text in quotes",
        "integer" => "a whole number",
        "number" => "a number",
        "boolean" => "true or false",
        "array" => "a list in [ ]",
        _ => "a table",
    });
    format!("expected {}, but found {found}", wanted.collect::<Vec<_>>().join(" or "))
}
