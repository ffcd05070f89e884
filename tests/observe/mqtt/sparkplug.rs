//! Sparkplug B, held against a host that is not ours: births, sequence, rebirth, death, and a gap that arrives as
//! historical.

use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use serde_json::Value;

use super::away::away;
use super::broker::Broker;
use super::machine::{Machine, SIGNALS};
use super::process::{PATIENCE, Running, until};
use crate::support::starved::Starved;

fn mqtt(broker: &Broker) -> String {
    format!(
        "[mqtt]\nbroker = \"mqtt://127.0.0.1:{}\"\nformat = \"sparkplug-b\"\ngroup = \"plant-1\"\nevery = \"200ms\"\n\
         commands = [\"measured\"]\n",
        broker.port
    )
}

/// pysparkplug, as a host.
struct Host(Running);

impl Host {
    fn of(broker: &Broker) -> Host {
        let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
        let python = target.join("tools/venv/bin/python");
        assert!(python.exists(), "pysparkplug is not installed: `tests/run mqtt` does it");
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/interop/sparkplug_host.py");
        let mut command = Command::new(python);
        command.arg("-u").arg(script).args([&broker.port.to_string(), "plant-1", "press"]);
        let mut host = Host(Running::start(&mut command));
        host.0.receives("listens");
        host
    }

    fn asks(&mut self, what: &str) {
        writeln!(self.0.stdin(), "{what}").unwrap();
    }

    /// The next message of this kind.
    fn receives(&mut self, kind: &str) -> Value {
        let line = self.0.receives(&format!("{{\"kind\": \"{kind}\""));
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error}: {line}"))
    }

    /// Whether a message of this kind has come so far.
    fn has(&mut self, kind: &str) -> bool {
        self.0.so_far().iter().any(|line| line.starts_with(&format!("{{\"kind\": \"{kind}\"")))
    }

    /// Every rule was held so far.
    #[track_caller]
    fn finds_nothing_wrong(&mut self) {
        let wrong: Vec<&String> =
            self.0.so_far().iter().filter(|line| !line.starts_with(['{', 'l'])).collect();
        assert!(wrong.is_empty(), "{wrong:#?}");
    }
}

#[test]
fn a_host_that_is_not_ours_takes_births_sequence_rebirth_and_death() {
    let broker = Broker::open();
    let mut host = Host::of(&broker);
    let mut machine = Machine::with(&mqtt(&broker));
    let birth = host.receives("NBIRTH");
    let names = birth["metrics"].as_object().unwrap();
    for name in [
        "axis/z/verified_um",
        "axis/z/verified_age_s",
        "axis/z/cz_um",
        "axis/z/state",
        "axis/z/worse",
        "signal/bed99/value",
        "gateway/ready",
        "Node Control/Rebirth",
    ] {
        assert!(names.contains_key(name), "{name} is not in {names:?}");
    }
    assert!(names.len() > 3 * SIGNALS);
    machine.is_active();
    let mut numbers = 0;
    while numbers < 30 {
        numbers += u64::from(host.receives("NDATA")["historical"] == 0);
    }
    host.asks("rebirth");
    assert_eq!(host.receives("NBIRTH")["bd_seq"], birth["bd_seq"], "the same connection");
    host.asks("measured z 3.5");
    until("it is learned from", || {
        let last = machine.status()["axes"]["z"]["probe"]["last"].clone();
        if last["error_um"] == 3.5 { Ok(()) } else { Err(last.to_string()) }
    });
    host.asks("write axis/z/armed false");
    until("it is refused", || {
        let said = machine.verb("events", &["--json"]);
        if said.contains("\"command-refused\"") { Ok(()) } else { Err(said) }
    });
    assert_eq!(machine.status()["axes"]["z"]["armed"], true);
    machine.running.signal("TERM");
    assert_eq!(host.receives("NDEATH")["of_birth"], true);
    assert!(machine.running.ends_within(PATIENCE).success());
    host.finds_nothing_wrong();
}

#[test]
fn a_node_that_is_killed_is_dead_by_its_will_and_born_with_the_next_number() {
    let broker = Broker::open();
    let mut host = Host::of(&broker);
    let machine = Machine::with(&mqtt(&broker));
    let birth = host.receives("NBIRTH");
    let again = machine.dies_and_begins();
    let death = host.receives("NDEATH");
    assert_eq!((&death["bd_seq"], &death["of_birth"]), (&birth["bd_seq"], &Value::from(true)));
    let number = |message: &Value| message["bd_seq"].as_u64().unwrap();
    assert_eq!(number(&host.receives("NBIRTH")), (number(&birth) + 1) % 256);
    host.finds_nothing_wrong();
    drop(again);
}

/// Whether the gateway waits for its primary host.
fn waits(machine: &Machine) -> Result<(), String> {
    let mqtt = machine.status()["mqtt"].clone();
    if mqtt["connected"] == true && mqtt["primary_host"] != "online" { Ok(()) } else { Err(mqtt.to_string()) }
}

