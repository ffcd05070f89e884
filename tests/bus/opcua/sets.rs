//! Tests of sets: K0, tanβ and P0 of an axis in three nodes, written by one call or not at all.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::gateway::{beside, events, reported, wait_until};
use super::rig::{Server, machine};
use isotherm::gateway::Options;
use isotherm::observe::status::GatewayApi;

/// Returns a machine whose line is written to three nodes as one set. `keys` are further keys of the set.
fn in_a_set(port: u16, keys: &str) -> String {
    let text = machine(port, "");
    let (rest, _) = text.split_once("[output.offset]").unwrap();
    let kind = "terms = [ { signal = \"bed\", gain = 1.0, reference = 20.0 } ]\n";
    assert!(rest.contains(kind));
    let slope = "slope = { position = \"scale\", reference = 50.0, travel = [0.0, 300.0], terms = [ { signal = \"bed\", gain \
                 = 0.01, reference = 20.0 } ] }\n";
    let rest = rest.replace(kind, &format!("{kind}{slope}"));
    let output = |(name, writes, scale): (&str, &str, f64)| {
        format!(
            "[output.{name}]\naxis = \"z\"\ndevice = \"cnc\"\nset = \"line\"\nwrites = \"{writes}\"\nnode = \"ns=2;s={name}\"\n\
             type = \"f64\"\nscale = {scale:?}\n"
        )
    };
    let outputs =
        [("k0", "intercept", 1000.0), ("tan", "slope", 1000.0), ("p0", "reference", 1.0)].map(output);
    format!("{rest}[set.line]\n{keys}\n{}", outputs.concat())
}

/// Returns the value of a node.
fn holds(server: &Mutex<Server>, name: &str) -> f64 {
    server.lock().unwrap().does(&format!("read {name}")).parse().unwrap()
}

/// Waits until K0, tanβ and P0 have the values for this temperature of the bed.
#[track_caller]
fn arrives(source: &dyn GatewayApi, server: &Mutex<Server>, bed: f64) {
    let (k0, tan) = ((bed - 20.0) / 1000.0, 0.01 * (bed - 20.0) / 1000.0);
    let near = |name: &str, value: f64, by: f64| (holds(server, name) - value).abs() < by;
    wait_until(source, "the line stands there", |_| {
        near("k0", k0, 1e-6) && near("tan", tan, 1e-8) && near("p0", 50.0, 1e-9)
    });
}

fn start(arguments: &[&str], bed: &str) -> Arc<Mutex<Server>> {
    let mut server = Server::start(arguments);
    server.does(&format!("value bed {bed}"));
    Arc::new(Mutex::new(server))
}

fn port(server: &Mutex<Server>) -> u16 {
    server.lock().unwrap().port
}

/// Checks that two consecutive values in the list never differ by more than `most`.
#[track_caller]
fn steps(written: &str, most: f64) {
    let values: Vec<f64> = written.split(' ').map(|value| value.parse().unwrap()).collect();
    for pair in values.windows(2) {
        assert!((pair[1] - pair[0]).abs() <= most * 1.000_001, "{pair:?} of {written}");
    }
}

#[test]
fn all_of_a_set_is_written_by_one_call_and_read_back_by_one() {
    let server = start(&[], "23");
    let text = in_a_set(port(&server), "");
    let control = server.clone();
    beside(&text, Options::default(), move |source| arrives(source, &control, 23.0));
    let mut server = server.lock().unwrap();
    let log = server.does("log");
    let calls: Vec<&str> = log.split(';').collect();
    assert!(calls.iter().all(|call| matches!(*call, "read k0 tan p0" | "write k0 tan p0")), "{log}");
    for pair in calls.windows(2).filter(|pair| pair[0].starts_with("write")) {
        assert_eq!(pair[1], "read k0 tan p0", "each write is read back: {log}");
    }
    steps(&server.does("values k0"), 0.001);
    steps(&server.does("values tan"), 0.001 / 250.0);
}

#[test]
fn a_member_that_keeps_its_old_value_though_the_server_answers_good_is_caught_and_the_others_wait_for_it() {
    let server = start(&[], "23");
    server.lock().unwrap().does("keep tan");
    let text = in_a_set(port(&server), "");
    let control = server.clone();
    beside(&text, Options::default(), move |source| {
        wait_until(source, "it is reported", |status| {
            events(status).iter().any(|text| {
                let said = "read back 0.0000 µm/mm; the server answered Good, but kept the old value";
                text.starts_with("output tan: wrote ") && text.contains(said)
            })
        });
        std::thread::sleep(Duration::from_secs(2));
        assert!(holds(&control, "k0") < 0.001 + 1e-9, "K0 goes no further than the step that was sent");
        control.lock().unwrap().does("allow tan");
        arrives(source, &control, 23.0);
    });
    steps(&server.lock().unwrap().does("values k0"), 0.001);
}

