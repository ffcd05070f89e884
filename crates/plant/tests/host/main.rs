//! Tests of the edge node with pysparkplug and sparkplug-payload, independent implementations of Sparkplug B. They read
//! the messages of the node, and the node evaluates their commands. Without them, the tests fail with a message;
//! `tests/run interop` installs them.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use isotherm_core::quantity::Moment;
use isotherm_plant::sparkplug::{Address, Sparkplug};
use isotherm_plant::store::Store;
use isotherm_plant::{
    Command as Asked, Importance, Message, Metric, Outcome, PlantEvent, Publisher, Snapshot, Subject, Value,
};
use serde_json::{Value as Json, json};

mod payload;

/// The process of another implementation, which answers each line with a line.
struct Host {
    name: &'static str,
    child: Child,
    says: ChildStdin,
    receives: BufReader<ChildStdout>,
}

impl Host {
    fn start() -> Host {
        let python = tools().join("venv/bin/python");
        let lacks = "pysparkplug is not installed: `tests/run interop` does it";
        assert!(python.exists(), "{}: {lacks}", python.display());
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/host.py");
        Host::of("pysparkplug", Command::new(python).arg("-u").arg(script))
    }

    fn of(name: &'static str, command: &mut Command) -> Host {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (says, receives) = (child.stdin.take().unwrap(), BufReader::new(child.stdout.take().unwrap()));
        Host { name, child, says, receives }
    }

    fn ask(&mut self, line: &Json) -> Json {
        writeln!(self.says, "{line}").unwrap();
        let mut answer = String::new();
        self.receives.read_line(&mut answer).unwrap();
        let name = self.name;
        assert!(!answer.is_empty(), "{name} refuses {line} (or is not installed: `tests/run interop`)");
        serde_json::from_str(&answer).unwrap()
    }

    fn reads(&mut self, message: &Message) -> Json {
        let hex = message.payload.iter().fold(String::new(), |mut hex, byte| {
            write!(hex, "{byte:02x}").unwrap();
            hex
        });
        self.ask(&json!({ "topic": message.topic, "payload": hex }))
    }

    fn read_all(&mut self, messages: &[Message]) -> Vec<Json> {
        messages.iter().map(|message| self.reads(message)).collect()
    }

    /// Topic and bytes of a command.
    fn asks(&mut self, command: &Json) -> (String, Vec<u8>) {
        let answer = self.ask(command);
        let hex = answer["payload"].as_str().unwrap();
        let byte = |at: usize| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
        (answer["topic"].as_str().unwrap().to_owned(), (0..hex.len()).step_by(2).map(byte).collect())
    }
}

/// Directory of the programs that `tests/run` installs.
fn tools() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap().join("tools")
}

impl Drop for Host {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

const BEGIN_MS: u64 = 1_800_000_000_000;

fn at(second: u64) -> Moment {
    Moment::from_nanos((BEGIN_MS + second * 1000) * 1_000_000)
}

fn ms(second: u64) -> u64 {
    BEGIN_MS + second * 1000
}

fn snapshot(second: u64, bed: Option<f64>) -> Snapshot {
    let metric = |subject, name, value, kind, unit| Metric {
        subject,
        name,
        value,
        kind,
        unit,
        resolution: 0.001,
        at: at(second),
    };
    let signal = Subject::Signal("bed".to_owned());
    let axis = || Subject::Axis("z".to_owned());
    let text = |text: &str| Value::Text(text.to_owned());
    Snapshot {
        metrics: vec![
            metric(signal, "value", bed.map(Value::Real), Value::Real(0.0), "°C"),
            metric(axis(), "state", Some(text("active")), text(""), ""),
            metric(axis(), "armed", Some(Value::Flag(true)), Value::Flag(false), ""),
            metric(Subject::Gateway, "events", Some(Value::Count(u64::MAX)), Value::Count(0), ""),
        ],
        ..Snapshot::default()
    }
}

fn node() -> Sparkplug {
    Sparkplug::new(Address::new("shop", "grinder-3").unwrap(), Some(254), true)
}

/// The only metric with this name.
fn find<'a>(message: &'a Json, name: &str) -> &'a Json {
    let metrics = message["metrics"].as_array().unwrap();
    let found: Vec<&Json> = metrics.iter().filter(|metric| metric["name"] == name).collect();
    assert_eq!(found.len(), 1, "{name} in {message}");
    found[0]
}

