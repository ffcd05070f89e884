//! Tests of a node that an operator writes, too, of the heartbeat, and of a control that was restarted.

use std::sync::{Arc, Mutex};

use super::gateway::{beside, events, wait_until};
use super::rig::{Server, machine};
use isotherm::gateway::Options;
use isotherm::observe::status::GatewayApi;

fn start(bed: &str) -> Arc<Mutex<Server>> {
    let mut server = Server::start(&[]);
    server.does(&format!("value bed {bed}"));
    Arc::new(Mutex::new(server))
}

#[track_caller]
fn stands(source: &dyn GatewayApi, server: &Mutex<Server>, offset: &str) {
    wait_until(source, offset, |_| server.lock().unwrap().does("read offset") == offset);
}

#[test]
fn an_operator_s_part_of_a_node_stays_while_ours_moves_and_over_a_restart_of_the_gateway() {
    let server = start("23");
    let port = server.lock().unwrap().port;
    let text = machine(port, "") + "share = \"ledger\"\n";
    let directory = tempfile::tempdir().unwrap();
    let options = || Options { directory: Some(directory.path().to_owned()), ..Options::default() };
    let control = server.clone();
    beside(&text, options(), move |source| {
        stands(source, &control, "30");
        control.lock().unwrap().does("value offset 80");
        wait_until(source, "it is his", |status| {
            events(status).iter().any(|text| {
                text.starts_with("output offset: the operator offset changed from 0.0 µm to 5.0 µm")
            })
        });
        control.lock().unwrap().does("value bed 21");
        stands(source, &control, "60");
    });
    server.lock().unwrap().does("value bed 22");
    let control = server.clone();
    beside(&text, options(), move |source| stands(source, &control, "70"));
    let written = server.lock().unwrap().does("values offset");
    let written: Vec<i32> = written.split(' ').map(|value| value.parse().unwrap()).collect();
    assert_eq!(written, [10, 20, 30, 70, 60, 70], "never more than a step of 1 µm at once");
}

#[test]
fn a_sum_that_the_server_says_it_has_taken_and_has_not_is_caught() {
    let server = start("23");
    server.lock().unwrap().does("keep offset");
    let text = machine(server.lock().unwrap().port, "") + "share = \"ledger\"\n";
    let directory = tempfile::tempdir().unwrap();
    let options = Options { directory: Some(directory.path().to_owned()), ..Options::default() };
    let control = server.clone();
    beside(&text, options, move |source| {
        wait_until(source, "it is reported", |status| {
            events(status).iter().any(|text| {
                text.starts_with("output offset: wrote 1.0 µm, read back 0.0 µm; the server answered Good")
            })
        });
        control.lock().unwrap().does("allow offset");
        stands(source, &control, "30");
    });
}

#[test]
fn a_heartbeat_counts_in_a_node_of_its_own_type_and_goes_on_when_the_server_is_back() {
    let server = start("20");
    let port = server.lock().unwrap().port;
    let heartbeat =
        "[heartbeat]\ndevice = \"cnc\"\nnode = \"ns=2;s=life\"\ntype = \"i16\"\nevery = \"100ms\"\n";
    let control = server.clone();
    beside(&format!("{}{heartbeat}", machine(port, "")), Options::default(), move |source| {
        let beats = || control.lock().unwrap().does("read life").parse::<u16>().unwrap();
        wait_until(source, "it counts", |_| beats() > 10);
        let written = control.lock().unwrap().does("values life");
        let written: Vec<u16> = written.split(' ').map(|beat| beat.parse().unwrap()).collect();
        assert!(written.iter().zip(1..).all(|(beat, place)| *beat == place), "{written:?}");
        let before = beats();
        let mut server = control.lock().unwrap();
        let dead = std::mem::replace(&mut *server, Server::start(&[]));
        *server = dead.dies(&[]);
        drop(server);
        wait_until(source, "it goes on", |_| beats() > before);
    });
}

#[test]
fn a_control_that_was_restarted_is_seen_by_its_boot_counter_and_its_offset_walked_in_anew() {
    let server = start("23");
    let restart = "restart = { boot_counter = { node = \"ns=2;s=boots\" } }\n";
    let text = machine(server.lock().unwrap().port, "") + restart;
    let control = server.clone();
    beside(&text, Options::default(), move |source| {
        stands(source, &control, "30");
        let mut server = control.lock().unwrap();
        server.does("value offset 0");
        server.does("value boots 2");
        drop(server);
        wait_until(source, "it is reported", |status| {
            events(status)
                .iter()
                .any(|text| text.starts_with("device cnc: the boot counter went from 1 to 2"))
        });
        stands(source, &control, "30");
    });
}