#[test]
fn a_set_of_which_one_node_is_denied_is_neither_done_nor_not_done_and_goes_no_further() {
    let server = start(&[], "23");
    server.lock().unwrap().does("refuse tan BadUserAccessDenied");
    let text = in_a_set(port(&server), "").replace("timeout = \"1s\"", "timeout = \"1s\"\nlate = \"3s\"");
    let control = server.clone();
    beside(&text, Options::default(), move |source| {
        let said = "the server has written only some values of set line: it answers \
                    BadUserAccessDenied to output tan (node ns=2;s=tan)";
        wait_until(source, "it is reported", |status| events(status).iter().any(|text| text.contains(said)));
        std::thread::sleep(Duration::from_secs(5));
        assert!(holds(&control, "k0") < 0.001 + 1e-9, "{}", holds(&control, "k0"));
        assert!(holds(&control, "tan").abs() < 1e-12);
        control.lock().unwrap().does("allow tan");
        arrives(source, &control, 23.0);
    });
    steps(&server.lock().unwrap().does("values k0"), 0.001);
}

#[test]
fn a_set_of_which_every_node_is_refused_is_not_done_and_nothing_is_waited_for() {
    let server = start(&[], "23");
    for name in ["k0", "tan", "p0"] {
        server.lock().unwrap().does(&format!("refuse {name} BadNotWritable"));
    }
    let text = in_a_set(port(&server), "");
    let control = server.clone();
    let status = beside(&text, Options::default(), move |source| {
        wait_until(source, "it is reported", |status| {
            events(status)
                .iter()
                .any(|text| text.contains("output k0") && text.contains("the server answers BadNotWritable"))
        });
        for name in ["k0", "tan", "p0"] {
            control.lock().unwrap().does(&format!("allow {name}"));
        }
        arrives(source, &control, 23.0);
    });
    assert_eq!(reported(&status, "waits-for-late-write"), 0);
}

#[test]
fn a_server_that_takes_fewer_nodes_in_a_call_than_a_set_has_is_written_nothing_at_all() {
    let server = start(&["--most-written", "2"], "23");
    let text = in_a_set(port(&server), "");
    let control = server.clone();
    beside(&text, Options::default(), move |source| {
        let said = "the server accepts 2 nodes in one call (MaxNodesPerWrite), and an output set must be \
                    written in one call";
        wait_until(source, "it is reported", |status| events(status).iter().any(|text| text.contains(said)));
        assert!(!control.lock().unwrap().does("log").contains("write"));
    });
}

#[test]
fn a_server_that_dies_between_the_write_and_the_read_back_is_walked_on_from_what_it_holds_then() {
    let server = start(&[], "23");
    let text = in_a_set(port(&server), "").replace("timeout = \"1s\"", "timeout = \"1s\"\nlate = \"3s\"");
    let control = server.clone();
    beside(&text, Options::default(), move |source| {
        arrives(source, &control, 23.0);
        let mut dead = control.lock().unwrap();
        dead.does("die k0");
        dead.does("value bed 25");
        dead.ends();
        // The new server has kept one half of the set.
        *dead = Server::start(&[
            "--port",
            &dead.port.to_string(),
            "--holds",
            "k0=0.004",
            "--holds",
            "tan=3e-5",
            "--holds",
            "p0=50",
        ]);
        dead.does("value bed 25");
        drop(dead);
        arrives(source, &control, 25.0);
    });
    let mut server = server.lock().unwrap();
    steps(&format!("0.004 {}", server.does("values k0")), 0.001);
    steps(&format!("3e-5 {}", server.does("values tan")), 0.001 / 250.0);
}

#[test]
fn a_server_that_keeps_fewer_digits_than_it_is_sent_has_taken_the_set_all_the_same() {
    let server = start(&[], "23");
    server.lock().unwrap().does("round tan 9");
    let text = in_a_set(port(&server), "");
    let control = server.clone();
    beside(&text, Options::default(), move |source| arrives(source, &control, 23.0));
}

#[test]
fn heartbeat_control_word_and_version_of_a_set_stand_in_nodes_of_their_own_types() {
    let server = start(&[], "23");
    let keys = "heartbeat = { node = \"ns=2;s=beat\", type = \"i16\" }\ncontrol = { node = \"ns=2;s=control\", type = \"u16\" }\n\
                version = { node = \"ns=2;s=version\", type = \"u8\", value = 17 }";
    let text = in_a_set(port(&server), keys)
        .replace("writes = \"intercept\"", "writes = \"intercept\"\nrefresh = \"500ms\"");
    let control = server.clone();
    beside(&text, Options::default(), move |source| {
        arrives(source, &control, 23.0);
        wait_until(source, "it goes on", |_| holds(&control, "beat") >= 12.0);
        assert_eq!((holds(&control, "control"), holds(&control, "version")), (1.0, 17.0));
    });
    let mut server = server.lock().unwrap();
    assert!(server.does("log").contains("write k0 tan p0 beat control version"));
    let beats = server.does("values beat");
    let beats: Vec<u16> = beats.split(' ').map(|beat| beat.parse().unwrap()).collect();
    assert!(beats.iter().zip(1..).all(|(beat, place)| *beat == place), "{beats:?}");
}

