//! Adds the keys of a template to a profile, as if the profile contained them. An error in an added key is reported at
//! the line of the profile that names the template or the channel.

use std::collections::{BTreeMap, HashSet};

use serde_json::{Map, Value, json};

use super::channels::Channel;
use super::find::{Definition, Written, Wrong, find};
use super::group::{in_order, text};
use super::used::{Templates, Use};
use crate::error::{Findings, allowed};
use crate::files::Files;
use crate::schemas::Schemas;
use crate::sha256;
use crate::source_map::{SourceMap, child, element};

pub(super) struct Filling<'a> {
    pub(super) profile: &'a mut Map<String, Value>,
    files: &'a Files<'a>,
    schemas: &'a Schemas,
    pub(super) spans: &'a mut SourceMap,
    pub(super) errors: &'a mut Findings,
    pub(super) known: BTreeMap<String, Definition>,
    pub(super) templates: Templates,
    /// Results of searches for templates, by name of the template. They are stored because many devices may have the
    /// same template.
    searched: BTreeMap<String, Result<Written, Wrong>>,
    /// Devices whose template has an error, which was reported already.
    broken: HashSet<String>,
}

impl<'a> Filling<'a> {
    pub(super) fn new(
        profile: &'a mut Map<String, Value>,
        (files, schemas): (&'a Files<'a>, &'a Schemas),
        spans: &'a mut SourceMap,
        errors: &'a mut Findings,
    ) -> Filling<'a> {
        let (known, templates) = (BTreeMap::new(), Templates::new());
        let (searched, broken) = (BTreeMap::new(), HashSet::new());
        Filling { profile, files, schemas, spans, errors, known, templates, searched, broken }
    }

    pub(super) fn run(mut self) -> Templates {
        for name in in_order(self.profile, "device", self.spans) {
            self.device(&name);
        }
        for (table, is_signal) in [("signal", true), ("output", false)] {
            for name in in_order(self.profile, table, self.spans) {
                self.user(table, &name, is_signal);
            }
        }
        self.heartbeat();
        self.silent_heartbeats();
        for name in self.known.keys().cloned().collect::<Vec<_>>() {
            self.checks(&name);
        }
        self.templates
    }

    fn device(&mut self, name: &str) {
        let path = child("device", name);
        let Some(table) = self.table("device", name) else { return };
        let Some(template) = text(table, "template").map(str::to_owned) else { return };
        let variant = text(table, "variant").map(str::to_owned);
        let base = table.get("base").and_then(Value::as_u64).and_then(|base| u16::try_from(base).ok());
        let pin = text(table, "sha256").map(str::to_owned);
        let found = self.searched.entry(template.clone());
        let found = found.or_insert_with(|| find(&template, (self.files, self.schemas), self.errors)).clone();
        let defined = found.and_then(|Written { own_file, text, body }| {
            pinned(&template, pin.as_deref(), &text)?;
            let Some(body) = body else { return Ok(None) };
            let mut definition = Definition::of(&template, body, variant.as_deref(), base)?;
            (definition.template.own_file, definition.template.text) = (own_file, text);
            Ok(Some(definition))
        });
        let definition = match defined {
            Ok(Some(definition)) => definition,
            Ok(None) => {
                self.broken.insert(name.to_owned());
                return;
            }
            Err((key, message, help)) => {
                self.broken.insert(name.to_owned());
                return self.invalid(&child(&path, key), message, help);
            }
        };
        let note = format!("this value comes from template `{template}`");
        let at = child(&path, "template");
        if let Some(functions) = definition.functions.clone() {
            self.put("device", name, "functions", functions, &at, &note);
        }
        if let Some(dbc) = definition.dbc.clone() {
            self.put("device", name, "dbc", Value::from(dbc), &at, &note);
        }
        self.node(name, &definition, &at, &note);
        self.quirks(name, &definition, &at, &note);
        self.templates.insert(name.to_owned(), definition.template.clone());
        self.known.insert(name.to_owned(), definition);
    }

