//! Brokers that refuse: the gateway, a subscription, or messages to a topic. Each refusal is named, and costs nothing
//! else.

use std::time::Duration;

use isotherm_plant::sparkplug::{Payload, Raw};

use super::machine::Machine;
use super::process::{PATIENCE, free_port, isotherm, until};
use super::scripted::{Packet, Script, Scripted};

const COMMAND: &str = "isotherm/press/command/+";

fn json(port: u16) -> String {
    format!("[mqtt]\nbroker = \"mqtt://127.0.0.1:{port}\"\nevery = \"200ms\"\ncommands = [\"measured\"]\n")
}

fn sparkplug(port: u16) -> String {
    format!(
        "[mqtt]\nbroker = \"mqtt://127.0.0.1:{port}\"\nformat = \"sparkplug-b\"\ngroup = \"plant-1\"\nevery = \"200ms\"\n"
    )
}

/// Result of `isotherm check --online` with this `[mqtt]`.
fn check(mqtt: &str) -> (bool, String) {
    let (profile, home, _device) = Machine::prepared(mqtt, |_| ());
    let done = isotherm(home.path()).arg("check").arg(&profile).arg("--online").output().unwrap();
    let said = [done.stdout, done.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    (done.status.success(), said)
}

#[track_caller]
fn reports(machine: &Machine, kind: &str) {
    until(kind, || {
        let said = machine.verb("events", &["--json"]);
        if said.contains(&format!("\"{kind}\"")) { Ok(()) } else { Err(said) }
    });
}

fn alarms(machine: &Machine) -> String {
    machine.status()["alarms"].to_string()
}

#[test]
fn a_refused_subscription_is_an_event_an_alarm_and_a_line_of_the_check() {
    let refusing = Script { refuses: vec![COMMAND.to_owned()], ..Script::default() };
    let broker = Scripted::at(0, refusing);
    let (fits, said) = check(&json(broker.port));
    assert!(
        !fits && said.contains(&format!("refuses the subscription to {COMMAND}; allow the user")),
        "{said}"
    );
    assert!(
        !broker.wire().iter().any(|packet| matches!(packet, Packet::Publish(_))),
        "nothing was published"
    );

    let machine = Machine::with(&json(broker.port));
    reports(&machine, "broker-subscription-refused");
    assert!(alarms(&machine).contains(COMMAND), "{}", alarms(&machine));
    until("it publishes all the same", || match broker.published("isotherm/press/axis/z") {
        0 => Err(String::new()),
        _ => Ok(()),
    });
    let status = machine.status();
    assert_eq!(
        (&status["mqtt"]["connected"], &status["mqtt"]["refused"][0]),
        (&true.into(), &COMMAND.into())
    );
    let shown = machine.verb("status", &[]);
    assert!(shown.contains(&format!("refuses {COMMAND}")), "{shown}");

    broker.now(Script::default());
    broker.breaks();
    reports(&machine, "broker-subscribed");
    until("the alarm ends", || {
        let alarms = alarms(&machine);
        if alarms.contains(COMMAND) { Err(alarms) } else { Ok(()) }
    });
    let said = machine.verb("events", &["--json"]);
    assert_eq!(said.matches("\"broker-subscription-refused\"").count(), 1, "{said}");
    assert!(check(&json(broker.port)).0);
}

#[test]
fn a_broker_that_closes_on_a_denied_message_loses_this_topic_only() {
    let event = "isotherm/press/event";
    let broker = Scripted::at(0, Script { closes_on: vec![event.to_owned()], ..Script::default() });
    let machine = Machine::with(&json(broker.port));
    machine.is_active();
    reports(&machine, "broker-publish-denied");
    assert!(alarms(&machine).contains(event), "{}", alarms(&machine));
    until("it is connected again", || {
        // The last message to the topic closed a connection: the next one begins after it.
        let wire = broker.wire();
        let last = |is: &dyn Fn(&Packet) -> bool| wire.iter().rposition(is);
        let denied = last(&|packet: &Packet| *packet == Packet::Publish(event.to_owned()));
        let begun = last(&|packet: &Packet| matches!(packet, Packet::Connect(_)));
        let mqtt = machine.status_if_it_runs()?["mqtt"].clone();
        if begun > denied && mqtt["connected"] == true { Ok(()) } else { Err(mqtt.to_string()) }
    });
    let (connects, tried) = (broker.connects().len(), broker.published(event));
    let states = broker.published("isotherm/press/signal/bed7");
    // Further events happen, and are not published.
    machine.answers(false);
    reports(&machine, "signal-bad");
    machine.answers(true);
    reports(&machine, "signal-good");
    std::thread::sleep(Duration::from_secs(3));
    until("the other topics are published", || match broker.published("isotherm/press/signal/bed7") {
        more if more > states => Ok(()),
        same => Err(same.to_string()),
    });
    assert_eq!((broker.connects().len(), broker.published(event)), (connects, tried), "it stays connected");
    assert!(connects <= 6, "{connects} connections");
    assert_eq!(machine.status()["mqtt"]["refused"][0], event);
    machine.is_active();
}

#[test]
fn a_broker_of_mqtt_5_is_known_as_that() {
    let broker = Scripted::at(0, Script { connack: 0x84, ..Script::default() });
    let (fits, said) = check(&json(broker.port));
    assert!(!fits && said.contains("speaks MQTT 5 only"), "{said}");
    let machine = Machine::with(&json(broker.port));
    until("the status names it", || {
        let fault = machine.status_if_it_runs()?["mqtt"]["fault"].to_string();
        if fault.contains("speaks MQTT 5 only") { Ok(()) } else { Err(fault) }
    });
    reports(&machine, "broker-down");
}

#[test]
fn the_subscription_comes_before_the_birth_on_each_connection() {
    let broker = Scripted::at(0, Script::default());
    let machine = Machine::with(&sparkplug(broker.port));
    let birth = "spBv1.0/plant-1/NBIRTH/press";
    for round in 1..=3 {
        until("it is born", || match broker.published(birth) {
            births if births >= round => Ok(()),
            births => Err(births.to_string()),
        });
        if round < 3 {
            broker.breaks();
        }
    }
    let wire = broker.wire();
    let mut rounds = wire.split(|packet| matches!(packet, Packet::Connect(_))).skip(1);
    let is_in_order = rounds.all(|packets| {
        let mut first = packets.iter().take(2);
        let subscribed = Packet::Subscribe("spBv1.0/plant-1/NCMD/press".to_owned(), 1);
        packets.len() < 2
            || (first.next() == Some(&subscribed) && first.next() == Some(&Packet::Publish(birth.to_owned())))
    });
    assert!(is_in_order, "{wire:#?}");
    for connect in broker.connects() {
        assert_eq!(connect.topic, "spBv1.0/plant-1/NDEATH/press");
        assert_eq!(connect.flags, 2 + 4 + 8, "a clean session, and a will of QoS 1 that is not retained");
    }
    drop(machine);
}

/// Death number in a will.
fn death_number(will: &[u8]) -> u64 {
    let payload = Payload::arrived(will).unwrap();
    let [metric] = payload.metrics.as_slice() else { panic!("{payload:?}") };
    let Some(Raw::Long(number)) = metric.value else { panic!("{metric:?}") };
    number
}

#[test]
fn each_connect_packet_has_the_next_number_from_0_on() {
    let port = free_port();
    let mut machine = Machine::with(&sparkplug(port));
    // No CONNECT packet is sent while nothing listens.
    until("it has failed to connect", || {
        let mqtt = machine.status_if_it_runs()?["mqtt"].clone();
        if mqtt["fault"] == "no program listens at this port" { Ok(()) } else { Err(mqtt.to_string()) }
    });
    std::thread::sleep(Duration::from_secs(2));
    // The first ones are refused, and use their numbers up.
    let broker = Scripted::at(port, Script { connack: 3, ..Script::default() });
    let sent = |count: usize| {
        until("it connects", || match broker.connects().len() {
            sent if sent >= count => Ok(()),
            sent => Err(sent.to_string()),
        });
    };
    sent(2);
    broker.now(Script::default());
    until("it is connected", || {
        let mqtt = machine.status_if_it_runs()?["mqtt"].clone();
        if mqtt["connected"] == true { Ok(()) } else { Err(mqtt.to_string()) }
    });
    let before = broker.connects().len();
    broker.breaks();
    sent(before + 1);
    let before = broker.connects().len();
    machine = machine.dies_and_begins();
    sent(before + 1);
    machine.running.signal("TERM");
    assert!(machine.running.ends_within(PATIENCE).success());
    let numbers: Vec<u64> = broker.connects().iter().map(|connect| death_number(&connect.will)).collect();
    let expected: Vec<u64> = (0..u64::try_from(numbers.len()).unwrap()).collect();
    assert_eq!(numbers, expected);
}
