//! Keys that change what arrives at the machine. Only the profile sets them, or names them in `allow_override`.

use isotherm_core::quantity::Micron;
use isotherm_profile::{Output, Profile};
use proptest::prelude::*;
use proptest::sample::select;
use serde_json::Value;

use super::*;

/// Value of the correct type for each key that no layer may set.
const VALUES: [(&str, &str); 49] = [
    ("acknowledge", "\"coil:3\""),
    ("axis", "\"y\""),
    ("bad", "[7]"),
    ("base", "10"),
    ("beside", "[{ register = \"holding:12\", value = 1 }]"),
    ("bias", "32768"),
    ("bus", "\"other\""),
    ("byte_swap", "true"),
    ("channel", "\"offset\""),
    ("complement", "\"holding:120\""),
    ("control", "\"holding:121\""),
    ("counter", "{ max_speed = 1.0, capture = { register = \"holding:132\" } }"),
    ("dbc", "\"other.dbc\""),
    ("decimals_from", "\"holding:12\""),
    ("device", "\"readout\""),
    ("diameter", "true"),
    ("element", "1"),
    ("expect", "{ format = \"unchecked\" }"),
    ("frame", "{ id = 0x300, start = 0, length = 32 }"),
    ("functions", "[\"write-multiple\"]"),
    ("handshake", "{ strobe = \"coil:20\", acknowledge = \"coil:21\", timeout = \"1s\" }"),
    ("heartbeat", "\"holding:122\""),
    ("largest_step", "100.0"),
    ("node", "\"ns=2;s=Offset\""),
    ("offset", "1.0"),
    ("pdo", "{ cob_id = 0x20C, start = 0, length = 32 }"),
    ("position", "\"bed\""),
    ("read_back", "{ register = \"input:12\" }"),
    ("register", "\"holding:204\""),
    ("request", "\"R\""),
    ("restart", "{ boot_counter = \"input:3\" }"),
    ("scale", "0.001"),
    ("scale_from", "\"holding:12\""),
    ("sdo", "\"2000:01\""),
    ("sensor", "\"hwmon:chip/temp1\""),
    ("sequence", "\"holding:123\""),
    ("set", "\"block\""),
    ("setup", "[{ sdo = \"1017:00\", type = \"u16\", value = 500 }]"),
    ("sha256", "\"00\""),
    ("share", "\"ledger\""),
    ("shortest_every", "\"1ms\""),
    ("source_address", "3"),
    ("stale", "{ register = \"holding:14\", text = \"----\" }"),
    ("start", "false"),
    ("sync", "{ every = \"1s\" }"),
    ("template", "\"linuxcnc-eoffset\""),
    ("text", "\"mm {number}\""),
    ("variant", "\"T\""),
    ("zeros", "true"),
];

/// Values for keys whose name has another meaning in another table.
const OTHERS: [(&str, &str); 10] = [
    ("bus.cell.sync", "{ every = \"1s\" }"),
    ("device.cnc.node", "9"),
    ("device.cnc.unit", "9"),
    ("device.cnc.verify", "[{ register = \"holding:1\", equals = 1 }]"),
    ("output.cnc_z.type", "\"i16\""),
    ("output.cnc_z.verify", "\"echo\""),
    ("output.cnc_z.when", "\"cnc_on == 0\""),
    ("output.cnc_z.word_order", "\"lsw-first\""),
    ("output.cnc_z.writes", "\"intercept\""),
    ("set.block.version", "{ register = \"holding:124\", value = 1 }"),
];

/// One table of each kind that is written, or whose reading is forwarded.
const TABLES: [(&str, &str); 7] = [
    ("Output", "output.cnc_z"),
    ("Set", "set.block"),
    ("Heartbeat", "heartbeat"),
    ("Device", "device.cnc"),
    ("Signal", "signal.scale_z"),
    ("Axis", "axis.z"),
    ("Bus", "bus.cell"),
];

/// Returns the profile of the grinder with a set.
fn machine() -> String {
    format!("{GRINDER}\n[set.block]\n")
}