    /// Adds the settings of a CANopen node. If a list of the profile has an entry for the same object or code, that
    /// entry replaces the template's. Entries of the profile come first.
    fn node(&mut self, name: &str, definition: &Definition, at: &str, note: &str) {
        for (key, value) in definition.node.iter().flatten() {
            let Value::Array(below) = value else {
                self.put("device", name, key, value.clone(), at, note);
                continue;
            };
            let identity = if key == "setup" { "sdo" } else { "code" };
            let own = self.table("device", name).and_then(|device| device.get(key)).and_then(Value::as_array);
            let own = own.cloned().unwrap_or_default();
            let is_own = |entry: &&Value| !own.iter().any(|known| known.get(identity) == entry.get(identity));
            let more: Vec<Value> = below.iter().filter(is_own).cloned().collect();
            for place in own.len()..own.len() + more.len() {
                self.spans.fill_in(&element(&child(&child("device", name), key), place), at, note);
            }
            let path = child(&child("device", name), key);
            if !self.spans.contains(&path) {
                self.spans.fill_in(&path, at, note);
            }
            if let Some(device) = self.table_mut("device", name) {
                device.insert(key.clone(), Value::Array(own.into_iter().chain(more).collect()));
            }
        }
    }

    fn quirks(&mut self, name: &str, definition: &Definition, at: &str, note: &str) {
        let Some(Value::Object(below)) = &definition.quirks else { return };
        self.put("device", name, "quirks", json!({}), at, note);
        let path = child(&child("device", name), "quirks");
        for (key, value) in
            below.iter().filter(|(key, _)| !self.spans.contains(&child(&path, key))).collect::<Vec<_>>()
        {
            self.spans.fill_in(&child(&path, key), at, note);
            let own =
                self.table_mut("device", name).and_then(|device| device.get_mut("quirks")?.as_object_mut());
            if let Some(own) = own {
                own.insert(key.clone(), value.clone());
            }
        }
    }

    /// Adds the keys of a channel to the signal or output that names this channel (key `channel`).
    fn user(&mut self, table: &'static str, name: &str, is_signal: bool) {
        let Some(user) = self.table(table, name) else { return };
        let at = child(&child(table, name), "channel");
        let channel = match user.get("channel") {
            Some(Value::String(name)) => name.clone(),
            Some(Value::Number(number)) => number.to_string(),
            // The name of the key is misspelt.
            _ if self.spans.is_meant(&at) => return self.nothing_missing(table, name, &child(table, name)),
            _ => return,
        };
        let Some(device) = text(user, "device").map(str::to_owned) else {
            return self.nothing_missing(table, name, &at);
        };
        let template = child(&child("device", &device), "template");
        let is_known = self.known.contains_key(&device);
        let is_wrong = !is_known && (self.spans.contains(&template) || self.spans.is_meant(&template));
        if is_wrong || self.broken.contains(&device) {
            return self.nothing_missing(table, name, &at);
        }
        let Some(definition) = self.known.get(&device) else {
            if self.table("device", &device).is_some() {
                let help =
                    format!("write template = \"…\" at device `{device}`, or `register` and `type` here");
                self.invalid(&at, format!("device `{device}` has no template, and so no channels"), help);
            }
            return self.nothing_missing(table, name, &at);
        };
        let (list, other) = if is_signal {
            (&definition.channels, &definition.targets)
        } else {
            (&definition.targets, &definition.channels)
        };
        let Some(found) = list.iter().find(|known| known.name == channel).cloned() else {
            let template = &self.templates[&device].name;
            let help = match (list.is_empty(), other.iter().any(|known| known.name == channel)) {
                (_, true) if is_signal => "this channel is written, not read: use it at an output".to_owned(),
                (_, true) => "this channel is read, not written: use it at a signal".to_owned(),
                (true, _) => {
                    format!(
                        "no channel of `{template}` can be {}",
                        if is_signal { "read" } else { "written" }
                    )
                }
                _ => allowed(&channel, list.iter().map(|known| known.name.as_str())),
            };
            self.invalid(&at, format!("template `{template}` has no channel `{channel}`"), help);
            return self.nothing_missing(table, name, &at);
        };
        self.ask(table, name, &device, &found);
        let overridden = self.bring(table, name, &device, &found, &at);
        let unverified = definition_text(&self.known[&device], &found.group);
        if let Some(template) = self.templates.get_mut(&device) {
            template.uses.push(Use { name: name.to_owned(), channel, overridden });
            template.unverified.extend(unverified.filter(|text| !template.unverified.contains(text)));
        }
        if !is_signal {
            self.set(name, &device, &at);
        }
    }

