//! Many clients, clients that stop reading, and what is no OPC UA. None of them delays a poll.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use serde_json::Value;

use super::node;
use super::rig::{Machine, SIGNALS, node_opcua};
use super::secured::with;
use crate::support::starved::Starved;
use crate::support::tell;

/// Lateness in milliseconds that counts as late, as in the tests of attacks.
const LATE_MS: f64 = 50.0;
/// Wait of a thread of the gateway for a processor after which late polls show nothing.
const STARVED: Duration = Duration::from_millis(25);

/// Memory of the gateway in MB.
fn memory(machine: &Machine) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{}/status", machine.running.id())).unwrap();
    let line = text.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
}

/// Checks that at most 2 % of the polls since `before` were late, or that the computer was too busy for them.
#[track_caller]
fn polls_are_punctual(machine: &Machine, before: (u64, u64), starved: &Starved) {
    let (late, all) = machine.late(LATE_MS);
    let (late, polls, waited) = (late - before.0, all - before.1, starved.longest());
    assert!(polls > 100, "{polls} polls");
    if late > polls / 50 && waited >= STARVED {
        return tell(&format!("OPC UA server: void, the computer was too busy: a thread waited {waited:?}"));
    }
    assert!(late <= polls / 50, "{late} of {polls} polls were late, a thread waited {waited:?}");
}

#[test]
fn ten_clients_are_served_alike() {
    let machine = Machine::open();
    let before = memory(&machine);
    let mut clients = machine.watched_by(&["many", "10", "8", "signal.bed7.value"]);
    let while_served = memory(&machine);
    let said = clients.receives("[");
    let counts: Vec<u64> = serde_json::from_str(&said).unwrap();
    assert_eq!(counts.len(), 10);
    assert!(counts.iter().all(|count| *count >= 20), "{said}");
    tell(&format!("OPC UA server: {:.1} MB more with ten clients", while_served - before));
    assert!(while_served < before + 50.0, "{before} MB, then {while_served} MB");
}

#[test]
fn a_client_that_reads_nothing_any_more_costs_no_memory_and_delays_no_other_and_no_poll() {
    let machine = Machine::open();
    let mut deaf = machine.watched_by(&["deaf", "30"]);
    let (late, starved) = (machine.late(LATE_MS), Starved::of(machine.running.id()));
    let before = memory(&machine);
    let mut watcher = machine.watched_by(&["watch", "8", "signal.bed7.value"]);
    let counts: Value = serde_json::from_str(&watcher.receives("signal.bed7")).unwrap();
    assert!(counts["signal.bed7.value"].as_u64().is_some_and(|count| count >= 20), "{counts}");
    deaf.receives("deaf");
    let after = memory(&machine);
    assert!(after < before + 20.0, "{before} MB, then {after} MB");
    polls_are_punctual(&machine, late, &starved);
}

#[test]
fn ten_clients_of_node_opcua_are_served_alike_while_another_reads_nothing_any_more() {
    let machine = node::machine();
    let before = memory(&machine);
    let signals: Vec<String> = (0..SIGNALS).map(|place| format!("signal.bed{place}.value")).collect();
    let mut does = vec!["watch", "600"];
    does.extend(signals.iter().map(String::as_str));
    let deaf = machine.watched_by_client(node_opcua(), &with(&node::USER, &does));
    deaf.stands_still();
    let ten = with(&node::USER, &["many", "10", "8", "signal.bed7.value"]);
    let said = machine.watched_by_client(node_opcua(), &ten).receives("\"counts\"");
    let counts: Value = serde_json::from_str(&said).unwrap();
    let counts = counts["counts"].as_array().unwrap();
    assert_eq!(counts.len(), 10, "{said}");
    assert!(counts.iter().all(|count| count.as_u64().is_some_and(|count| count >= 20)), "{said}");
    let after = memory(&machine);
    assert!(after < before + 50.0, "{before} MB, then {after} MB");
}

#[test]
fn what_is_no_opc_ua_and_who_says_nothing_is_disconnected_and_harms_nobody() {
    let machine = Machine::open();
    let starved = Starved::of(machine.running.id());
    let address = machine.asks(&["endpoints"])[0][2].as_str().unwrap().to_owned();
    let address = address.trim_start_matches("opc.tcp://").trim_end_matches('/').to_owned();
    let connect = || {
        let stream = TcpStream::connect(&address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    };
    for bytes in [&b"GET / HTTP/1.1\r\n\r\n"[..], &[0xff; 4096], b"HELF\xff\xff\xff\xff", b"OPNF\x20\0\0\0"] {
        let mut stream = connect();
        let _ = stream.write_all(bytes);
        let mut answer = Vec::new();
        // It answers with an error, or closes the connection.
        let _ = stream.read_to_end(&mut answer);
        assert!(answer.len() < 1000, "{answer:?}");
    }
    // More silent connections than one address may have.
    let silent: Vec<TcpStream> = (0..60).map(|_| connect()).collect();
    for mut stream in silent {
        let mut answer = Vec::new();
        // It is closed at once, or after the time in which a client must begin.
        let _ = stream.read_to_end(&mut answer);
        assert!(answer.len() < 1000, "{answer:?}");
    }
    let read = machine.asks(&["read", "axis.z.state"]);
    assert_eq!(read["axis.z.state"]["value"], "active", "{read}");
    polls_are_punctual(&machine, (0, 0), &starved);
}
