//! Published messages, retained messages, and the messages after a gateway has died.

use std::time::Duration;

use serde_json::Value;

use super::broker::Broker;
use super::machine::{Machine, SIGNALS};
use super::process::{PATIENCE, Running, isotherm, until};

fn mqtt(broker: &Broker) -> String {
    format!(
        "[mqtt]\nbroker = \"mqtt://127.0.0.1:{}\"\nevery = \"200ms\"\nhome_assistant = true\n",
        broker.port
    )
}

/// Returns the document of the next message to this topic.
fn document(reader: &mut Running, topic: &str) -> Value {
    let line = reader.receives(&format!(" {topic} "));
    let payload = line.split_once(&format!(" {topic} ")).unwrap().1;
    serde_json::from_str(payload).unwrap_or_else(|error| panic!("{error}: {line}"))
}

#[test]
fn state_is_kept_for_whoever_comes_later_and_events_are_told_once() {
    let broker = Broker::open();
    let mut early = broker.reads("isotherm/press/event", &[]);
    let mut machine = Machine::with(&mqtt(&broker));
    early.receives("\"kind\":\"started\"");
    machine.is_active();
    let mut late = broker.reads("#", &[]);
    late.receives("1 isotherm/press/state online");
    // The retained message is the last published one. It is a moment behind the gateway's own status.
    until("an axis that is kept as active", || {
        let axis = broker.reads("isotherm/press/axis/z", &[]).receives("1 isotherm/press/axis/z ");
        let parts = ["\"state\":\"active\"", "\"verified_um\":", "\"verified_age_s\":", "\"worse\":false"];
        if parts.iter().all(|part| axis.contains(part)) { Ok(()) } else { Err(axis) }
    });
    let mut bed = broker.reads("isotherm/press/signal/bed7", &[]);
    let first = document(&mut bed, "isotherm/press/signal/bed7");
    assert_eq!((&first["unit"], &first["quality"]), (&Value::from("degC"), &Value::from("good")));
    assert_ne!(first["value"], document(&mut bed, "isotherm/press/signal/bed7")["value"], "it changes");
    for topic in ["gateway", "output/cnc_z", "device/cnc", "bus/cell"] {
        broker.reads(&format!("isotherm/press/{topic}"), &[]).receives("1 isotherm/press/");
    }
    let mut home_assistant = broker.reads("homeassistant/#", &[]);
    home_assistant.receives("1 homeassistant/sensor/isotherm-press/signal_bed7_value/config ");
    assert!(!late.so_far().iter().any(|line| line.starts_with("1 isotherm/press/event")), "no event is kept");

    machine.answers(false);
    let bad = early.receives("\"kind\":\"signal-bad\"");
    for part in ["\"level\":\"warning\"", "\"cause\":\"", "\"hint\":\""] {
        assert!(bad.contains(part), "{part} in {bad}");
    }
    let shown = machine.verb("status", &[]);
    let connected = format!("broker mqtt://127.0.0.1:{}: connected", broker.port);
    assert!(shown.contains(&connected), "{shown}");
    assert!(machine.status()["mqtt"]["published"].as_u64().unwrap() > 100);

    machine.running.signal("TERM");
    let mut state = broker.reads("isotherm/press/state", &[]);
    state.receives("isotherm/press/state offline");
    assert!(machine.running.ends_within(PATIENCE).success(), "{:?}", machine.running.said);
    early.receives("\"kind\":\"stopped\"");
}

#[test]
fn a_gateway_that_is_killed_is_offline_by_its_will() {
    let broker = Broker::open();
    let mut state = broker.reads("isotherm/press/state", &[]);
    let machine = Machine::with(&mqtt(&broker));
    state.receives("isotherm/press/state online");
    machine.running.killed();
    state.receives("isotherm/press/state offline");
}

#[test]
fn what_another_profile_has_no_more_the_broker_forgets() {
    let broker = Broker::open();
    let mut state = broker.reads("isotherm/press/state", &[]);
    let machine = Machine::with(&mqtt(&broker));
    state.receives("isotherm/press/state online");
    for topic in
        ["isotherm/press/signal/bed99", "homeassistant/sensor/isotherm-press/signal_bed99_value/config"]
    {
        broker.reads(topic, &[]).receives(&format!("1 {topic} {{"));
    }
    let mut gone = ["isotherm/press/signal/bed99", "homeassistant/#"].map(|topic| broker.reads(topic, &[]));
    let profile = std::fs::read_to_string(&machine.profile).unwrap();
    let profile = profile.replace("bed99 =", "table =").replace("home_assistant = true\n", "");
    std::fs::write(&machine.profile, profile).unwrap();
    let again = machine.dies_and_begins();
    let is_cleared = |line: &String| line.trim_end().ends_with("isotherm/press/signal/bed99");
    until("the signal is cleared", || {
        if gone[0].so_far().iter().any(is_cleared) { Ok(()) } else { Err(String::new()) }
    });
    until("Home Assistant's topics are cleared", || {
        let cleared = gone[1].so_far().iter().filter(|line| line.trim_end().ends_with("/config")).count();
        // One topic for each signal, five for the axis, one for the gateway.
        if cleared == SIGNALS + 6 { Ok(()) } else { Err(cleared.to_string()) }
    });
    broker.reads("isotherm/press/signal/table", &[]).receives("1 isotherm/press/signal/table {");
    drop(again);
}

#[test]
fn check_says_what_is_published_and_online_whether_the_broker_is_there() {
    let mut broker = Broker::open();
    let (profile, home, _device) = Machine::prepared(&mqtt(&broker), |_| ());
    let check = |more: &[&str]| {
        let done = isotherm(home.path()).arg("check").arg(&profile).args(more).output().unwrap();
        let said = [done.stdout, done.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
        (done.status.success(), said)
    };
    let (fits, said) = check(&[]);
    assert!(fits && said.contains("publishes"), "{said}");
    for line in [
        "  changed values at most every 200ms, all values at least every 1m; each event once",
        "    isotherm/press/signal/bed0 … isotherm/press/signal/bed99 (100)",
        "    isotherm/press/event (not retained by the broker; all other topics are retained)",
        "  accepts no commands: the gateway subscribes to no topic",
    ] {
        assert!(said.contains(line), "{line}\n{said}");
    }
    let mut heard = broker.reads("isotherm/#", &[]);
    let (fits, said) = check(&["--online"]);
    assert!(
        fits && said.contains("accepts the gateway and its subscriptions; nothing was published"),
        "{said}"
    );
    broker.tells("isotherm/after", "it", &[]);
    heard.receives("isotherm/after");
    let published = heard.so_far().iter().filter(|line| line.starts_with("0 isotherm/press"));
    assert_eq!(published.count(), 0, "nothing was published");
    broker.dies();
    let (fits, said) = check(&["--online"]);
    assert!(!fits && said.contains("no program listens at this port"), "{said}");
    // Starts a listener that speaks another protocol.
    let other = std::net::TcpListener::bind(("127.0.0.1", broker.port)).unwrap();
    std::thread::spawn(move || {
        for mut stream in other.incoming().flatten() {
            let _ = std::io::Write::write_all(&mut stream, b"HTTP/1.1 400 Bad Request\r\n\r\n");
            std::thread::sleep(Duration::from_millis(200));
        }
    });
    until("it is known for what it is", || {
        let (fits, said) = check(&["--online"]);
        if !fits && said.contains("does not speak MQTT") { Ok(()) } else { Err(said) }
    });
}
