//! Protects keys of the profile: a layer above it must not change them, unless the profile allows this with `[machine]
//! allow_override`.
//!
//! The schema states for each key or table, as `x-layers`, what a layer may do:
//!
//! | `x-layers` | meaning |
//! |---|---|
//! | `less` | A limit: a layer may reduce the number |
//! | `same` | A protection: only the profile sets it |
//! | `arrives` | The key changes the data that the machine receives: only the profile sets it |
//! | `free` | A layer may set the key, although the rule of its table would forbid this |
//!
//! The rule for keys of a device applies only if the gateway writes to that device. The rule for keys of a signal
//! applies only if the signal is a position that an output corrects, or if the gateway writes a register before it
//! reads the signal. All other devices and signals are only read.

use std::collections::HashSet;

use serde_json::{Map, Value};

use crate::error::ProfileError;
use crate::overridden_keys::short;
use crate::schema_check::resolved;
use crate::source_map::{SourceMap, child};
use crate::wording::allowing_line;

/// Keyword of the JSON schema that states the rule of a key.
const MARK: &str = "x-layers";
/// Key with the models of an axis. Some keys inside a model have a rule of their own, because the control itself
/// applies their values.
const MODELS: &str = "model";
const ARM: &str = "machine.arm";

/// Rule for a key that a layer above the profile sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rule {
    Less,
    Same,
    Arrives,
}

/// Key that a layer sets against the rule of the key, with the error for the user.
#[derive(Debug)]
pub(crate) struct Refusal {
    kind: String,
    name: String,
    key: String,
    error: ProfileError,
}

/// Returns the rule that the schema states for a key or table. `Some(None)` if the schema exempts the key from the rule
/// of its table. `None` if the schema states no rule.
fn rule(schema: &Value) -> Option<Option<Rule>> {
    match schema.get(MARK)?.as_str()? {
        "less" => Some(Some(Rule::Less)),
        "same" => Some(Some(Rule::Same)),
        "arrives" => Some(Some(Rule::Arrives)),
        _ => Some(None),
    }
}

/// Iterates over the keys of a table, each with its schema and its rule.
fn keys<'a>(
    root: &'a Value,
    table: &'a Value,
) -> impl Iterator<Item = (&'a String, &'a Value, Option<Rule>)> {
    let table = resolved(root, table);
    let default = rule(table).flatten();
    let keys = table.get("properties").and_then(Value::as_object).into_iter().flatten();
    keys.map(move |(key, schema)| (key, schema, rule(schema).unwrap_or(default)))
}

/// Returns the schema of one table of a kind such as `axis`, and whether tables of this kind have names.
fn table_of<'a>(root: &'a Value, kind: &str) -> Option<(&'a Value, bool)> {
    let schema = resolved(root, root.get("properties")?.get(kind)?);
    let named = schema.get("additionalProperties").filter(|named| named.is_object());
    Some((named.unwrap_or(schema), named.is_some()))
}

/// Returns a copy of a value that contains only keys with a rule. `None` if no key has a rule.
fn marked(root: &Value, schema: &Value, value: &Value) -> Option<Value> {
    match value {
        Value::Object(table) => {
            let known = keys(root, schema).filter_map(|(key, schema, rule)| {
                let value = table.get(key)?;
                let part = if rule.is_some() { Some(value.clone()) } else { marked(root, schema, value) };
                Some((key.clone(), part?))
            });
            Some(Value::Object(known.collect())).filter(|parts| parts != &Value::Object(Map::new()))
        }
        Value::Array(items) => {
            let schema = resolved(root, schema).get("items")?;
            let parts: Vec<Value> = items.iter().filter_map(|item| marked(root, schema, item)).collect();
            (!parts.is_empty()).then_some(Value::Array(parts))
        }
        _ => None,
    }
}

/// Returns the path of every key that `allow_override` may name. `names` contains the names of the tables of each kind.
pub(crate) fn guarded_keys(root: &Value, names: &[(&str, &[String])]) -> Vec<String> {
    let mut found = Vec::new();
    for (kind, names) in names {
        let Some((schema, has_names)) = table_of(root, kind) else { continue };
        let tables = names.iter().map(|name| child(kind, name));
        for table in tables.chain((!has_names).then(|| (*kind).to_owned())) {
            let guarded = keys(root, schema).filter(|(key, _, rule)| rule.is_some() || *key == MODELS);
            found.extend(guarded.map(|(key, ..)| child(&table, key)));
        }
    }
    found.push(ARM.to_owned());
    found
}

/// Returns the keys that the profile names in `allow_override`.
pub(crate) fn allowed(profile: &Value) -> Vec<String> {
    let list = profile.pointer("/machine/allow_override").and_then(Value::as_array);
    list.into_iter().flatten().filter_map(Value::as_str).map(str::to_owned).collect()
}

