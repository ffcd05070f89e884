//! Another program has the port of the page: the machine is compensated nevertheless.

use std::net::TcpListener;
use std::time::Duration;

use isotherm::clock::Clock;

use crate::on_time::polls;
use crate::process::until;
use crate::rig::{Machine, ask, get};

#[test]
fn a_taken_port_keeps_no_machine_from_being_held_and_the_page_comes_when_it_is_free() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let page = taken.local_addr().unwrap();
    let begun = Clock::wall().now();
    let mut machine = Machine::start(None, &["--listen", &page.to_string()], "");
    machine.is_held();
    let polled = polls(&machine.device.state())[0].since(begun);
    let _on_time = machine.on_time();
    println!("polled after {polled:?}");
    machine.gateway.receives(&format!("the web page cannot listen on {page}"));
    drop(taken);
    machine.gateway.receives(&format!("page http://{page}"));
    until("the page answers", || match ask(page, &get(page, "/api/status")) {
        Some(answer) if answer.contains("\"page-closed\":1") && answer.contains("\"page-open\":1") => Ok(()),
        other => Err(format!("{other:?}")),
    });
    let events = machine.verb("events").output().unwrap();
    let events = String::from_utf8_lossy(&events.stdout).into_owned();
    assert_eq!(events.matches("perhaps a gateway that is running").count(), 1, "{events}");
    // If the gateway waited for the page, it would not poll before the port is free.
    assert!(polled < Duration::from_secs(30), "{polled:?}");
}
