//! What arrives: a measured error where the profile takes some, nothing else, and nothing at all where it takes none.

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
    state.hears("online");
    machine.is_active();
    until("what the broker has kept is refused", || {
        let said = events(&machine);
        if said.contains("the broker has kept it from before") { Ok(()) } else { Err(said) }
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

#[test]
fn where_no_command_is_taken_nothing_is_even_asked_for() {
    let broker = Broker::open();
    let mut state = broker.reads("isotherm/press/state", &[]);
    let machine = Machine::with(&format!("[mqtt]\nbroker = \"mqtt://127.0.0.1:{}\"\n", broker.port));
    state.hears("online");
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