/// Returns the keys that a layer sets against the rules of the keys, except the keys in `allow_override`.
pub(crate) fn refused(root: &Value, profile: &Value, layer: &Value, spans: &SourceMap) -> Vec<Refusal> {
    let mut guards = Guards {
        root,
        spans,
        allowed: allowed(profile),
        kind: String::new(),
        name: String::new(),
        refused: Vec::new(),
    };
    for (kind, tables) in layer.as_object().into_iter().flatten() {
        let Some((schema, has_names)) = table_of(root, kind) else { continue };
        let own = profile.get(kind);
        kind.clone_into(&mut guards.kind);
        guards.name.clear();
        if !has_names {
            guards.table(schema, kind, own, tables);
            continue;
        }
        for (name, table) in tables.as_object().into_iter().flatten() {
            name.clone_into(&mut guards.name);
            guards.table(schema, &child(kind, name), own.and_then(|own| own.get(name)), table);
        }
    }
    guards.machine(profile.get("machine"), layer.get("machine"));
    guards.refused
}

/// Returns the errors for those refused keys that influence the data sent to this machine. `merged` is the profile with
/// all layers and the keys of templates.
pub(crate) fn that_count(refused: Vec<Refusal>, profile: &Value, merged: &Value) -> Vec<ProfileError> {
    let machines = [profile, merged].map(Influence::of);
    let counts = |one: &Refusal| machines.iter().any(|machine| machine.has(one));
    refused.into_iter().filter(counts).map(|one| one.error).collect()
}

/// Names of the devices, signals and axes whose keys influence the data that the machine receives.
struct Influence<'a> {
    /// Devices to which the gateway writes, and devices of the signals in `signals`.
    devices: HashSet<&'a str>,
    /// Positions that an output corrects, and signals for which the gateway writes a capture command before each read.
    signals: HashSet<&'a str>,
    /// Axes whose correction the control itself calculates, from intercept, slope and reference position.
    axes: HashSet<&'a str>,
}

impl<'a> Influence<'a> {
    fn of(machine: &'a Value) -> Influence<'a> {
        let text = |table: &'a Value, key: &str| table.get(key).and_then(Value::as_str);
        let outputs = || tables(machine, "output").map(|(_, output)| output);
        let is_captured = |signal: &Value| signal.pointer("/counter/capture").is_some();
        let captured = tables(machine, "signal").filter(|(_, signal)| is_captured(signal));
        let captured = captured.map(|(name, _)| name.as_str());
        let corrected = outputs().filter_map(|output| text(output, "position"));
        let signals: HashSet<&str> = captured.chain(corrected).collect();
        let read = tables(machine, "signal").filter(|(name, _)| signals.contains(name.as_str()));
        let used = outputs().chain(machine.get("heartbeat")).chain(read.map(|(_, signal)| signal));
        let set_up = tables(machine, "device").filter(|(_, device)| device.get("setup").is_some());
        let set_up = set_up.map(|(name, _)| name.as_str());
        let devices = used.filter_map(|table| text(table, "device")).chain(set_up).collect();
        let is_apart = |writes: &str| ["intercept", "slope", "reference"].contains(&writes);
        let apart = outputs().filter(|output| text(output, "writes").is_some_and(is_apart));
        let axes = apart.filter_map(|output| text(output, "axis")).collect();
        Influence { devices, signals, axes }
    }

    /// Returns whether the refused key influences the data that the machine receives. Keys of a device or a
    /// signal, and the models of an axis, count only if the corresponding list contains the name of their
    /// table. All other keys count.
    fn has(&self, Refusal { kind, name, key, .. }: &Refusal) -> bool {
        match (kind.as_str(), key.as_str()) {
            ("device", _) => self.devices.contains(name.as_str()),
            ("signal", _) => self.signals.contains(name.as_str()),
            ("axis", MODELS) => self.axes.contains(name.as_str()),
            _ => true,
        }
    }
}

fn tables<'a>(machine: &'a Value, kind: &str) -> impl Iterator<Item = (&'a String, &'a Value)> {
    machine.get(kind).and_then(Value::as_object).into_iter().flatten()
}

struct Guards<'a> {
    root: &'a Value,
    spans: &'a SourceMap,
    allowed: Vec<String>,
    /// Kind of the table that is being checked, for example `axis`.
    kind: String,
    name: String,
    refused: Vec<Refusal>,
}

