//! Values of a DBC file against cantools.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use isotherm_core::codec::Address;
use isotherm_profile::{Signal, parse_with};
use serde_json::Value;

const DBC: &str = include_str!("field.dbc");
const FRAMES: usize = 200;
const ENGINE: &str = "Temperatures_of_the_engine_and_its_coolant";

/// Signal of the file, keys of the profile, and the conversion from the value of cantools.
type Case = (&'static str, &'static str, &'static str, fn(f64) -> f64);

const SIGNALS: [Case; 13] = [
    ("Motor", "Winding", "", |value| value),
    ("Motor", "Case", "", |value| (value - 32.0) / 1.8),
    ("Motor", "Pressure", "unit = \"bar\"", |value| value / 100.0),
    ("Motor", "Flag", "", |value| value),
    ("Motor", "Torque", "unit = \"Nm\"", |value| value),
    ("Pages", "Page", "", |value| value),
    ("Pages", "Front", "", |value| value),
    ("Pages", "Rear", "", |value| value),
    ("Pages", "Sum", "", |value| value),
    ("Real", "Level", "", |value| value),
    ("Real", "Rest", "", |value| value),
    (ENGINE, "Temperature_of_the_coolant_at_the_outlet", "", |value| value),
    (ENGINE, "Oil", "", |value| value),
];

/// Decodes frames with cantools.
fn by_cantools(frames: &[(&str, Vec<u8>)]) -> Vec<Value> {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let python = target.join("tools/venv/bin/python");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/dbc.py");
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/profile/field.dbc");
    let begun =
        Command::new(&python).args([script, file]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let mut begun =
        begun.unwrap_or_else(|error| panic!("{}: {error}: `tests/run tools` makes it", python.display()));
    let hex = |data: &[u8]| data.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    let asked: Vec<(&str, String)> = frames.iter().map(|(name, data)| (*name, hex(data))).collect();
    begun.stdin.take().unwrap().write_all(serde_json::to_string(&asked).unwrap().as_bytes()).unwrap();
    let ended = begun.wait_with_output().unwrap();
    assert!(ended.status.success(), "without cantools: `tests/run tools`");
    serde_json::from_slice(&ended.stdout).unwrap()
}

/// Value of the signal in a frame. `None` if the frame does not contain it, or if it is no finite number.
fn value(signal: &Signal, data: &[u8]) -> Option<f64> {
    let Address::Frame(field) = &signal.address else { panic!("{} is in no frame", signal.name) };
    signal.encoding.decode(field.read(data)?.unwrap().registers()).ok()
}

#[test]
fn each_signal_has_the_value_that_cantools_decodes() {
    let mut text = "[machine]\nname = \"m\"\n[bus.field]\ntype = \"can\"\ninterface = \"can0\"\n[device.d]\n\
                    bus = \"field\"\ndbc = \"field.dbc\"\n"
        .to_owned();
    for (place, (message, signal, keys, _)) in SIGNALS.iter().enumerate() {
        text += &format!("[signal.s{place}]\ndevice = \"d\"\ndbc = \"{message}.{signal}\"\n{keys}\n");
    }
    let loaded = parse_with(Path::new("m.toml"), &text, &[("field.dbc", DBC.as_bytes())], &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let mut state = 1u64;
    let mut byte = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state.to_be_bytes()[0]
    };
    let mut frames = Vec::new();
    for message in ["Motor", "Pages", "Real", ENGINE] {
        for _ in 0..FRAMES {
            let mut data: Vec<u8> = (0..8).map(|_| byte()).collect();
            // Half of the pages exist.
            data[0] &= if message == "Pages" { 0xf3 } else { 0xff };
            frames.push((message, data));
        }
    }
    let theirs = by_cantools(&frames);
    assert_eq!(theirs.len(), frames.len());
    let mut compared = [0; SIGNALS.len()];
    for ((message, data), theirs) in frames.iter().zip(&theirs) {
        for (place, (owner, name, _, converted)) in SIGNALS.iter().enumerate() {
            // Of a page without signals, cantools decodes nothing, not even the page.
            if owner != message || theirs.is_null() {
                continue;
            }
            let own = value(&profile.signals[place], data);
            let expected = theirs.get(name).and_then(Value::as_f64).map(converted);
            match (own, expected) {
                (Some(own), Some(expected)) => {
                    let allowed = 1e-9 * expected.abs().max(1.0);
                    assert!(
                        (own - expected).abs() <= allowed,
                        "{owner}.{name} of {data:02x?}: {own}, {expected}"
                    );
                    compared[place] += 1;
                }
                (own, expected) => assert_eq!(own, expected, "{owner}.{name} of {data:02x?}"),
            }
        }
    }
    assert!(compared.iter().all(|count| *count > FRAMES / 10), "{compared:?}");
}
