//! Requests that mean one thing to us and another to whoever passes them on, and those that a foreign page sends.

use crate::fake::Door;

#[tokio::test]
async fn a_request_for_two_hosts_is_refused_and_so_is_one_whose_target_names_another() {
    let door = Door::open(None).await;
    let host = door.address.to_string();
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
        let mut line = door.connect().await;
        let hosts: String = hosts.iter().map(|host| format!("Host: {host}\r\n")).collect();
        line.write(&format!("GET {target} HTTP/1.1\r\n{hosts}Connection: close\r\n\r\n")).await;
        let answer = line.rest().await;
        assert!(answer.starts_with(&format!("HTTP/1.1 {code}")), "{target} {hosts}: {answer}");
    }
}

#[tokio::test]
async fn a_page_of_another_scheme_is_another_page() {
    let door = Door::open(None).await;
    for (origin, code) in [("http", 200), ("https", 403), ("HTTP", 403), ("ws", 403)] {
        let origin = format!("{origin}://{}", door.address);
        let reply = door.send("POST", "/api/disarm", &[("Origin", &origin)], "").await;
        assert_eq!(reply.code, code, "{origin}: {}", reply.body);
    }
    assert_eq!(door.commands().len(), 1);
}
