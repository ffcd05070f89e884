//! Template for the body of a message to a server: JSON with placeholders for the fields of the message.

use serde_json::Value;

use crate::error::allowed;
use crate::safe_file::cut;

/// Field of a message that can replace a placeholder. A field that the event does not have is an empty text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MessageField {
    /// Name of the machine.
    Machine,
    /// Date and time of the event, as text.
    When,
    /// Kind of the event: its name in the list of events.
    Kind,
    /// Level of the event: `info`, `warning` or `error`.
    Level,
    /// Sentence that describes the event.
    Text,
    /// Cause of the reported fault.
    Cause,
    /// Hint how to remove the reported fault.
    Hint,
    /// Name of the axis that the event concerns.
    Axis,
    /// Name of the device that the event concerns.
    Device,
    /// Name of the bus that the event concerns.
    Bus,
    /// Name of the signal that the event concerns.
    Signal,
    /// Name of the output that the event concerns.
    Output,
    /// Alarm that the event raised.
    Alarm,
    /// Alarms that the event ended, separated by commas.
    AlarmsOver,
    /// The text "dry run" if the gateway is in a dry run, otherwise empty.
    DryRun,
    /// Consecutive number of the message.
    Count,
    /// Number of earlier messages that were dropped and are not reported to the server yet.
    Dropped,
}

impl MessageField {
    /// Every field, with the name of its placeholder.
    pub const ALL: [(MessageField, &'static str); 17] = [
        (MessageField::Machine, "machine"),
        (MessageField::When, "when"),
        (MessageField::Kind, "kind"),
        (MessageField::Level, "level"),
        (MessageField::Text, "text"),
        (MessageField::Cause, "cause"),
        (MessageField::Hint, "hint"),
        (MessageField::Axis, "axis"),
        (MessageField::Device, "device"),
        (MessageField::Bus, "bus"),
        (MessageField::Signal, "signal"),
        (MessageField::Output, "output"),
        (MessageField::Alarm, "alarm"),
        (MessageField::AlarmsOver, "alarms_over"),
        (MessageField::DryRun, "dry_run"),
        (MessageField::Count, "count"),
        (MessageField::Dropped, "dropped"),
    ];

    fn named(name: &str) -> Option<MessageField> {
        MessageField::ALL.into_iter().find(|(_, known)| *known == name).map(|(field, _)| field)
    }
}

/// Template for the body of a message. A placeholder is the name of a field in braces: `{machine}`.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyTemplate(Value);

/// Message and hint for a mistake in a template.
type Wrong = (String, String);

const EXAMPLE: &str =
    "write JSON, with the fields inside quotation marks: body = '{\"text\": \"{machine}: {text}\"}'";

impl BodyTemplate {
    /// Parses a template.
    ///
    /// # Errors
    /// The text is not JSON, or a placeholder is not the name of a field. The error is a message and a hint.
    pub fn parse(text: &str) -> Result<BodyTemplate, Wrong> {
        let json: Value = serde_json::from_str(text)
            .map_err(|why| (format!("this is not JSON: {why}"), EXAMPLE.to_owned()))?;
        check(&json)?;
        Ok(BodyTemplate(json))
    }

    /// Returns whether the template contains a placeholder.
    pub fn has_fields(&self) -> bool {
        has_fields(&self.0)
    }

    /// Returns the JSON of the template, with its placeholders.
    pub fn json(&self) -> &Value {
        &self.0
    }

