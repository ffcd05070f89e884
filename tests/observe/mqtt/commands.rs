//! Received messages: the gateway accepts measured errors if the profile allows it, and nothing else.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use super::broker::Broker;
use super::machine::Machine;
use super::process::until;

fn events(machine: &Machine) -> String {
    machine.verb("events", &["--json"])
}

#[test]
fn a_measured_error_is_learned_from_and_nothing_arms_disarms_or_moves() {
    let broker = Broker::open();
    broker.tells("isotherm/press/command/measured", r#"{"axis":"z","error_um":9}"#, &["-r"]);
    let mqtt = format!("[mqtt]\nbroker = \"mqtt://127.0.0.1:{}\"\ncommands = [\"measured\"]\n", broker.port);
    let mut state = broker.reads("isotherm/press/state", &[]);
    let machine = Machine::with(&mqtt);
    state.receives("online");
    machine.is_active();
    until("what the broker has kept is refused", || {
        let said = events(&machine);
        if said.contains("the message is retained") { Ok(()) } else { Err(said) }
    });
    assert!(machine.status()["axes"]["z"]["probe"]["last"].is_null());
    broker.tells("isotherm/press/command/measured", r#"{"axis":"z","error_um":3.5}"#, &[]);
    until("it is learned from", || {
        let last = machine.status()["axes"]["z"]["probe"]["last"].clone();
        if last["error_um"] == 3.5 { Ok(()) } else { Err(last.to_string()) }
    });
    let said = events(&machine);
    assert!(said.contains("over the broker mqtt://127.0.0.1"), "{said}");
    for _ in 0..20 {
        for command in ["disarm", "arm", "zero", "measured"] {
            broker.tells(&format!("isotherm/press/command/{command}"), "{\"axis\":\"z\"}", &[]);
        }
    }
    let armed = &machine.status()["axes"]["z"];
    assert_eq!((&armed["armed"], &armed["state"]), (&true.into(), &"active".into()));
    let refused = events(&machine).matches("\"command-refused\"").count();
    assert!(refused <= 2, "{refused} refusals are reported");
}

/// Publishes a message twice, like a sender that has lost the answer: the second packet is marked as a repetition.
fn publishes_twice(broker: &Broker, topic: &str, payload: &str) {
    let text = |text: &str| [&u16::try_from(text.len()).unwrap().to_be_bytes(), text.as_bytes()].concat();
    let packet = |kind: u8, body: &[u8]| {
        let length = u8::try_from(body.len()).unwrap();
        assert!(length < 128, "its length is one byte");
        [&[kind, length], body].concat()
    };
    let connect = [&text("MQTT"), &[4_u8, 2, 0, 60][..], &text("probe")].concat();
    let publish = [&text(topic), &1_u16.to_be_bytes()[..], payload.as_bytes()].concat();
    let mut stream = TcpStream::connect(("127.0.0.1", broker.port)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    stream.write_all(&packet(0x10, &connect)).unwrap();
    stream.read_exact(&mut [0; 4]).unwrap();
    for kind in [0x32, 0x3a] {
        stream.write_all(&packet(kind, &publish)).unwrap();
        stream.read_exact(&mut [0; 4]).unwrap();
        // The gateway accepts one each second, on a busy computer after some seconds.
        std::thread::sleep(Duration::from_secs(4));
    }
}

#[test]
fn a_measured_error_that_the_broker_delivers_twice_counts_once_after_a_kill_too() {
    let broker = Broker::open();
    let mut arrived = broker.reads("isotherm/press/command/measured", &[]);
    let mut events = broker.reads("isotherm/press/event", &[]);
    let mqtt = format!("[mqtt]\nbroker = \"mqtt://127.0.0.1:{}\"\ncommands = [\"measured\"]\n", broker.port);
    let mut machine = Machine::with(&mqtt);
    machine.is_active();
    let probe = |machine: &Machine| machine.status()["axes"]["z"]["probe"].clone();
    until("the offset has arrived", || match machine.status()["axes"]["z"]["verified_um"].as_f64() {
        Some(um) if (um - 10.0).abs() < 0.01 => Ok(()),
        um => Err(format!("{um:?}")),
    });
    let learned = probe(&machine)["correction_um"].clone();
    // The error is so large that a second measurement must confirm it.
    for (payload, why) in [
        (r#"{"axis":"z","error_um":-25}"#, "this report is ignored; send a `time` or an `id`"),
        (r#"{"axis":"z","error_um":-24,"id":"part-17/2"}"#, "the id part-17/2 was accepted before"),
    ] {
        let before = probe(&machine);
        publishes_twice(&broker, "isotherm/press/command/measured", payload);
        for _ in 0..2 {
            arrived.receives(payload);
        }
        let refused = events.receives("command-refused");
        assert!(refused.contains(why) && refused.contains("over the broker"), "{refused}");
        let after = probe(&machine);
        assert_eq!(after["last"]["error_um"], if before["last"].is_null() { -25.0 } else { -24.0 });
    }
    // The two measurements agree, and each has counted once.
    let once = probe(&machine);
    assert!(
        once["history"].as_array().is_some_and(|history| history.len() == 1),
        "{once}\n{}",
        self::events(&machine)
    );
    assert_ne!(once["correction_um"], learned);
    // The gateway saves the learned correction, together with its measurements, at once.
    std::thread::sleep(Duration::from_secs(10));
    machine = machine.dies_and_begins();
    machine.is_active();
    let count =
        |machine: &Machine| self::events(machine).matches("the id part-17/2 was accepted before").count();
    let refused = count(&machine);
    until("it is refused after the kill", || {
        broker.tells(
            "isotherm/press/command/measured",
            r#"{"axis":"z","error_um":-24,"id":"part-17/2"}"#,
            &[],
        );
        if count(&machine) > refused { Ok(()) } else { Err(self::events(&machine)) }
    });
    let (after, residual) = (probe(&machine), "/history/0/1");
    assert_eq!(after["history"].as_array().map(Vec::len), Some(1), "{after}");
    assert_eq!(after.pointer(residual), once.pointer(residual), "{after}");
}

#[test]
fn where_no_command_is_taken_nothing_is_even_asked_for() {
    let broker = Broker::open();
    let mut state = broker.reads("isotherm/press/state", &[]);
    let machine = Machine::with(&format!("[mqtt]\nbroker = \"mqtt://127.0.0.1:{}\"\n", broker.port));
    state.receives("online");
    machine.is_active();
    broker.tells("isotherm/press/command/measured", r#"{"axis":"z","error_um":3.5}"#, &[]);
    let said = broker.so_far();
    assert!(said.contains("Received SUBSCRIBE from reader"), "{said}");
    assert!(!said.contains("SUBSCRIBE from isotherm-press"), "{said}");
}

#[test]
fn a_long_message_that_the_broker_keeps_is_refused_and_one_beyond_measure_is_named_as_what_is_wrong() {
    for (length, words) in [(300 << 10, "connected"), (2 << 20, "a message of more than 1 MB")] {
        let broker = Broker::open();
        let payload = broker.home().join("payload");
        std::fs::write(&payload, vec![b'x'; length]).unwrap();
        broker.publishes("isotherm/press/command/measured", &["-r", "-f", payload.to_str().unwrap()]);
        let mqtt =
            format!("[mqtt]\nbroker = \"mqtt://127.0.0.1:{}\"\ncommands = [\"measured\"]\n", broker.port);
        let machine = Machine::with(&mqtt);
        machine.is_active();
        until(words, || {
            let shown = machine.verb("status", &[]);
            if shown.contains(words) { Ok(()) } else { Err(shown) }
        });
    }
}