#[test]
fn another_implementation_reads_will_birth_data_and_death_as_they_are_meant() {
    let (mut host, mut node) = (Host::start(), node());
    let will = host.reads(&node.will());
    assert_eq!((&will["kind"], &find(&will, "bdSeq")["value"]), (&json!("NDEATH"), &json!(255)));
    assert_eq!(find(&will, "bdSeq")["type"], "INT64");

    let births = host.read_all(&node.connected(at(1), &snapshot(1, Some(21.5))));
    let [birth] = births.as_slice() else { panic!("{births:?}") };
    assert_eq!(
        (&birth["kind"], &birth["seq"], &birth["timestamp"]),
        (&json!("NBIRTH"), &json!(0), &json!(ms(1)))
    );
    let table = [
        ("bdSeq", "INT64", json!(255), json!({})),
        ("Node Control/Rebirth", "BOOLEAN", json!(false), json!({})),
        ("signal/bed/value", "DOUBLE", json!(21.5), json!({ "engUnit": [12, "°C"] })),
        ("axis/z/state", "STRING", json!("active"), json!({})),
        ("axis/z/armed", "BOOLEAN", json!(true), json!({})),
        ("gateway/events", "UINT64", json!(u64::MAX), json!({})),
        ("gateway/event", "STRING", Json::Null, json!({})),
        ("axis/z/measured_error_um", "DOUBLE", Json::Null, json!({})),
    ];
    for (name, kind, value, properties) in &table {
        let metric = find(birth, name);
        assert_eq!(metric["type"], *kind, "{name}");
        assert_eq!((&metric["value"], &metric["null"]), (value, &json!(value.is_null())), "{name}");
        assert_eq!((&metric["timestamp"], &metric["properties"]), (&json!(ms(1)), properties), "{name}");
    }
    assert_eq!(birth["metrics"].as_array().unwrap().len(), table.len());

    // Data contain aliases only; pysparkplug knows the names from the birth.
    let mut state = snapshot(2, None);
    state.events = vec![PlantEvent {
        at: at(2),
        kind: "signal-bad".to_owned(),
        importance: Importance::Error,
        text: "bed: no answer in time".to_owned(),
        data: String::new(),
    }];
    let told = host.read_all(&node.publish(at(2), &state));
    let [data] = told.as_slice() else { panic!("{told:?}") };
    assert_eq!((&data["kind"], &data["seq"]), (&json!("NDATA"), &json!(1)));
    let bed = find(data, "signal/bed/value");
    assert_eq!((&bed["null"], &bed["value"], &bed["type"]), (&json!(true), &Json::Null, &json!("DOUBLE")));
    assert_eq!(bed["properties"], json!({ "Quality": [3, 0] }));
    let event = find(data, "gateway/event");
    assert_eq!(event["value"], "bed: no answer in time");
    assert_eq!(event["properties"], json!({ "kind": [12, "signal-bad"], "importance": [12, "error"] }));
    assert_eq!(data["metrics"].as_array().unwrap().len(), 2);

    let told = host.read_all(&node.publish(at(3), &snapshot(3, Some(22.25))));
    let bed = find(&told[0], "signal/bed/value");
    assert_eq!((&bed["value"], &bed["properties"]), (&json!(22.25), &json!({ "Quality": [3, 192] })));
    assert_eq!((&told[0]["seq"], &bed["historical"]), (&json!(2), &json!(false)));

    let death = host.read_all(&node.farewell(at(4)));
    assert_eq!(death, [will]);
}

#[test]
fn another_implementation_sees_sequence_numbers_without_a_gap_over_256_and_a_rebirth() {
    let (mut host, mut node) = (Host::start(), node());
    node.will();
    host.read_all(&node.connected(at(0), &snapshot(0, Some(0.0))));
    let mut seqs = Vec::new();
    let mut tell = |host: &mut Host, node: &mut Sparkplug, second: u64| {
        let value = f64::from(u32::try_from(second).unwrap());
        let told = host.read_all(&node.publish(at(second), &snapshot(second, Some(value))));
        assert_eq!(find(&told[0], "signal/bed/value")["value"], json!(value));
        seqs.push(told[0]["seq"].as_u64().unwrap());
    };
    for second in 1..=300 {
        tell(&mut host, &mut node, second);
    }
    let command =
        json!({ "command": "Node Control/Rebirth", "value": true, "type": "BOOLEAN", "sent": ms(301) });
    let (topic, payload) = host.asks(&command);
    assert_eq!(topic, node.subscriptions()[0].filter);
    let reaction = node.received(at(301), &snapshot(301, Some(301.0)), &topic, &payload);
    assert_eq!(reaction.outcome, None);
    let birth = host.read_all(&reaction.messages);
    assert_eq!((&birth[0]["kind"], &birth[0]["seq"]), (&json!("NBIRTH"), &json!(0)));
    assert_eq!(find(&birth[0], "bdSeq")["value"], json!(255));
    assert_eq!(find(&birth[0], "signal/bed/value")["value"], json!(301.0));
    tell(&mut host, &mut node, 302);
    let expected: Vec<u64> = (1..=300).map(|seq| seq % 256).chain([1]).collect();
    assert_eq!(seqs, expected);
}