    /// Replaces the placeholders of the template. `value` returns the text of a field. Placeholders inside that text
    /// are not replaced.
    pub fn fill(&self, value: impl Fn(MessageField) -> String) -> Value {
        filled(&self.0, &value)
    }
}

/// Splits a text at its first placeholder. Returns the text before it, the name of the field, and the text after it.
/// `None` if there is no placeholder.
fn next_place(text: &str) -> Option<(&str, &str, &str)> {
    let mut from = 0;
    while let Some(found) = text[from..].find('{') {
        let open = from + found;
        let inner = &text[open + 1..];
        let length = inner.bytes().take_while(|byte| byte.is_ascii_alphabetic() || *byte == b'_').count();
        if length > 0 && inner[length..].starts_with('}') {
            return Some((&text[..open], &inner[..length], &inner[length + 1..]));
        }
        from = open + 1;
    }
    None
}

fn check(json: &Value) -> Result<(), Wrong> {
    match json {
        Value::String(text) => check_text(text),
        Value::Array(items) => items.iter().try_for_each(check),
        Value::Object(entries) => entries.iter().try_for_each(|(key, value)| match next_place(key) {
            Some((_, name, _)) => {
                let message = format!("the key `{}` contains the placeholder `{{{name}}}`", cut(key, 40));
                Err((
                    message,
                    "placeholders are allowed only in values: write the key without a placeholder".to_owned(),
                ))
            }
            None => check(value),
        }),
        Value::Null | Value::Bool(_) | Value::Number(_) => Ok(()),
    }
}

fn check_text(text: &str) -> Result<(), Wrong> {
    let mut rest = text;
    while let Some((_, name, after)) = next_place(rest) {
        if MessageField::named(name).is_none() {
            let help = allowed(name, MessageField::ALL.map(|(_, known)| known));
            return Err((format!("a message has no field `{name}`"), help));
        }
        rest = after;
    }
    Ok(())
}

fn has_fields(json: &Value) -> bool {
    match json {
        Value::String(text) => next_place(text).is_some(),
        Value::Array(items) => items.iter().any(has_fields),
        Value::Object(entries) => entries.values().any(has_fields),
        Value::Null | Value::Bool(_) | Value::Number(_) => false,
    }
}

fn filled(json: &Value, value: &impl Fn(MessageField) -> String) -> Value {
    match json {
        Value::String(text) => Value::String(filled_text(text, value)),
        Value::Array(items) => Value::Array(items.iter().map(|item| filled(item, value)).collect()),
        Value::Object(entries) => {
            Value::Object(entries.iter().map(|(key, inner)| (key.clone(), filled(inner, value))).collect())
        }
        Value::Null | Value::Bool(_) | Value::Number(_) => json.clone(),
    }
}

fn filled_text(text: &str, value: &impl Fn(MessageField) -> String) -> String {
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    while let Some((before, name, after)) = next_place(rest) {
        out.push_str(before);
        // The names were checked when the template was parsed.
        out.push_str(&MessageField::named(name).map(value).unwrap_or_default());
        rest = after;
    }
    out.push_str(rest);
    out
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn name_of(field: MessageField) -> String {
        let (_, name) = MessageField::ALL.into_iter().find(|(known, _)| *known == field).unwrap();
        format!("<{name}>")
    }

    #[test]
    fn fields_are_filled_in_where_a_text_names_them() {
        for (template, body) in [
            (r#"{"text": "{machine}: {text}"}"#, r#"{"text":"<machine>: <text>"}"#),
            (r#"[{"a": ["{alarm}{axis}", 1, true, null]}]"#, r#"[{"a":["<alarm><axis>",1,true,null]}]"#),
            (r#""{count} {dropped}""#, r#""<count> <dropped>""#),
            // Braces without a name between them are ordinary characters.
            (
                r#"{"a": "{ {} {{DATE({when}, SHORT)}} {text"}"#,
                r#"{"a":"{ {} {{DATE(<when>, SHORT)}} {text"}"#,
            ),
            (r#"{"µ{": "é{text}ü"}"#, r#"{"µ{":"é<text>ü"}"#),
        ] {
            let template = BodyTemplate::parse(template).unwrap();
            assert_eq!(template.fill(name_of).to_string(), body);
            assert!(template.has_fields());
        }
        let plain = BodyTemplate::parse(r#"{"text": "an alarm"}"#).unwrap();
        assert!(!plain.has_fields());
        assert_eq!(plain.fill(name_of), *plain.json());
    }

    #[test]
    fn a_field_that_contains_a_place_or_json_stays_one_text() {
        let template = BodyTemplate::parse(r#"{"text": "{text}"}"#).unwrap();
        let text = "\"}, {machine} \\ \u{1}\n{text}";
        let body = template.fill(|_| text.to_owned()).to_string();
        let read: Value = serde_json::from_str(&body).unwrap();
        assert_eq!(read, serde_json::json!({ "text": text }));
    }

    #[test]
    fn every_name_of_a_field_is_a_place() {
        for (field, name) in MessageField::ALL {
            assert_eq!(MessageField::named(name), Some(field));
            let template = BodyTemplate::parse(&format!("\"{{{name}}}\"")).unwrap();
            assert_eq!(template.fill(name_of), Value::String(format!("<{name}>")));
        }
    }

    #[test]
    fn a_template_that_cannot_be_filled_is_rejected_with_a_hint() {
        for (template, message, help) in [
            ("{machine}: {text}", "this is not JSON", "inside quotation marks"),
            (r#"{"count": {count}}"#, "this is not JSON", "inside quotation marks"),
            ("", "this is not JSON", "inside quotation marks"),
            (r#"{"text": "{mashine}"}"#, "no field `mashine`", "did you mean `machine`?"),
            (r#"{"text": "{Machine}"}"#, "no field `Machine`", "did you mean `machine`?"),
            (r#"{"text": ["{token}"]}"#, "no field `token`", "allowed: machine, when"),
            (r#"{"{text}": 1}"#, "the key `{text}` contains the placeholder `{text}`", "only in values"),
        ] {
            let (said, hint) = BodyTemplate::parse(template).unwrap_err();
            assert!(said.contains(message) && hint.contains(help), "{template}: {said}; {hint}");
        }
    }

    proptest! {
        #[test]
        fn a_body_has_the_texts_of_its_template_with_the_fields_filled_in(
            parts in proptest::collection::vec("[a-z {}\"\\\\é]{0,12}", 1..4), value in any::<String>()
        ) {
            // A part that happens to name something is left out.
            let parts: Vec<String> = parts.into_iter().filter(|part| next_place(part).is_none()).collect();
            let text = parts.join(" {text} ");
            let template = BodyTemplate::parse(&Value::String(text.clone()).to_string()).unwrap();
            let expected = text.replace("{text}", &value);
            prop_assert_eq!(template.fill(|_| value.clone()), Value::String(expected));
        }
    }
}
