//! Converts conditions on channels of a template into conditions on signals.

use serde_json::{Value, json};

use super::channels::Channel;
use super::fill::Filling;
use super::used::Use;
use crate::source_map::child;

impl Filling<'_> {
    /// Converts a condition on channels into a condition on signals. If no signal reads a channel of the condition, a
    /// signal for it is added to the profile.
    pub(super) fn condition(&mut self, condition: &str, device: &str, at: &str) -> String {
        let mut out = String::new();
        let mut rest = condition;
        while !rest.is_empty() {
            let is_part = |c: char| c.is_alphanumeric() || c == '_';
            let end = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
            if end == 0 {
                let width = rest.chars().next().map_or(1, char::len_utf8);
                out.push_str(&rest[..width]);
                rest = &rest[width..];
                continue;
            }
            let word = &rest[..end];
            // Channels may be named by numbers, but a number in a condition is a number.
            let is_name = !word.starts_with(|first: char| first.is_ascii_digit());
            let known = self.known.get(device).filter(|_| is_name);
            let channel =
                known.and_then(|known| known.channels.iter().find(|channel| channel.name == word).cloned());
            match channel {
                Some(channel) => out.push_str(&self.signal_of(device, &channel, at)),
                None => out.push_str(word),
            }
            rest = &rest[end..];
        }
        out
    }

    /// Returns the name of the signal that reads a channel. If no signal reads this channel, adds a signal.
    fn signal_of(&mut self, device: &str, channel: &Channel, at: &str) -> String {
        let signals = self.profile.get("signal").and_then(Value::as_object).into_iter().flatten();
        let reads = |signal: &Value| {
            let named = match signal.get("channel") {
                Some(Value::String(name)) => *name == channel.name,
                Some(Value::Number(number)) => number.to_string() == channel.name,
                _ => false,
            };
            named && signal.get("device").and_then(Value::as_str) == Some(device)
        };
        let readers = signals.filter(|(_, signal)| reads(signal)).map(|(name, _)| name.clone());
        // A name with a hyphen is not allowed in a condition.
        if let Some(name) = readers.into_iter().find(|name| !name.contains('-')) {
            return name;
        }
        let mut name = format!("{device}_{}", channel.name).replace('-', "_");
        while self.table("signal", &name).is_some() {
            name.push('_');
        }
        let made = json!({ "device": device, "channel": channel.name });
        if let Some(signals) = self.profile.entry("signal").or_insert_with(|| json!({})).as_object_mut() {
            signals.insert(name.clone(), made);
        }
        let note = self.note(device, &channel.name);
        self.spans.fill_in(&child("signal", &name), at, &note);
        self.bring("signal", &name, device, channel, at);
        if let Some(template) = self.templates.get_mut(device) {
            let overridden = Vec::new();
            template.uses.push(Use { name: name.clone(), channel: channel.name.clone(), overridden });
        }
        name
    }
}
