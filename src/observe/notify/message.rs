//! Message to a server, and its JSON document.

use serde_json::{Map, Value};

use crate::observe::events::{Change, Entry, ReportedEvent};

/// Fields of an event that name its subject. If an event has exactly one of them, the message contains it.
const ABOUT: [&str; 5] = ["axis", "device", "bus", "signal", "output"];

/// Message about one event, for one server.
#[derive(Clone, Debug)]
pub(super) struct Message {
    machine: String,
    /// Number of messages for this server (entry of `[[notify]]`) since the start, including this one.
    count: u64,
    dry_run: bool,
    entry: Entry,
    change: Change,
}

impl Message {
    pub(super) fn of(happened: ReportedEvent<'_>, machine: &str, count: u64, dry_run: bool) -> Message {
        let (entry, change) = (happened.entry.clone(), happened.change.clone());
        Message { machine: machine.to_owned(), count, dry_run, entry, change }
    }

    /// Formats the document. `dropped` is the number of earlier messages that were dropped and are not reported to the
    /// server yet.
    pub(super) fn json(&self, dropped: u64) -> Value {
        let Entry { at, kind, level, text, data } = &self.entry;
        let mut json = Map::new();
        let mut put = |key: &str, value: Value| drop(json.insert(key.to_owned(), value));
        put("machine", self.machine.as_str().into());
        put("when", at.as_str().into());
        put("kind", kind.as_ref().into());
        // A word always has a JSON form.
        put("level", serde_json::to_value(level).unwrap_or_default());
        put("text", text.as_str().into());
        for key in ABOUT {
            if let Some(name) = data.get(key).filter(|name| name.is_string()) {
                put(key, name.clone());
            }
        }
        put("data", data.clone());
        if let Some(alarm) = &self.change.raised {
            put("alarm", alarm.as_str().into());
        }
        if !self.change.ended.is_empty() {
            put("alarms_over", self.change.ended.clone().into());
        }
        if self.dry_run {
            put("dry_run", true.into());
        }
        put("count", self.count.into());
        put("dropped", dropped.into());
        Value::Object(json)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observe::events::Event;
    use isotherm_core::explained::Explained;
    use isotherm_core::quantity::Moment;

    #[test]
    fn a_message_says_whose_it_is_when_what_and_how_many_there_were() {
        let fault = Explained::new("timeout", "is it powered?");
        let event = Event::DeviceLost { device: "cnc".into(), at: " (unit 2)".into(), fault };
        let change = Change { raised: Some("device cnc".into()), ended: Vec::new() };
        let entry = event.entry(Moment::default());
        let message = Message::of(
            ReportedEvent { event: &event, entry: &entry, change: &change },
            "press-7",
            17,
            false,
        );
        assert_eq!(
            message.json(3),
            serde_json::json!({
                "machine": "press-7", "when": "1970-01-01T00:00:00Z", "kind": "device-lost", "level": "warning",
                "text": "device cnc (unit 2): timeout: is it powered?", "device": "cnc", "alarm": "device cnc", "count": 17, "dropped": 3,
                "data": {
                    "device": "cnc", "at": " (unit 2)", "fault": "timeout: is it powered?", "cause": "timeout", "hint": "is it powered?",
                },
            })
        );
    }
}