#[test]
fn another_implementation_reads_a_gap_from_the_disk_as_historical_after_the_next_birth() {
    let (mut host, mut node) = (Host::start(), node());
    let directory = tempfile::tempdir().unwrap();
    let mut store = Store::open(directory.path(), 1 << 20).unwrap();
    node.will();
    host.read_all(&node.connected(at(0), &snapshot(0, Some(0.0))));
    for record in node.disconnected(at(0)) {
        store.push(&record).unwrap();
    }
    for second in 1..=60 {
        let value = f64::from(u32::try_from(second).unwrap());
        for record in node.absent(at(second), &snapshot(second, Some(value))) {
            store.push(&record).unwrap();
        }
        if second == 30 {
            // The program is restarted, and has only the data on disk.
            node = Sparkplug::new(Address::new("shop", "grinder-3").unwrap(), Some(node.bd_seq()), true);
            store = Store::open(directory.path(), 1 << 20).unwrap();
        }
    }
    let will = host.reads(&node.will());
    assert_eq!(find(&will, "bdSeq")["value"], json!(0));
    host.read_all(&node.connected(at(61), &snapshot(61, Some(61.0))));
    let (mut told, mut seq) = (Vec::new(), 0);
    loop {
        let records = store.first(7).unwrap();
        if records.is_empty() {
            break;
        }
        for message in host.read_all(&node.forward(at(62), &records)) {
            seq += 1;
            assert_eq!(message["seq"], json!(seq));
            for metric in message["metrics"].as_array().unwrap() {
                assert_eq!(metric["historical"], json!(true));
                if metric["name"] == "signal/bed/value" {
                    told.push((metric["timestamp"].as_u64().unwrap(), metric["value"].as_f64().unwrap()));
                }
            }
        }
        store.drop_first(records.len()).unwrap();
    }
    // The birth of second 0 may be undelivered.
    let expected: Vec<(u64, f64)> = (0..=60u32).map(|second| (ms(second.into()), second.into())).collect();
    assert_eq!(told, expected);
    assert_eq!((store.len(), store.dropped()), (0, 0));
}

#[test]
fn what_another_implementation_asks_for_is_taken_or_refused() {
    let (mut host, mut node) = (Host::start(), node());
    node.will();
    let state = snapshot(0, Some(0.0));
    let birth = host.read_all(&node.connected(at(0), &state)).remove(0);
    let alias = |name: &str| find(&birth, name)["alias"].clone();
    let measured = |error_um: f64| {
        Some(Outcome::Asked(Asked::Measured { axis: "z".to_owned(), report: error_um.into() }))
    };
    let name = "axis/z/measured_error_um";
    let table = [
        (json!({ "command": name, "value": 3.5, "type": "DOUBLE", "sent": ms(1) }), measured(3.5)),
        (
            json!({ "command": name, "value": -0.5, "type": "FLOAT", "sent": ms(1), "typed": true }),
            measured(-0.5),
        ),
        (
            json!({ "command": "", "alias": alias(name), "value": 1.25, "type": "DOUBLE", "sent": ms(1) }),
            measured(1.25),
        ),
        (json!({ "command": name, "value": 3, "type": "INT32", "sent": ms(1), "typed": true }), None),
        (
            json!({ "command": "", "alias": alias("axis/z/armed"), "value": true, "type": "BOOLEAN", "sent": ms(1) }),
            None,
        ),
        (json!({ "command": "axis/z/armed", "value": false, "type": "BOOLEAN", "sent": ms(1) }), None),
    ];
    for (command, taken) in table {
        let (topic, payload) = host.asks(&command);
        let reaction = node.received(at(1), &state, &topic, &payload);
        assert!(reaction.messages.is_empty());
        match taken {
            Some(_) => assert_eq!(reaction.outcome, taken, "{command}"),
            None => assert!(matches!(reaction.outcome, Some(Outcome::Refused { .. })), "{command}"),
        }
    }
}
