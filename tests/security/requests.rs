//! Requests that a proxy and the gateway interpret differently, and requests from other sites.

use std::io::{Read, Write};

use crate::site::Site;

const LOCAL: &str = "commands = \"local\"\n";

#[test]
fn a_request_for_two_hosts_is_refused_and_so_is_one_whose_target_names_another() {
    let site = Site::with(LOCAL);
    let host = site.address.to_string();
    for (target, hosts, code) in [
        ("/api/status", vec![host.as_str()], "200"),
        ("/api/status", vec![host.as_str(), host.as_str()], "400"),
        ("/api/status", vec![host.as_str(), "evil.example"], "400"),
        ("/api/status", vec!["evil.example", host.as_str()], "400"),
        ("/healthz", vec![host.as_str(), "evil.example"], "400"),
        (&format!("http://{host}/api/status"), vec![host.as_str()], "200"),
        ("http://evil.example/api/status", vec![host.as_str()], "400"),
        (&format!("http://{host}/api/status"), vec!["evil.example"], "400"),
        (&format!("http://{host}/api/status"), vec![], "400"),
        (&format!("http://user@{host}/api/status"), vec![host.as_str()], "400"),
    ] {
        let mut line = site.connect("127.0.0.1");
        let hosts: String = hosts.iter().map(|host| format!("Host: {host}\r\n")).collect();
        let request = format!("GET {target} HTTP/1.1\r\n{hosts}Connection: close\r\n\r\n");
        line.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        line.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with(&format!("HTTP/1.1 {code}")), "{target} {hosts}: {answer}");
    }
}

#[test]
fn a_page_of_another_scheme_is_another_page() {
    let site = Site::with(LOCAL);
    for (origin, code) in [("http", 200), ("https", 403), ("HTTP", 403), ("ws", 403)] {
        let reply = site.post("/api/disarm", &format!("Origin: {origin}://{}\r\n", site.address));
        assert_eq!(reply.code, code, "{origin}: {}", reply.body);
    }
    assert_eq!(site.status()["event_counts"]["command"], 1);
}