    /// Suppresses errors about missing keys of a signal or output whose channel was not found. The missing
    /// channel has already been reported.
    fn nothing_missing(&mut self, table: &str, name: &str, at: &str) {
        let path = child(table, name);
        for key in ["register", "node", "type", "writes", "scale", "word_order", "read_back"]
            .map(|key| child(&path, key))
        {
            if !self.spans.contains(&key) {
                self.spans.fill_in(&key, at, "");
            }
        }
    }

    /// Reports each missing key that the profile must set for this channel. The template has no default for
    /// such a key, because a wrong default would move an axis.
    fn ask(&mut self, table: &str, name: &str, device: &str, channel: &Channel) {
        let path = child(table, name);
        for key in &channel.asks {
            let at = child(&path, key);
            if !self.spans.contains(&at) {
                let template = &self.templates[device].name;
                let why = definition_text(&self.known[device], &channel.group).unwrap_or_default();
                let message = format!("`{key}` is missing: template `{template}` does not set it");
                let help = if why.is_empty() {
                    "the device's manual states the value of this key".to_owned()
                } else {
                    why
                };
                self.errors.push(self.spans.at_key(&at, message, Some(help)));
                self.spans.fill_in(&at, &child(&path, "channel"), "");
            }
        }
    }

    /// Adds the keys of a channel that the profile does not set. Returns the names of the keys that the profile sets
    /// itself.
    pub(super) fn bring(
        &mut self,
        table: &'static str,
        name: &str,
        device: &str,
        channel: &Channel,
        at: &str,
    ) -> Vec<String> {
        let note = self.note(device, &channel.name);
        let mut overridden = Vec::new();
        for (key, value) in &channel.keys {
            let own = self.table_mut(table, name).and_then(|user| user.get_mut(key));
            if let (Some(Value::Object(own)), Value::Object(below)) = (own, value) {
                for (inner, value) in below {
                    own.entry(inner.clone()).or_insert_with(|| value.clone());
                }
                continue;
            }
            let is_there = self.table(table, name).is_some_and(|user| user.contains_key(key));
            if is_there || self.spans.contains(&child(&child(table, name), key)) {
                overridden.push(key.clone());
                continue;
            }
            let value = match (key.as_str(), value) {
                ("fault_when" | "when", Value::String(condition)) => {
                    Value::from(self.condition(condition, device, at))
                }
                _ => value.clone(),
            };
            self.put(table, name, key, value, at, &note);
        }
        overridden
    }

    pub(super) fn note(&self, device: &str, channel: &str) -> String {
        let template = self.templates.get(device).map_or("", |template| template.name.as_str());
        format!("this value comes from channel `{channel}` of template `{template}`")
    }

    /// Adds an output to the output set of its device. Does nothing if the template has no set, or if the profile
    /// names another set for this output.
    fn set(&mut self, output: &str, device: &str, at: &str) {
        let Some(set) = self.known[device].set.clone() else { return };
        let note = format!("this value comes from template `{}`", self.templates[device].name);
        self.put("output", output, "set", Value::from(device), at, &note);
        if self.table("output", output).and_then(|output| text(output, "set")) != Some(device) {
            return;
        }
        let path = child("set", device);
        if !self.spans.contains(&path) {
            self.spans.fill_in(&path, at, &note);
        }
        let sets = self.profile.entry("set").or_insert_with(|| json!({}));
        if let Some(sets) = sets.as_object_mut() {
            sets.entry(device.to_owned()).or_insert_with(|| json!({}));
        }
        for (key, value) in set.as_object().into_iter().flatten() {
            if !self.spans.contains(&child(&path, key)) {
                self.put("set", device, key, value.clone(), at, &note);
            }
        }
    }

