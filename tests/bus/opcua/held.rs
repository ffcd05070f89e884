//! Tests of a whole gateway with an offset in a node.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::gateway::{beside, events, wait_until};
use super::rig::{Server, machine};
use isotherm::clock::Clock;
use isotherm::gateway::Options;
use isotherm::observe::status::Status;

pub(super) fn bed(status: &Status) -> &str {
    let found = status.signals.iter().find(|signal| signal.name == "bed");
    found.map_or("", |signal| signal.quality)
}

#[test]
fn a_gateway_holds_an_offset_in_a_node_and_goes_on_when_the_server_is_back() {
    let mut server = Server::start(&[]);
    server.does("value bed 23");
    let text = machine(server.port, "");
    beside(&text, Options::default(), move |source| {
        let stands = |server: &mut Server, wanted: &str| server.does("read offset") == wanted;
        wait(&mut server, |server| stands(server, "30"));
        let mut server = server.dies(&[]);
        server.does("value bed 21");
        wait_until(source, "the server is read again", |status| bed(status) == "good");
        wait(&mut server, |server| stands(server, "10"));
    });
}

#[test]
fn a_gateway_that_ends_closes_its_session_and_its_place_is_free_at_once() {
    let server = Arc::new(Mutex::new(Server::start(&[])));
    let (text, seen) = (machine(server.lock().unwrap().port, ""), server.clone());
    beside(&text, Options::default(), move |source| {
        wait_until(source, "it is read", |status| bed(status) == "good");
        assert_eq!(seen.lock().unwrap().does("open"), "1");
    });
    assert_eq!(server.lock().unwrap().does("open"), "0");
}

#[test]
fn a_gateway_ends_in_time_beside_a_server_that_does_not_answer() {
    let server = Arc::new(Mutex::new(Server::start(&[])));
    let (text, seen) = (machine(server.lock().unwrap().port, ""), server.clone());
    let clock = Clock::wall();
    let (ends, ended) = std::sync::mpsc::channel();
    let by = clock.clone();
    beside(&text, Options::default(), move |source| {
        wait_until(source, "it is read", |status| bed(status) == "good");
        seen.lock().unwrap().stops();
        ends.send(by.now()).unwrap();
    });
    let took = clock.now().since(ended.recv().unwrap());
    // The fault action does not depend on the server. The limit is two timeouts and a margin for a busy computer.
    assert!(took < Duration::from_secs(30), "{took:?}");
}

#[test]
fn a_server_that_answers_good_and_keeps_the_old_value_is_caught() {
    let mut server = Server::start(&[]);
    server.does("value bed 23");
    server.does("keep offset");
    let text = machine(server.port, "");
    let server = Mutex::new(server);
    beside(&text, Options::default(), move |source| {
        wait_until(source, "nothing stands there that was written", |status| {
            events(status).iter().any(|text| {
                text.starts_with("output offset: wrote 1.0 µm, read back 0.0 µm; the server answered Good")
            })
        });
        assert_eq!(server.lock().unwrap().does("read offset"), "0");
    });
}

#[test]
fn a_source_whose_clock_is_an_hour_off_is_not_believed_and_is_when_it_is_right_again() {
    let mut server = Server::start(&[]);
    let text = machine(server.port, "");
    beside(&text, Options::default(), move |source| {
        wait_until(source, "it is read", |status| bed(status) == "good");
        for (seconds, quality) in [("-3600", "stale"), ("3600", "source-clock")] {
            server.does(&format!("stamp bed {seconds}"));
            wait_until(source, quality, |status| bed(status) == quality);
            server.does("stamp bed 0");
            wait_until(source, "its clock is right", |status| bed(status) == "good");
        }
    });
}

pub(super) fn wait(server: &mut Server, found: impl Fn(&mut Server) -> bool) {
    for _ in 0..1200 {
        if found(server) {
            return;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    panic!("after a minute the node holds {}", server.does("read offset"));
}