#[test]
fn a_node_with_a_primary_host_lives_while_the_host_is_online_and_the_machine_always() {
    let broker = Broker::open();
    let mut host = Host::of(&broker);
    let machine = Machine::with(&format!("{}primary_host = \"scada\"\n", mqtt(&broker)));
    // The machine is compensated, although no host is there.
    machine.is_active();
    until("it waits for the host", || waits(&machine));
    until("that is reported", || {
        let said = machine.verb("events", &["--json"]);
        if said.contains("\"host-offline\"") { Ok(()) } else { Err(said) }
    });
    assert!(!host.has("NBIRTH"), "{:?}", host.0.so_far());
    let shown = machine.verb("status", &[]);
    assert!(shown.contains("waits for the primary host (unknown)"), "{shown}");

    host.asks("state online");
    let first = host.receives("NBIRTH");
    until("what was stored arrives", || {
        let data = host.receives("NDATA");
        if data["historical"].as_u64() > Some(0) { Ok(()) } else { Err(data.to_string()) }
    });

    host.asks("state offline");
    assert_eq!(host.receives("NDEATH")["of_birth"], true);
    until("it waits for the host again", || waits(&machine));
    machine.is_active();
    // Each write moves the axis by 1 µm at most.
    let (polls, writes) = (machine.late(0.0).1, machine.writes());
    machine.follows(25);
    machine.follows(10);
    let written = machine.writes() - writes;
    assert!(written >= 30, "{written} writes while the host is offline");
    assert!(machine.late(0.0).1 > polls, "the devices are polled meanwhile");
    waits(&machine).unwrap();
    let waiting = machine.status()["mqtt"]["queued"].as_u64().unwrap();
    assert!(waiting > 4, "{waiting} records wait");
    host.finds_nothing_wrong();

    host.asks("state online");
    let second = host.receives("NBIRTH");
    assert!(second["bd_seq"].as_u64() > first["bd_seq"].as_u64(), "another connection");
    until("the gap arrives", || {
        let data = host.receives("NDATA");
        if data["historical"].as_u64() > Some(0) { Ok(()) } else { Err(data.to_string()) }
    });
    until("nothing waits any more", || {
        let queued = machine.status()["mqtt"]["queued"].as_u64().unwrap();
        if queued == 0 { Ok(()) } else { Err(queued.to_string()) }
    });
    assert_eq!(machine.status()["mqtt"]["dropped"], 0);
    assert_eq!(machine.status()["mqtt"]["primary_host"], "online");
    host.finds_nothing_wrong();
}

/// Anyone may publish the state of a host. Only the key of the profile makes it matter.
#[test]
fn without_a_primary_host_its_state_changes_nothing() {
    let broker = Broker::open();
    let mut host = Host::of(&broker);
    let machine = Machine::with(&mqtt(&broker));
    host.receives("NBIRTH");
    for _ in 0..5 {
        host.asks("state offline");
        host.receives("NDATA");
        host.asks("state online");
        host.receives("NDATA");
    }
    assert!(!host.has("NDEATH"));
    assert_eq!(machine.status()["mqtt"]["connections"], 1);
    host.finds_nothing_wrong();
}

#[test]
fn what_happened_while_the_broker_was_dead_arrives_as_historical() {
    let mut broker = Broker::open();
    let mut host = Host::of(&broker);
    let machine = Machine::with(&mqtt(&broker));
    let starved = Starved::of(machine.running.id());
    host.receives("NBIRTH");
    machine.is_active();
    let before = host.receives("NDATA");
    broker.dies();
    until("it is known to be away", || {
        let mqtt = machine.status()["mqtt"].clone();
        if mqtt["connected"] == false { Ok(()) } else { Err(mqtt.to_string()) }
    });
    std::thread::sleep(away());
    let waiting = machine.status()["mqtt"]["queued"].as_u64().unwrap();
    assert!(waiting > 4, "{waiting} records wait");
    // The host listens again before the node is born.
    machine.running.stands_still();
    broker.starts();
    host.0.receives("listens");
    machine.running.resumes();
    let birth = host.receives("NBIRTH");
    // A signal that changes with every look: no second of the gap is without it.
    let stamps = |message: &Value| -> Vec<u64> {
        let stamps = message["metrics"]["signal/bed7/value"].as_array();
        stamps.into_iter().flatten().filter_map(Value::as_u64).collect()
    };
    let reborn = stamps(&birth)[0];
    let mut last = stamps(&before).last().copied();
    let mut historical: Vec<u64> = Vec::new();
    while last.is_none_or(|last| last + 3000 < reborn) {
        let data = host.receives("NDATA");
        if data["historical"].as_u64().unwrap() > 0 {
            historical.extend(stamps(&data));
            last = historical.last().copied();
        }
    }
    let gaps = historical.windows(2).map(|pair| pair[1].saturating_sub(pair[0]));
    let longest = Duration::from_millis(gaps.max().unwrap());
    println!("{} values of the gap arrive, the longest pause between them is {longest:?}", historical.len());
    // A gateway that is kept from the processor looks at nothing meanwhile.
    let waited = starved.longest();
    assert!(longest < Duration::from_secs(3) + 2 * waited, "{longest:?} of the gap are missing");
    let expected = away().saturating_sub(2 * waited).as_secs();
    assert!(u64::try_from(historical.len()).unwrap() > expected, "{}", historical.len());
    until("nothing waits any more", || {
        let queued = machine.status()["mqtt"]["queued"].as_u64().unwrap();
        if queued == 0 { Ok(()) } else { Err(queued.to_string()) }
    });
    assert_eq!(machine.status()["mqtt"]["dropped"], 0);
    host.finds_nothing_wrong();
}