fn value(path: &str) -> &'static str {
    let key = path.rsplit('.').next().unwrap();
    let other = OTHERS.iter().find(|(known, _)| *known == path);
    let signal = [("signal.scale_z.type", "\"i16\""), ("signal.scale_z.word_order", "\"msw-first\"")];
    let more = [("signal.scale_z.unit", "\"um\""), ("heartbeat.type", "\"u16\"")];
    let known = other.or(signal.iter().find(|(known, _)| *known == path));
    let known = known.or(more.iter().find(|(known, _)| *known == path));
    let known = known.or(VALUES.iter().find(|(known, _)| *known == key));
    known.unwrap_or_else(|| panic!("{path} needs a value in this test")).1
}

/// Returns every key of these tables, and whether its rule in the schema is "arrives".
fn keys() -> Vec<(String, bool)> {
    let schema = isotherm_profile::schema();
    let keys = TABLES.iter().flat_map(|(name, table)| {
        let definition = &schema["$defs"][name];
        let whole = definition["x-layers"].clone();
        definition["properties"].as_object().unwrap().iter().map(move |(key, property)| {
            let own = property.get("x-layers").unwrap_or(&whole);
            (format!("{table}.{key}"), own == "arrives")
        })
    });
    keys.collect()
}

/// Loads a profile with a layer that sets this key. Returns the layer's name in errors, and the errors.
fn layered(way: &str, text: &str, path: &str, value: &str) -> (String, Vec<ProfileError>) {
    let pair = |name: String, value: &str| vec![(name, value.to_owned())];
    let plain = value.strip_prefix('"').and_then(|value| value.strip_suffix('"')).unwrap_or(value);
    let (file, loaded) = match way {
        "environment" => {
            let name = format!("ISOTHERM__{}", path.to_uppercase().replace('.', "__"));
            let loaded = isotherm_profile::parse(Path::new("m.toml"), text, &[], &pair(name.clone(), plain));
            (format!("environment {name}"), loaded)
        }
        "flag" => {
            let loaded =
                isotherm_profile::parse(Path::new("m.toml"), text, &pair(path.to_owned(), plain), &[]);
            (format!("--set {path}"), loaded)
        }
        _ => {
            let folder = tempfile::tempdir().unwrap();
            let (main, local) = (folder.path().join("m.toml"), folder.path().join("m.local.toml"));
            std::fs::write(&main, text).unwrap();
            let (table, key) = path.rsplit_once('.').unwrap();
            std::fs::write(&local, format!("[{table}]\n{key} = {value}\n")).unwrap();
            (local.display().to_string(), isotherm_profile::load(&main, &[], &[]))
        }
    };
    (file, loaded.map_or_else(|Errors(errors)| errors, |_| Vec::new()))
}

fn of_layers(errors: &[ProfileError]) -> Vec<&ProfileError> {
    errors.iter().filter(|error| error.allow_override.is_some()).collect()
}

#[test]
fn no_layer_sets_a_key_that_changes_what_arrives_at_the_machine() {
    let text = machine();
    let mut count = 0;
    for (path, _) in keys().into_iter().filter(|(_, arrives)| *arrives) {
        let value = value(&path);
        for way in ["environment", "file", "flag"] {
            let (file, errors) = layered(way, &text, &path, value);
            let refused = of_layers(&errors);
            assert!(!refused.is_empty(), "{way}: {path} = {value} is taken: {}", Errors(errors));
            for error in refused {
                assert!(error.file == file && error.key.starts_with(&path), "{error}");
                assert!(error.message.contains("data that the machine receives"), "{error}");
                let line = format!("[machine] allow_override = [\"{path}\"]");
                assert!(error.help.as_ref().unwrap().ends_with(&line), "{error}");
                assert_eq!(error.line.is_some(), way == "file", "{error}");
            }
            let allow = format!("[machine]\nallow_override = [\"{path}\"]\n");
            let (_, errors) = layered(way, &text.replacen("[machine]\n", &allow, 1), &path, value);
            assert!(of_layers(&errors).is_empty(), "{way}: {}", Errors(errors));
        }
        count += 1;
    }
    assert!(count > 60, "{count}");
}

