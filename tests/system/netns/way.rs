//! Network path from this network namespace to another, through a bridge in a third one:
//!
//! ```text
//! here ──veth── [ bridge ] ──veth── there
//! ```
//!
//! A cut is not visible at either end: the bridge forwards nothing, but every interface keeps its carrier, its address,
//! its route and its neighbour. Packets are lost without an error, and TCP continues to retransmit.

use std::fs::File;
use std::net::TcpListener;
use std::os::fd::AsFd;
use std::process::Command;

use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};

pub(crate) struct Way {
    number: u8,
}

impl Way {
    /// Makes a path with its own addresses.
    pub(crate) fn lay(number: u8) -> Way {
        // None of this may be created in the network of the computer itself.
        let is_apart = std::env::var_os("ISOTHERM_NETNS").is_some();
        assert!(is_apart, "this is no network namespace for tests: start tests/netns/run");
        let way = Way { number };
        let [middle, there] = [way.middle(), way.there()];
        let (near, far) = (format!("10.77.{number}.1"), format!("10.77.{number}.2"));
        // The link addresses are fixed, so that a cut causes no new search for a neighbour.
        let (near_link, far_link) =
            (format!("02:00:00:00:{number:02x}:01"), format!("02:00:00:00:{number:02x}:02"));
        for line in [
            format!("netns add {middle}"),
            format!("netns add {there}"),
            format!("link add near{number} address {near_link} type veth peer name left netns {middle}"),
            format!("-n {there} link add far address {far_link} type veth peer name right netns {middle}"),
            format!("-n {middle} link add bridge type bridge"),
            format!("-n {middle} link set left master bridge up"),
            format!("-n {middle} link set right master bridge up"),
            format!("-n {middle} link set bridge up"),
            format!("address add {near}/24 dev near{number}"),
            format!("link set near{number} up"),
            format!("-n {there} address add {far}/24 dev far"),
            format!("-n {there} link set far up"),
            format!("neighbour replace {far} lladdr {far_link} nud permanent dev near{number}"),
            format!("-n {there} neighbour replace {near} lladdr {near_link} nud permanent dev far"),
        ] {
            ip(&line);
        }
        way
    }

    /// Listening socket at the far end. It remains in that namespace, regardless of the thread that uses it.
    pub(crate) fn listen(&self) -> TcpListener {
        let (namespace, address) =
            (format!("/run/netns/{}", self.there()), format!("10.77.{}.2:502", self.number));
        let there = std::thread::spawn(move || {
            let namespace = File::open(namespace).unwrap();
            move_into_link_name_space(namespace.as_fd(), Some(LinkNameSpaceType::Network)).unwrap();
            TcpListener::bind(address).unwrap()
        });
        there.join().unwrap()
    }

    /// Cuts the path.
    pub(crate) fn cut(&self) {
        ip(&format!("-n {} link set bridge down", self.middle()));
    }

    /// Restores the path.
    pub(crate) fn restore(&self) {
        ip(&format!("-n {} link set bridge up", self.middle()));
    }

    fn middle(&self) -> String {
        format!("middle{}", self.number)
    }

    fn there(&self) -> String {
        format!("there{}", self.number)
    }
}

#[track_caller]
fn ip(line: &str) {
    let done = Command::new("ip").args(line.split(' ')).output();
    let done = done.unwrap_or_else(|error| panic!("`ip` cannot be run ({error})"));
    let why = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "`ip {line}` failed: {why}");
}
