//! Message to a server, and its JSON document.

use serde_json::{Map, Value};

use crate::observe::events::{Change, Entry, ReportedEvent};
use isotherm_profile::{BodyTemplate, MessageField};

/// Fields of an event that name its subject. The message contains each of these fields that the event has.
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

    /// Formats the body of the message: the filled template, or the whole JSON document if `template` is `None`.
    /// `dropped` has the same meaning as in [`Message::json`].
    pub(super) fn body(&self, template: Option<&BodyTemplate>, dropped: u64) -> String {
        let json = match template {
            Some(template) => template.fill(|field| self.field(field, dropped)),
            None => self.json(dropped),
        };
        json.to_string()
    }

    /// Returns the text of a field for a template. The text is empty if the message does not have the field.
    fn field(&self, field: MessageField, dropped: u64) -> String {
        let Entry { at, kind, level, text, data } = &self.entry;
        let of_data = |key: &str| data.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
        match field {
            MessageField::Machine => self.machine.clone(),
            MessageField::When => at.clone(),
            MessageField::Kind => kind.clone().into_owned(),
            MessageField::Level => level.name().to_owned(),
            MessageField::Text => text.clone(),
            MessageField::Cause => of_data("cause"),
            MessageField::Hint => of_data("hint"),
            MessageField::Axis => of_data("axis"),
            MessageField::Device => of_data("device"),
            MessageField::Bus => of_data("bus"),
            MessageField::Signal => of_data("signal"),
            MessageField::Output => of_data("output"),
            MessageField::Alarm => self.change.raised.clone().unwrap_or_default(),
            MessageField::AlarmsOver => self.change.ended.join(", "),
            MessageField::DryRun => if self.dry_run { "dry run" } else { "" }.to_owned(),
            MessageField::Count => self.count.to_string(),
            MessageField::Dropped => dropped.to_string(),
        }
    }

    /// Formats the JSON document. `dropped` is the number of earlier messages that were dropped and are not reported to
    /// the server yet.
    pub(super) fn json(&self, dropped: u64) -> Value {
        let Entry { at, kind, level, text, data } = &self.entry;
        let mut json = Map::new();
        let mut put = |key: &str, value: Value| drop(json.insert(key.to_owned(), value));
        put("machine", self.machine.as_str().into());
        put("when", at.as_str().into());
        put("kind", kind.as_ref().into());
        put("level", level.name().into());
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

    fn message(event: &Event, change: Change, dry_run: bool) -> Message {
        let entry = event.entry(Moment::default());
        Message::of(ReportedEvent { event, entry: &entry, change: &change }, "press-7", 17, dry_run)
    }

    fn device_lost() -> Message {
        let fault = Explained::new("timeout", "is it powered?");
        let event = Event::DeviceLost { device: "cnc".into(), at: " (unit 2)".into(), fault };
        message(&event, Change { raised: Some("device cnc".into()), ended: Vec::new() }, false)
    }

    #[test]
    fn a_template_gets_the_fields_of_the_message_and_the_others_are_empty() {
        let template = BodyTemplate::parse(
            r#"["{machine} {when}", "{kind} {level}", "{text}", "{cause}|{hint}", "{device}|{axis}{bus}{signal}{output}",
                "{alarm}|{alarms_over}", "{dry_run}", "{count} {dropped}"]"#,
        )
        .unwrap();
        let body =
            |message: &Message| -> Value { serde_json::from_str(&message.body(Some(&template), 3)).unwrap() };
        assert_eq!(
            body(&device_lost()),
            serde_json::json!([
                "press-7 1970-01-01T00:00:00Z",
                "device-lost warning",
                "device cnc (unit 2): timeout: is it powered?",
                "timeout|is it powered?",
                "cnc|",
                "device cnc|",
                "",
                "17 3"
            ])
        );
        let ended = Change { raised: None, ended: vec!["device cnc".into(), "signal bed".into()] };
        let zeroed = body(&message(&Event::Zeroed, ended, true));
        assert_eq!((&zeroed[5], &zeroed[6]), (&"|device cnc, signal bed".into(), &"dry run".into()));
        let whole: Value = serde_json::from_str(&device_lost().body(None, 3)).unwrap();
        assert_eq!(whole, device_lost().json(3));
    }

    #[test]
    fn a_message_says_whose_it_is_when_what_and_how_many_there_were() {
        assert_eq!(
            device_lost().json(3),
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
