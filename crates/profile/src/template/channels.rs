//! Expands a group of a template into `count` similar channels. `{n}` in a name is the channel number, and the
//! registers follow each other. The calculation has no side effects.

use serde_json::{Map, Value};

use super::group::{Group, text, texts};
use crate::kinds::can::channel as can;
use crate::kinds::modbus::channel as modbus;
use crate::tables::register::TypeWord;

/// Keys of a group that describe its sequence of channels. A single channel does not get these keys.
pub(super) const OF_GROUP: [&str; 6] = ["name", "count", "from", "stride", "unverified", "ask"];

/// Member of a group of a template: a channel that is read, a target that is written, or a check.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Channel {
    /// Name of the channel in a profile, for example "0" or "cjc".
    pub(super) name: String,
    /// Name of the group of the template to which the channel belongs.
    pub(super) group: String,
    /// Index of the channel in its group, counted from 0.
    pub(super) place: u16,
    /// Keys that the profile must set for this channel.
    pub(super) asks: Vec<String>,
    /// Keys that the channel adds to a signal or an output.
    pub(super) keys: Map<String, Value>,
}

/// Expands a group into its channels. The number `base` is added to all register numbers.
///
/// # Errors
/// A register is invalid, or beyond the last register. The error is one sentence.
pub(super) fn of_group(name: &str, group: &Group, base: u16) -> Result<Vec<Channel>, String> {
    let number = |key: &str, default: u16| {
        let value = group.get(key).and_then(Value::as_u64);
        value.and_then(|value| u16::try_from(value).ok()).unwrap_or(default)
    };
    let (count, from) = (number("count", 1), number("from", 0));
    let stride = number("stride", can::width(group).unwrap_or_else(|| registers(group)));
    (0..count)
        .map(|place| {
            let label = from.saturating_add(place).to_string();
            let mut keys = Map::new();
            for (key, value) in group.iter().filter(|(key, _)| !OF_GROUP.contains(&key.as_str())) {
                let value = numbered(value, &label);
                let value = match can::moved(key, &value, place, stride) {
                    Some(value) => value?,
                    None => modbus::moved(value, key, place, stride, base)?,
                };
                keys.insert(key.clone(), value);
            }
            let channel = text(group, "name").unwrap_or(name).replace("{n}", &label);
            Ok(Channel { name: channel, group: name.to_owned(), place, asks: texts(group, "ask"), keys })
        })
        .collect()
}

/// Returns the number of registers of one channel.
fn registers(group: &Group) -> u16 {
    let kind: Option<TypeWord> = group.get("type").and_then(|kind| serde_json::from_value(kind.clone()).ok());
    kind.map_or(1, |TypeWord(kind)| kind.registers())
}

fn numbered(value: &Value, label: &str) -> Value {
    match value {
        Value::String(text) => Value::from(text.replace("{n}", label)),
        other => other.clone(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::kinds::can::channel::of_member;
    use crate::kinds::modbus::channel::shifted;

    fn group(value: Value) -> Group {
        value.as_object().unwrap().clone()
    }

    #[test]
    fn the_channels_of_a_group_follow_each_other_by_the_width_of_their_type() {
        let pairs = group(json!({
            "name": "tc{n}", "from": 1, "count": 3, "register": "input:2048", "type": "i32", "fault_when": "s{n} != 0",
        }));
        let channels = of_group("temperature", &pairs, 10).unwrap();
        let reported: Vec<_> =
            channels.iter().map(|c| (c.name.as_str(), c.keys["register"].as_str().unwrap())).collect();
        assert_eq!(reported, [("tc1", "input:2058"), ("tc2", "input:2060"), ("tc3", "input:2062")]);
        assert_eq!(channels[2].keys["fault_when"], "s3 != 0");
        assert!(!channels[0].keys.contains_key("count"));
    }

    #[test]
    fn bits_of_a_register_follow_each_other_into_the_next_register() {
        assert_eq!(shifted("input:50.0", 5, 1, 0).unwrap(), "input:50.5");
        assert_eq!(shifted("input:50.14", 3, 1, 0).unwrap(), "input:51.1");
        assert_eq!(shifted("discrete:128", 7, 1, 0).unwrap(), "discrete:135");
        assert_eq!(shifted("input:50.4-15", 3, 1, 10).unwrap(), "input:63.4-15");
        assert!(shifted("holding:65535", 1, 1, 0).unwrap_err().contains("beyond the last"));
    }

    #[test]
    fn values_of_frames_follow_each_other_by_their_length_and_objects_by_their_subindex() {
        let frames = group(
            json!({ "name": "{n}", "from": 1, "count": 4, "pdo": { "number": 1, "start": 0, "length": 16 } }),
        );
        let starts: Vec<_> = of_group("t", &frames, 0)
            .unwrap()
            .iter()
            .map(|c| c.keys["pdo"]["start"].as_u64().unwrap())
            .collect();
        assert_eq!(starts, [0, 16, 32, 48]);
        let objects = group(json!({ "name": "s{n}", "count": 11, "sdo": "6150:01", "type": "u8" }));
        let channels = of_group("s", &objects, 0).unwrap();
        assert_eq!(
            (&channels[3].keys["sdo"], &channels[10].keys["sdo"]),
            (&json!("6150:04"), &json!("6150:0B"))
        );
        assert!(of_member("6150:F0", 16, 1).unwrap_err().contains("beyond the last subindex"));
    }

    #[test]
    fn registers_inside_tables_and_lists_move_with_their_block() {
        let display =
            group(json!({ "register": "holding:10", "beside": [{ "register": "holding:12", "value": 1 }] }));
        let channels = of_group("value", &display, 100).unwrap();
        assert_eq!(channels[0].keys["beside"][0]["register"], "holding:112");
    }
}
