//! Generates the schema of a template file: groups with the keys of signals, outputs, sets and checks of a profile.

use serde_json::{Map, Value, json};

/// Keys of a signal that only a profile can set.
const OF_SIGNAL: [&str; 4] = ["device", "channel", "max_rate", "merge"];

/// Keys of an output that only a profile can set.
const OF_OUTPUT: [&str; 9] =
    ["axis", "device", "channel", "position", "when", "set", "share", "handshake", "restart"];

/// Keys of a device that a template sets for a CANopen node.
pub(super) const NODE: [&str; 3] = ["heartbeat", "setup", "emergency"];

/// Generates the JSON Schema of a device template, draft 2020-12, from the schema of a profile.
pub(crate) fn of_template(profile: &Value) -> Value {
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
    let variant = json!({
        "title": text("Name of the variant."),
        "channel": channels,
        "target": targets,
        "check": checks,
    });
    let properties = json!({
        "title": text("Manufacturer and type of the device."),
        "source": text("Source of the registers: a manual or a public page."),
        "notes": list("Notes for users of the device."),
        "unverified": list("Facts that are not verified against the manual or on the device."),
        "movable": { "description": "Whether `base` is added to all register numbers.", "type": "boolean" },
        "functions": device.get("functions"),
        "quirks": device.get("quirks"),
        "dbc": text("CAN: DBC file that describes the frames, next to the template."),
        "node": node(&device),
        "channel": channels,
        "target": targets,
        "check": checks,
        "set": { "$ref": "#/$defs/Set", "description": "Set in which the targets are written together." },
        "heartbeat": text("The register of `[heartbeat]`."),
        "variant": named("Variants of the device. The profile selects one.", &closed(&variant, &[])),
    });
    let mut whole = closed(&properties, &["title", "source"]);
    if let (Some(table), Some(definitions)) = (whole.as_object_mut(), profile.get("$defs")) {
        table.insert("$schema".to_owned(), Value::from("https://json-schema.org/draft/2020-12/schema"));
        table.insert("title".to_owned(), Value::from("isotherm device template"));
        table.insert("$defs".to_owned(), definitions.clone());
    }
    whole
}

/// Returns the schema of the keys of a CANopen node.
fn node(device: &Map<String, Value>) -> Value {
    let keys = NODE.map(|key| (key.to_owned(), device.get(key).cloned().unwrap_or_default()));
    let mut table = closed(&Value::Object(Map::from_iter(keys)), &[]);
    if let Some(table) = table.as_object_mut() {
        table.insert("description".to_owned(), Value::from("Settings of a CANopen node of this type."));
    }
    table
}

/// Returns the schema of named groups. A group has the keys of its members, and the keys that describe their sequence.
fn groups(mut keys: Map<String, Value>, what: &str) -> Value {
    let whole =
        |what: &str| json!({ "description": what, "type": "integer", "minimum": 0, "maximum": 65535 });
    let stride = "Distance between two members of the group, in registers, bits of a frame or subindexes. \
                  Default: the length of one value.";
    let own = [
        ("name", text("Name of each member; `{n}` is the number of the member. Default: the group's name.")),
        ("count", whole("Number of members of the group. Default 1.")),
        ("from", whole("Number of the first member of the group. Default 0.")),
        ("stride", whole(stride)),
        ("unverified", text("Fact about this group that is not verified.")),
        ("ask", list("Keys that the profile must set, because a wrong guess would move an axis.")),
    ];
    keys.extend(own.map(|(key, schema)| (key.to_owned(), schema)));
    named(what, &closed(&Value::Object(keys), &[]))
}

/// Returns the schema of a table that contains named tables with the schema `table`. `what` is its description.
fn named(what: &str, table: &Value) -> Value {
    json!({ "description": what, "type": "object", "additionalProperties": table })
}

fn closed(properties: &Value, required: &[&str]) -> Value {
    json!({ "type": "object", "properties": properties, "required": required, "additionalProperties": false })
}

fn text(what: &str) -> Value {
    json!({ "description": what, "type": "string" })
}

fn list(what: &str) -> Value {
    json!({ "description": what, "type": "array", "items": { "type": "string" } })
}