    fn heartbeat(&mut self) {
        let beat = self.profile.get("heartbeat").and_then(Value::as_object);
        let Some(device) = beat.and_then(|beat| text(beat, "device")).map(str::to_owned) else { return };
        let Some(register) = self.known.get(&device).and_then(|known| known.heartbeat.clone()) else {
            return;
        };
        let note = format!("this value comes from template `{}`", self.templates[&device].name);
        if self.spans.contains("heartbeat.register") {
            return;
        }
        self.spans.fill_in("heartbeat.register", "heartbeat.device", &note);
        if let Some(beat) = self.profile.get_mut("heartbeat").and_then(Value::as_object_mut) {
            beat.insert("register".to_owned(), register);
        }
    }

    /// Reports each device that has outputs and needs a heartbeat, but is not the device of `[heartbeat]` in
    /// the profile.
    fn silent_heartbeats(&mut self) {
        let of_heartbeat = self.profile.get("heartbeat").and_then(|beat| text(beat.as_object()?, "device"));
        let outputs = self.profile.get("output").and_then(Value::as_object);
        let written = outputs.into_iter().flat_map(Map::values).filter_map(Value::as_object);
        let written: HashSet<&str> = written.filter_map(|output| text(output, "device")).collect();
        let is_silent = |name: &str| written.contains(name) && of_heartbeat != Some(name);
        let known = self.known.iter().filter(|(name, _)| is_silent(name));
        let silent = known
            .filter_map(|(name, known)| Some((name.clone(), known.heartbeat.as_ref()?.as_str()?.to_owned())));
        for (name, register) in silent.collect::<Vec<_>>() {
            let template = &self.templates[&name].name;
            let message = format!(
                "`{template}` expects a heartbeat in {register}, but the profile sends none: `{name}` would \
                 report that the gateway has failed"
            );
            let help = format!("add [heartbeat] with device = \"{name}\" and every = \"500ms\"");
            self.invalid(&child(&child("device", &name), "template"), message, help);
        }
    }

    pub(super) fn table(&self, table: &str, name: &str) -> Option<&Map<String, Value>> {
        self.profile.get(table)?.get(name)?.as_object()
    }

    pub(super) fn table_mut(&mut self, table: &str, name: &str) -> Option<&mut Map<String, Value>> {
        self.profile.get_mut(table)?.get_mut(name)?.as_object_mut()
    }

    /// Adds a key to a table unless the table has the key already. For error messages, the added key gets the
    /// position of the key `at`, and `note` as a text about its origin.
    fn put(&mut self, table: &str, name: &str, key: &str, value: Value, at: &str, note: &str) {
        let Some(into) = self.table_mut(table, name) else { return };
        if into.contains_key(key) {
            return;
        }
        into.insert(key.to_owned(), value);
        self.spans.fill_in(&child(&child(table, name), key), at, note);
    }

    pub(super) fn invalid(&mut self, path: &str, message: impl Into<String>, help: impl Into<String>) {
        self.errors.push(self.spans.at_value(path, message, Some(help.into())));
    }
}

/// Checks the SHA-256 of a template against the SHA-256 in the profile (`pin`). Returns an error if they differ.
fn pinned(template: &str, pin: Option<&str>, text: &str) -> Result<(), Wrong> {
    let found = sha256(text.as_bytes());
    match pin {
        Some(pin) if !pin.eq_ignore_ascii_case(&found) => Err((
            "sha256",
            format!(
                "template `{template}` is not the one that this profile was written for: the SHA-256 of the \
                 template is {found}"
            ),
            "check what the template contains now: without this key, `isotherm check` shows the template and \
             the changes since the last run. Then write the new SHA-256"
                .to_owned(),
        )),
        _ => Ok(()),
    }
}

fn definition_text(definition: &Definition, group: &str) -> Option<String> {
    definition.unverified_of.get(group).cloned()
}
