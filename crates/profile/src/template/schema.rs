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
    let channels = groups(keys("Signal", &OF_SIGNAL), "A group of channels that are alike.");
    let targets = groups(keys("Output", &OF_OUTPUT), "What an output can write.");
    let mut checks = keys("Verify", &[]);
    checks.insert("of".to_owned(), text("The group of channels of which each that is used is checked."));
    let checks = groups(checks, "What is read before arming.");
    let device = keys("Device", &[]);
    let variant = closed(
        Map::from_iter([
            ("title".to_owned(), text("What the variant is.")),
            ("channel".to_owned(), channels.clone()),
            ("target".to_owned(), targets.clone()),
            ("check".to_owned(), checks.clone()),
        ]),
        &[],
    );
    let properties = Map::from_iter([
        ("title".to_owned(), text("Make and kind of the device.")),
        ("source".to_owned(), text("The manual or the public page that the registers are taken from.")),
        ("notes".to_owned(), list("What a person should know who uses it.")),
        ("unverified".to_owned(), list("What nobody has verified against the manual or on the device.")),
        (
            "movable".to_owned(),
            json!({ "description": "Its registers begin where `base` of the device says.", "type": "boolean" }),
        ),
        ("functions".to_owned(), device.get("functions").cloned().unwrap_or_default()),
        ("quirks".to_owned(), device.get("quirks").cloned().unwrap_or_default()),
        ("dbc".to_owned(), text("CAN: the DBC file that describes its frames, beside the template.")),
        ("node".to_owned(), node(&device)),
        ("channel".to_owned(), channels),
        ("target".to_owned(), targets),
        ("check".to_owned(), checks),
        ("set".to_owned(), json!({ "$ref": "#/$defs/Set", "description": "How its targets land together." })),
        ("heartbeat".to_owned(), text("The register of `[heartbeat]`.")),
        (
            "variant".to_owned(),
            json!({
                "description": "Kinds of the device between which the profile chooses.",
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
        table.insert("description".to_owned(), Value::from("What a CANopen node of this kind is given."));
    }
    table
}

/// Schema of groups by name. A group has the keys of its members, and those that describe their sequence.
fn groups(mut keys: Map<String, Value>, what: &str) -> Value {
    let whole =
        |what: &str| json!({ "description": what, "type": "integer", "minimum": 0, "maximum": 65535 });
    keys.insert(
        "name".to_owned(),
        text("The members' name; `{n}` is the number. Default: the group's name."),
    );
    keys.insert("count".to_owned(), whole("How many there are. Default 1."));
    keys.insert("from".to_owned(), whole("The number of the first. Default 0."));
    keys.insert(
        "stride".to_owned(),
        whole("Registers, bits of a frame or subindexes from one to the next. Default: as many as a value takes."),
    );
    keys.insert("unverified".to_owned(), text("What of this group nobody has verified."));
    keys.insert("ask".to_owned(), list("Keys that the profile must give: a wrong guess would move an axis."));
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