#[test]
fn every_key_that_does_not_arrive_at_the_machine_stays_free() {
    for (path, value) in [
        ("bus.cell.address", "\"10.0.0.7:502\""),
        ("bus.cell.timeout", "\"200ms\""),
        ("device.cnc.every", "\"2s\""),
        ("device.cnc.quirks", "{ max_gap = 3 }"),
        // Nothing is written to these devices, and no position is read from them.
        ("device.module.unit", "9"),
        ("signal.bed.scale", "0.01"),
        ("signal.bed.register", "\"input:9\""),
        ("signal.scale_z.max_age", "\"9s\""),
        ("output.cnc_z.refresh", "\"3s\""),
        ("heartbeat.every", "\"2s\""),
        ("axis.z.limit", "39.0"),
        // These values equal those of the profile.
        ("output.cnc_z.scale", "0.10"),
        ("output.cnc_z.type", "\"i32\""),
    ] {
        for way in ["environment", "file", "flag"] {
            let (_, errors) = layered(way, GRINDER, path, value);
            assert!(errors.is_empty(), "{way}: {path} = {value}: {}", Errors(errors));
        }
    }
    // The device of a forwarded position counts as one that is written to.
    let (_, errors) = layered("environment", GRINDER, "device.counter.unit", "9");
    assert_eq!(of_layers(&errors).len(), 1, "{}", Errors(errors));
}

#[test]
fn the_models_of_an_axis_keep_the_travel_that_bounds_a_slope() {
    let text = include_str!("../gateway/faults/line.toml");
    let models = |travel: &str, gain: &str| {
        format!(
            "[{{ name = \"line\", kind = \"linear\", offset = 4.0, \
             terms = [{{ signal = \"bed\", gain = {gain}, reference = 21.0 }}], \
             slope = {{ position = \"scale_z\", reference = -50.0, travel = {travel}, \
             terms = [{{ signal = \"bed\", gain = 0.02, reference = 20.0 }}] }} }}]"
        )
    };
    for way in ["environment", "file", "flag"] {
        let (_, errors) = layered(way, text, "axis.y.model", &models("[-350.0, 0.0]", "2.0"));
        assert!(errors.is_empty(), "{}", Errors(errors));
        let (_, errors) = layered(way, text, "axis.y.model", &models("[-51.0, -49.0]", "1.0"));
        let [error] = of_layers(&errors)[..] else { panic!("{}", Errors(errors)) };
        assert!(error.message.contains("-51.0") && error.message.contains("-350.0"), "{error}");
        assert!(error.help.as_ref().unwrap().ends_with("allow_override = [\"axis.y.model\"]"), "{error}");
    }
}

#[test]
fn the_errors_name_such_keys_first_and_give_the_line_that_allows_all_of_them() {
    let text = GRINDER.replacen("[machine]\n", "[machine]\nallow_override = [\"machine.arm\"]\n", 1);
    let text = text.replace("max_rate = 2.0", "max_rat = 2.0");
    let environment = [
        ("ISOTHERM__AXIS__Z__DIAMETER".to_owned(), "true".to_owned()),
        ("ISOTHERM__OUTPUT__CNC_Z__SCALE".to_owned(), "0.001".to_owned()),
    ];
    let found = errors(isotherm_profile::parse(Path::new("machine.toml"), &text, &[], &environment));
    let keys: Vec<&str> = found.iter().map(|error| error.key.as_str()).collect();
    assert_eq!(keys, ["axis.z.diameter", "output.cnc_z.scale", "signal.wheelhead.max_rat"]);
    let shown = Errors(found.clone()).to_string();
    let line = "  allow_override = [\"machine.arm\", \"axis.z.diameter\", \"output.cnc_z.scale\"]\n";
    let (first, last) = (shown.find(line).unwrap(), shown.find("max_rat`").unwrap());
    assert!(
        shown.starts_with("environment ISOTHERM__AXIS__Z__DIAMETER: axis.z.diameter: ") && first < last,
        "{shown}"
    );
    let document = serde_json::to_value(Errors(found)).unwrap();
    assert_eq!(document[1]["allow_override"], serde_json::json!(["machine.arm", "output.cnc_z.scale"]));
    assert_eq!(document[2].get("allow_override"), None::<&Value>);
}