impl Guards<'_> {
    fn table(&mut self, schema: &Value, path: &str, own: Option<&Value>, layer: &Value) {
        for (key, schema, rule) in keys(self.root, schema) {
            let Some(value) = layer.get(key) else { continue };
            let (path, own) = (child(path, key), own.and_then(|own| own.get(key)));
            match rule {
                Some(Rule::Less) => self.smaller(&path, key, own, value),
                Some(rule) => self.same(rule, (&path, key), &path, own, value),
                None if key == MODELS => {
                    // A list is replaced as a whole. Only its parts with rules are compared.
                    let Some(value) = marked(self.root, schema, value) else { continue };
                    let own = own.and_then(|own| marked(self.root, schema, own));
                    self.same(Rule::Arrives, (&path, key), &path, own.as_ref(), &value);
                }
                None => {}
            }
        }
    }

    fn smaller(&mut self, path: &str, key: &str, profile: Option<&Value>, value: &Value) {
        let Some(own) = profile else { return self.absent(Rule::Less, (path, key), path) };
        let is_smaller = own.as_f64().zip(value.as_f64()).is_some_and(|(own, new)| new <= own);
        if !is_smaller {
            let why =
                format!("{value} is more than the {own} of the profile; a layer may only reduce this value");
            self.refuse((path, key), path, why, &format!("write at most {own}"));
        }
    }

    /// Refuses a value that differs from the profile. For a table, checks each key in it.
    fn same(&mut self, rule: Rule, guard: (&str, &str), path: &str, profile: Option<&Value>, value: &Value) {
        match (profile, value) {
            (own, Value::Object(table)) if own.is_none_or(Value::is_object) && !table.is_empty() => {
                for (key, value) in table {
                    let own = own.and_then(|own| own.get(key));
                    self.same(rule, guard, &child(path, key), own, value);
                }
            }
            (Some(own), value) if is_same(own, value) => {}
            (Some(own), value) => {
                let why = match rule {
                    Rule::Arrives => "and this key changes the data that the machine receives",
                    _ => "and only the profile may set the action on a fault",
                };
                let why = format!("{} differs from {} in the profile, {why}", short(value), short(own));
                self.refuse(guard, path, why, "remove this key here");
            }
            (None, _) => self.absent(rule, guard, path),
        }
    }

    fn machine(&mut self, profile: Option<&Value>, layer: Option<&Value>) {
        let Some(layer) = layer else { return };
        let is = |machine: &Value, word: &str| machine.get("arm").is_some_and(|arm| arm == word);
        "machine".clone_into(&mut self.kind);
        self.name.clear();
        if is(layer, "auto") && profile.is_some_and(|profile| is(profile, "manual")) {
            let why = "the profile has arm = \"manual\": a layer above it must not write \"auto\"".to_owned();
            self.refuse((ARM, "arm"), ARM, why, "remove this key here");
        }
        if layer.get("allow_override").is_some() {
            let why = "only the profile itself names the keys that a layer may change";
            let help = "write this key into the profile, or remove this key here".to_owned();
            let error = self.spans.at_key("machine.allow_override", why, Some(help));
            self.push("allow_override", error, Vec::new());
        }
    }

    fn absent(&mut self, rule: Rule, guard: (&str, &str), path: &str) {
        // If the profile has the key with a wrong value, that has been reported.
        if self.spans.rank(path).0 > 0 {
            let why = match rule {
                Rule::Arrives => "and this key changes the data that the machine receives",
                _ => "and a layer can only tighten a limit that the profile has",
            };
            let why = format!("the profile has no `{path}`, {why}");
            self.refuse(guard, path, why, "write this key into the profile");
        }
    }

    fn refuse(&mut self, (guard, key): (&str, &str), path: &str, why: String, remedy: &str) {
        if !self.allowed.iter().any(|allowed| allowed == guard) {
            let allow = [self.allowed.as_slice(), &[guard.to_owned()]].concat();
            let help =
                format!("{remedy}; or allow this key in the profile: [machine] {}", allowing_line(&allow));
            let error = self.spans.at_value(path, why, Some(help));
            self.push(key, error, allow);
        }
    }

    fn push(&mut self, key: &str, error: ProfileError, allow: Vec<String>) {
        let error = ProfileError { allow_override: Some(allow), ..error };
        let (kind, name) = (self.kind.clone(), self.name.clone());
        self.refused.push(Refusal { kind, name, key: key.to_owned(), error });
    }
}

/// Returns whether two values are equal. 1 equals 1.0.
fn is_same(one: &Value, other: &Value) -> bool {
    match (one, other) {
        (Value::Number(one), Value::Number(other)) if one != other => {
            let (one, other) = (one.as_f64(), other.as_f64());
            one.zip(other).is_some_and(|(one, other)| one.total_cmp(&other).is_eq())
        }
        (Value::Array(one), Value::Array(other)) => {
            one.len() == other.len() && one.iter().zip(other).all(|(one, other)| is_same(one, other))
        }
        (Value::Object(one), Value::Object(other)) => {
            let is_in =
                |(key, one): (&String, &Value)| other.get(key).is_some_and(|other| is_same(one, other));
            one.len() == other.len() && one.iter().all(is_in)
        }
        _ => one == other,
    }
}