#[test]
fn a_word_of_a_set_whose_node_is_not_there_is_told_by_its_name_and_not_as_a_fault_of_an_output_s_node() {
    let server = start(&[], "23");
    let keys = "control = { node = \"ns=2;s=gone\", type = \"u16\" }";
    let text = in_a_set(port(&server), keys);
    let control = server.clone();
    beside(&text, Options::default(), move |source| {
        let said =
            "control of set line (node ns=2;s=gone) cannot be read: the server answers BadNodeIdUnknown";
        wait_until(source, "it is reported", |status| events(status).iter().any(|text| text.contains(said)));
        wait_until(source, "the axis says so", |status| {
            let why = status.axes[0].why.to_string();
            why.contains(said) && why.contains("there is no such node")
        });
        assert!(!control.lock().unwrap().does("log").contains("write"));
    });
}

#[test]
fn a_heartbeat_whose_node_is_not_there_is_told_and_its_end_as_well() {
    let server = start(&[], "23");
    let heartbeat = |node: &str| {
        format!(
            "[heartbeat]\ndevice = \"cnc\"\nnode = \"ns=2;s={node}\"\ntype = \"i16\"\nevery = \"100ms\"\n"
        )
    };
    let gone = format!("{}{}", in_a_set(port(&server), ""), heartbeat("gone"));
    let status = beside(&gone, Options::default(), move |source| {
        // asyncua answers BadUserAccessDenied for a missing node; other servers answer BadNodeIdUnknown.
        let said = "heartbeat (node ns=2;s=gone of cnc): not written: the server answers Bad";
        wait_until(source, "it is reported", |status| events(status).iter().any(|text| text.contains(said)));
        wait_until(source, "it stands", |status| status.alarms.iter().any(|alarm| alarm.text.contains(said)));
        std::thread::sleep(Duration::from_secs(1));
    });
    assert_eq!(reported(&status, "heartbeat-failed"), 1, "once");
    server.lock().unwrap().does("refuse life BadNotWritable");
    let there = format!("{}{}", in_a_set(port(&server), ""), heartbeat("life"));
    let control = server.clone();
    let status = beside(&there, Options::default(), move |source| {
        wait_until(source, "it is reported", |status| reported(status, "heartbeat-failed") == 1);
        control.lock().unwrap().does("allow life");
        wait_until(source, "it is over", |status| reported(status, "heartbeat-written") == 1);
    });
    assert!(status.alarms.iter().all(|alarm| !alarm.id.contains("heartbeat")), "{:?}", status.alarms);
}

#[test]
fn a_strobe_rises_after_the_set_was_read_back_and_drops_when_it_is_acknowledged() {
    let server = start(&[], "21");
    server.lock().unwrap().does("acknowledge 0.05");
    let text = with_a_strobe(port(&server));
    let control = server.clone();
    beside(&text, Options::default(), move |source| {
        arrives(source, &control, 21.0);
        wait_until(source, "its last strobe is down", |_| {
            control.lock().unwrap().does("read strobe") == "False"
        });
    });
    let mut server = server.lock().unwrap();
    let log = server.does("log");
    let calls: Vec<&str> = log.split(';').collect();
    let strobes: Vec<usize> = (0..calls.len()).filter(|place| calls[*place] == "write strobe").collect();
    // The first write resets a strobe that may be left from before.
    for up in strobes[1..].iter().step_by(2) {
        assert_eq!(calls[up - 2..*up], ["write k0 tan p0", "read k0 tan p0"], "{log}");
    }
    let written = server.does("values strobe");
    let strobes: Vec<&str> = written.split(' ').collect();
    assert!(strobes.len() > 4 && strobes.len() % 2 == 1, "{strobes:?}");
    assert!(strobes.chunks(2).all(|pair| pair == ["False", "True"] || pair == ["False"]), "{strobes:?}");
}

#[test]
fn a_set_that_is_never_acknowledged_is_told_with_its_node_and_goes_no_further() {
    let server = start(&[], "21");
    let text = with_a_strobe(port(&server));
    let control = server.clone();
    beside(&text, Options::default(), move |source| {
        wait_until(source, "it is reported", |status| {
            events(status).iter().any(|text| text.contains("set line") && text.contains("node ns=2;s=taken"))
        });
        std::thread::sleep(Duration::from_secs(3));
        assert!(holds(&control, "tan") < 0.001 / 250.0 + 1e-10, "{}", holds(&control, "tan"));
        control.lock().unwrap().does("acknowledge 0.05");
        arrives(source, &control, 21.0);
    });
}

/// Returns a machine with a handshake. Two acknowledge timeouts are shorter than the period of the axis.
fn with_a_strobe(port: u16) -> String {
    let strobe = "handshake = { strobe = { node = \"ns=2;s=strobe\", type = \"bool\" }, acknowledge = { node = \
                  \"ns=2;s=taken\" }, timeout = \"600ms\" }";
    let text = in_a_set(port, strobe).replace("timeout = \"1s\"", "timeout = \"500ms\"");
    text.replace("every = \"200ms\"", "every = \"1500ms\"")
}
