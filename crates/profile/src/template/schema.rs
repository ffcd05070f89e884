//! Schema of a template file: groups with the keys of signals, outputs, sets and checks of a profile.

use std::sync::LazyLock;

use serde_json::{Map, Value, json};

/// Keys of a signal that only a profile can set.
const OF_SIGNAL: [&str; 4] = ["device", "channel", "max_rate", "merge"];

/// Keys of an output that only a profile can set.
const OF_OUTPUT: [&str; 9] =
    ["axis", "device", "channel", "position", "when", "set", "share", "handshake", "restart"];

/// Keys of a device that a template sets for a CANopen node.
pub(super) const NODE: [&str; 3] = ["heartbeat", "setup", "emergency"];

static SCHEMA: LazyLock<Value> = LazyLock::new(made);

/// JSON Schema of a device template, draft 2020-12.
pub fn schema() -> &'static Value {
    &SCHEMA
}

fn made() -> Value {
    let profile = crate::schema();
    let keys = |table: &str, without: &[&str]| {
        let known = profile.pointer(&format!("/$defs/{table}/properties")).and_then(Value::as_object);
        let known = known.into_iter().flatten().filter(|(key, _)| !without.contains(&key.as_str()));
        known.map(|(key, schema)| (key.clone(), schema.clone())).collect::<Map<_, _>>()
    };
    let channels = groups(keys("Signal", &OF_SIGNAL), "Group of similar channels.");
    let targets = groups(keys("Output", &OF_OUTPUT), "Values that an output can write.");
    let mut checks = keys("Verify", &[]);
    checks.insert("of".to_owned(), text("Group of channels. Each used channel of the group is checked."));
    let checks = groups(checks, "Values that are read before arming.");
    let device = keys("Device", &[]);
    let variant = closed(
        Map::from_iter([
            ("title".to_owned(), text("Name of the variant.")),
            ("channel".to_owned(), channels.clone()),
            ("target".to_owned(), targets.clone()),
            ("check".to_owned(), checks.clone()),
        ]),
        &[],
    );
    let properties = Map::from_iter([
        ("title".to_owned(), text("Manufacturer and type of the device.")),
        ("source".to_owned(), text("Source of the registers: a manual or a public page.")),
        ("notes".to_owned(), list("Notes for users of the device.")),
        ("unverified".to_owned(), list("Facts that are not verified against the manual or on the device.")),
        (
            "movable".to_owned(),
            json!({ "description": "Whether `base` of the device moves the registers.", "type": "boolean" }),
        ),
        ("functions".to_owned(), device.get("functions").cloned().unwrap_or_default()),
        ("quirks".to_owned(), device.get("quirks").cloned().unwrap_or_default()),
        ("dbc".to_owned(), text("CAN: DBC file that describes the frames, beside the template.")),
        ("node".to_owned(), node(&device)),
        ("channel".to_owned(), channels),
        ("target".to_owned(), targets),
        ("check".to_owned(), checks),
        (
            "set".to_owned(),
            json!({ "$ref": "#/$defs/Set", "description": "Set in which the targets are written together." }),
        ),
        ("heartbeat".to_owned(), text("The register of `[heartbeat]`.")),
        (
            "variant".to_owned(),
            json!({
                "description": "Variants of the device. The profile selects one.",
                "type": "object",
                "additionalProperties": variant,
            }),
        ),
    ]);
    let mut whole = closed(properties, &["title", "source"]);
    if let (Some(table), Some(definitions)) = (whole.as_object_mut(), profile.get("$defs")) {
        table.insert("$schema".to_owned(), Value::from("https://json-schema.org/draft/2020-12/schema"));
        table.insert("title".to_owned(), Value::from("isotherm device template"));
        table.insert("$defs".to_owned(), definitions.clone());
    }
    whole
}

/// Schema of the keys of a CANopen node.
fn node(device: &Map<String, Value>) -> Value {
    let keys = NODE.map(|key| (key.to_owned(), device.get(key).cloned().unwrap_or_default()));
    let mut table = closed(Map::from_iter(keys), &[]);
    if let Some(table) = table.as_object_mut() {
        table.insert("description".to_owned(), Value::from("Settings of a CANopen node of this type."));
    }
    table
}

/// Schema of groups by name. A group has the keys of its members, and those that describe their sequence.
fn groups(mut keys: Map<String, Value>, what: &str) -> Value {
    let whole =
        |what: &str| json!({ "description": what, "type": "integer", "minimum": 0, "maximum": 65535 });
    keys.insert(
        "name".to_owned(),
        text("Name of the members; `{n}` is the number. Default: the group's name."),
    );
    keys.insert("count".to_owned(), whole("Number of members. Default 1."));
    keys.insert("from".to_owned(), whole("Number of the first member. Default 0."));
    keys.insert(
        "stride".to_owned(),
        whole(
            "Distance between members in registers, bits of a frame or subindexes. Default: the length of \
             one value.",
        ),
    );
    keys.insert("unverified".to_owned(), text("Fact about this group that is not verified."));
    keys.insert(
        "ask".to_owned(),
        list("Keys that the profile must set, because a wrong guess would move an axis."),
    );
    json!({ "description": what, "type": "object", "additionalProperties": closed(keys, &[]) })
}

fn closed(properties: Map<String, Value>, required: &[&str]) -> Value {
    json!({ "type": "object", "properties": properties, "required": required, "additionalProperties": false })
}

fn text(what: &str) -> Value {
    json!({ "description": what, "type": "string" })
}

fn list(what: &str) -> Value {
    json!({ "description": what, "type": "array", "items": { "type": "string" } })
}