#[test]
fn what_the_profile_allows_is_listed_first_and_says_so() {
    let allow = "[machine]\nallow_override = [\"output.cnc_z.bias\", \"output.cnc_z.read_back\"]\n";
    let text = GRINDER.replacen("[machine]\n", allow, 1);
    let set = |key: &str, value: &str| (key.to_owned(), value.to_owned());
    let settings = [
        set("axis.z.limit", "30"),
        set("output.cnc_z.bias", "5"),
        set("output.cnc_z.read_back", "{ register = \"input:12\" }"),
    ];
    let loaded = isotherm_profile::parse(Path::new("machine.toml"), &text, &settings, &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let reported: Vec<String> = profile.overridden.iter().map(ToString::to_string).collect();
    assert_eq!(
        reported,
        [
            "output.cnc_z.bias = 5, from --set output.cnc_z.bias (not in the profile), as `allow_override` allows",
            "output.cnc_z.read_back.register = \"input:12\", from --set output.cnc_z.read_back (not in the profile), \
             as `allow_override` allows",
            "axis.z.limit = 30 instead of the profile's 40.0, from --set axis.z.limit",
        ]
    );
    let document = serde_json::to_value(isotherm_profile::preview::Preview::of(&profile)).unwrap();
    assert_eq!(
        (&document["overridden"][0]["allowed"], document["overridden"][2].get("allowed")),
        (&true.into(), None)
    );
}

/// Returns the correction in µm that the control reads, by the profile without layers.
fn at_control(alone: &Profile, merged: &Profile, place: usize, share: f64) -> f64 {
    let (written, read): (&Output, &Output) = (&merged.outputs[place], &alone.outputs[place]);
    let axis = merged.axis(written.axis);
    let radii = |profile: &Profile| if profile.axis(written.axis).diameter { 2.0 } else { 1.0 };
    let micron = axis.settings.guard.limit.get() * share * radii(merged);
    let is_position = written.writes.position().is_some();
    let (position, per) = if is_position { (123.4567, 1000.0) } else { (0.0, 1.0) };
    let sent = written.encoding.encode(position + micron / per);
    (read.encoding.decode(sent.registers()).unwrap() - position) * per / radii(alone)
}

proptest! {
    #[test]
    fn no_layers_make_a_control_apply_more_than_the_limit(
        keys in proptest::collection::vec(
            (select(vec![
                ("output.cnc_z.scale", vec!["0.1", "0.001", "-0.1", "0.2"]),
                ("output.cnc_z.bias", vec!["32768", "-7", "0"]),
                ("output.cnc_z.type", vec!["i32", "i16", "f32", "u32"]),
                ("output.cnc_z.word_order", vec!["msw-first", "lsw-first"]),
                ("output.cnc_z.byte_swap", vec!["true", "false"]),
                ("output.cnc_z.writes", vec!["offset", "intercept"]),
                ("output.cnc_z.axis", vec!["z"]),
                ("output.readout_z.scale", vec!["0.0001", "0.001", "-0.0001"]),
                ("output.readout_z.bias", vec!["100"]),
                ("axis.z.diameter", vec!["true", "false"]),
                ("axis.z.limit", vec!["40", "10", "400"]),
                ("axis.z.step", vec!["1", "0.5", "30"]),
                ("axis.z.deadband", vec!["0.2"]),
                ("device.cnc.every", vec!["2s"]),
            ]), any::<proptest::sample::Index>(), any::<bool>()),
            0..5,
        ),
        share in -1.0..=1.0f64,
    ) {
        let (mut settings, mut environment) = (Vec::new(), Vec::new());
        for ((path, values), index, by_flag) in &keys {
            let value = (*index.get(values)).to_owned();
            match by_flag {
                true => settings.push(((*path).to_owned(), value)),
                false => environment.push((format!("ISOTHERM__{}", path.to_uppercase().replace('.', "__")), value)),
            }
        }
        let alone = parse(GRINDER).unwrap().profile;
        let loaded = isotherm_profile::parse(Path::new("machine.toml"), GRINDER, &settings, &environment);
        let Ok(loaded) = loaded else { return Ok(()) };
        for place in 0..2 {
            for share in [share, 1.0, -1.0] {
                let limit = alone.axes[0].settings.guard.limit.get();
                let slack = 0.0501;
                let read = at_control(&alone, &loaded.profile, place, share);
                prop_assert!(read.abs() <= limit + slack, "{read} µm, by {settings:?} {environment:?}");
                // The sign is also that of the profile.
                let meant = loaded.profile.axes[0].settings.guard.limit.get() * share;
                prop_assert!((read - meant).abs() <= slack, "{read} for {meant}");
            }
            // The last check, which uses the profile without layers, admits the written values.
            let output = &loaded.profile.outputs[place];
            let view = loaded.profile.control_view(output).unwrap();
            prop_assert_eq!(view.encoding.scale, alone.outputs[place].encoding.scale);
            prop_assert!(view.limit <= Micron::new(40.0).unwrap());
        }
    }
}
