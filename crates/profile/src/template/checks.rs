//! Adds the checks of a template to a device: registers with expected values.

use serde_json::Value;

use super::channels::{Channel, OF_GROUP};
use super::fill::Filling;
use super::group::text;
use crate::error::allowed;
use crate::kinds::can::channel::of_member;
use crate::kinds::modbus::channel::shifted;
use crate::source_map::{child, element};

impl Filling<'_> {
    /// Adds the checks of the template to the checks that the profile states for the device.
    pub(super) fn checks(&mut self, device: &str) {
        let path = child("device", device);
        let table = self.table("device", device).cloned().unwrap_or_default();
        let expect = table.get("expect").and_then(Value::as_object).cloned().unwrap_or_default();
        let definition = self.known[device].clone();
        let names = || definition.checks.iter().map(|(name, _)| name.as_str());
        for name in expect.keys().filter(|name| !names().any(|known| known == *name)) {
            let message = format!("template `{}` has no check `{name}`", self.templates[device].name);
            let at = child(&child(&path, "expect"), name);
            self.errors.push(self.spans.at_key(&at, message, Some(allowed(name, names()))));
        }
        let base = table.get("base").and_then(Value::as_u64).and_then(|base| u16::try_from(base).ok());
        let used: Vec<&Channel> = definition
            .channels
            .iter()
            .filter(|channel| self.templates[device].uses.iter().any(|used| used.channel == channel.name))
            .collect();
        let mut verify = Vec::new();
        let mut unchecked = Vec::new();
        for (name, group) in &definition.checks {
            let what = text(group, "what").unwrap_or(name);
            let equals = match expect.get(name) {
                Some(Value::String(_)) => {
                    unchecked.push(format!("{what}: omitted by `expect` in the profile"));
                    continue;
                }
                Some(number) => number.clone(),
                None => match group.get("equals") {
                    Some(number) => number.clone(),
                    None => {
                        unchecked.push(format!("{what}: write expect = {{ {name} = … }} at the device"));
                        continue;
                    }
                },
            };
            let of = text(group, "of");
            let members: Vec<(u16, Option<&str>)> = match of {
                None => vec![(0, None)],
                Some(of) => {
                    let members = used.iter().filter(|channel| channel.group == of);
                    members.map(|channel| (channel.place, Some(channel.name.as_str()))).collect()
                }
            };
            let stride = group.get("stride").and_then(Value::as_u64).and_then(|far| u16::try_from(far).ok());
            for (place, channel) in members {
                let mut entry = group.clone();
                entry.retain(|key, _| key != "of" && !OF_GROUP.contains(&key.as_str()));
                entry.insert("equals".to_owned(), equals.clone());
                let what =
                    channel.map_or_else(|| what.to_owned(), |name| format!("{what} of channel {name}"));
                entry.insert("what".to_owned(), Value::from(what));
                let stride = stride.unwrap_or(1);
                let (key, moved) = match (text(group, "sdo"), text(group, "register")) {
                    (Some(object), _) => ("sdo", of_member(object, place, stride)),
                    (None, register) => {
                        ("register", shifted(register.unwrap_or_default(), place, stride, base.unwrap_or(0)))
                    }
                };
                match moved {
                    Ok(moved) => entry.insert(key.to_owned(), Value::from(moved)),
                    Err(why) => {
                        return self.invalid(
                            &child(&path, "template"),
                            why,
                            "correct the file of the template",
                        );
                    }
                };
                let key = if expect.contains_key(name) {
                    child(&child(&path, "expect"), name)
                } else {
                    child(&path, "template")
                };
                verify.push((Value::Object(entry), key));
            }
        }
        let note = format!("this value comes from template `{}`", self.templates[device].name);
        if let Some(template) = self.templates.get_mut(device) {
            template.unchecked = unchecked;
        }
        if verify.is_empty() {
            return;
        }
        let own = table.get("verify").and_then(Value::as_array).cloned().unwrap_or_default();
        for (place, (_, at)) in verify.iter().enumerate() {
            let entry = element(&child(&path, "verify"), own.len() + place);
            self.spans.fill_in(&entry, at, &note);
            self.spans.fill_in(&child(&entry, "equals"), at, &note);
        }
        let all: Vec<Value> = own.into_iter().chain(verify.into_iter().map(|(entry, _)| entry)).collect();
        if let Some(table) = self.table_mut("device", device) {
            table.insert("verify".to_owned(), Value::Array(all));
        }
    }
}
