//! Servers of `[[notify]]`: the messages that arrive, and the effect of misbehaving servers on the machine.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::clock::BootClock;
use serde_json::Value;

use crate::process::{file, until};
use crate::rig::Machine;

/// Heads and documents in the order of arrival.
type Taken = Arc<Mutex<Vec<(String, Value)>>>;

/// Starts a server that handles each connection with `serve`. Connections are counted from 0.
fn server(serve: impl Fn(usize, TcpStream, &Taken) + Send + Sync + 'static) -> (SocketAddr, Taken) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (address, taken) = (listener.local_addr().unwrap(), Taken::default());
    let (into, serve) = (taken.clone(), Arc::new(serve));
    std::thread::spawn(move || {
        for (place, stream) in listener.incoming().flatten().enumerate() {
            let (serve, into) = (serve.clone(), into.clone());
            std::thread::spawn(move || serve(place, stream, &into));
        }
    });
    (address, taken)
}

/// Reads a request. Returns its head and its document.
fn request(stream: &mut TcpStream) -> Option<(String, Value)> {
    let mut bytes = Vec::new();
    loop {
        let mut some = [0; 4096];
        let count = stream.read(&mut some).ok().filter(|count| *count > 0)?;
        bytes.extend_from_slice(&some[..count]);
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let Some((head, body)) = text.split_once("\r\n\r\n") else { continue };
        let length = head.lines().find_map(|line| line.strip_prefix("Content-Length: ")?.parse().ok());
        if body.len() == length.unwrap_or(0) {
            return Some((head.to_owned(), serde_json::from_str(body).unwrap()));
        }
    }
}

#[test]
fn what_happens_arrives_in_its_order_with_the_token_and_what_is_secret_stands_nowhere() {
    // The server rejects the first message twice.
    let (address, taken) = server(|place, mut stream, taken| {
        let Some(request) = request(&mut stream) else { return };
        let answer =
            if place < 2 { "HTTP/1.1 503 No\r\nRetry-After: 1\r\n\r\n" } else { "HTTP/1.1 204 Yes\r\n\r\n" };
        if place > 1 {
            taken.lock().unwrap().push(request);
        }
        let _ = stream.write_all(answer.as_bytes());
    });
    let home = tempfile::tempdir().unwrap();
    let token = file(home.path(), "notify.token", "token-that-nobody-reads\n");
    std::fs::set_permissions(&token, std::fs::Permissions::from_mode(0o600)).unwrap();
    let table = format!(
        "[[notify]]\nurl = \"http://{address}/in/hidden-path?key=hidden-query\"\ntoken_file = \"{}\"\n\
         on = [\"started\", \"alarm\", \"alarm-over\", \"axis-off\", \"stopped\"]\n",
        token.display()
    );
    let mut machine = Machine::start(None, &[], &table);
    machine.is_held();
    let is_there = |what: &str, is: &dyn Fn(&Value) -> bool| {
        until(what, || {
            let taken = taken.lock().unwrap();
            let found = taken.iter().any(|(_, document)| is(document));
            if found { Ok(()) } else { Err(format!("{taken:?}")) }
        });
    };
    is_there("that it has started", &|document| document["kind"] == "started" && document["count"] == 1);
    machine.device.is_down(true);
    is_there("an alarm", &|document| document["alarm"].is_string());
    is_there("that the axis is off", &|document| document["kind"] == "axis-state" && document["axis"] == "z");
    machine.comes_back();
    is_there("its end", &|document| document["alarms_over"].is_array());
    machine.gateway.signal("TERM");
    assert!(machine.gateway.ends_within(Duration::from_secs(60)).success());
    is_there("that it has stopped", &|document| document["kind"] == "stopped");

    let taken = taken.lock().unwrap();
    for (place, (head, document)) in taken.iter().enumerate() {
        assert!(head.starts_with("POST /in/hidden-path?key=hidden-query HTTP/1.1\r\n"), "{head}");
        assert!(head.contains(&format!("\r\nHost: {address}\r\n")), "{head}");
        assert!(head.contains("\r\nAuthorization: Bearer token-that-nobody-reads\r\n"), "{head}");
        assert_eq!((&document["machine"], &document["dropped"]), (&"walker".into(), &0.into()), "{document}");
        assert_eq!(document["count"], place + 1, "{document}");
        assert!(document["when"].is_string() && document["text"].is_string(), "{document}");
    }
    let events = machine.verb("events").arg("--json").output().unwrap();
    let events = String::from_utf8(events.stdout).unwrap();
    for kind in ["notify-failed", "notify-back"] {
        assert_eq!(events.matches(&format!("\"{kind}\"")).count(), 1, "{events}");
    }
    let check = machine.verb_of_profile("check", &[]);
    assert!(check.contains(&format!("notify[0] to http://{address}, with the token in")), "{check}");
    let reached = machine.verb_of_profile("check", &["--online"]);
    assert!(reached.contains("is reachable; no message was posted"), "{reached}");
    let said = machine.gateway.said.join("\n") + &events + &check + &reached;
    for secret in ["hidden-path", "hidden-query", "token-that-nobody-reads"] {
        assert!(!said.contains(secret), "{said}");
    }
}

#[test]
fn servers_that_hang_drip_flood_and_break_off_hold_up_no_poll_and_a_stop_for_two_seconds() {
    let (hangs, _) = server(|_, stream, _| {
        std::thread::sleep(Duration::from_secs(300));
        drop(stream);
    });
    let (drips, _) = server(|_, mut stream, _| {
        let endless = b"HTTP/1.1 200 OK\r\nA: ".iter().chain(std::iter::repeat(&b'b'));
        for byte in endless {
            if stream.write_all(&[*byte]).is_err() {
                return;
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    });
    let (floods, _) = server(|_, mut stream, _| {
        let _ = stream.write_all(b"HTTP/1.1 200 OK\r\n");
        while stream.write_all(&[b'x'; 65536]).is_ok() {}
    });
    let (breaks, _) = server(|_, mut stream, _| {
        let _ = request(&mut stream);
        let _ = stream.write_all(b"HTTP/1.1 2");
    });
    // No server listens at this address, and this name does not exist.
    let servers = [hangs, drips, floods, breaks].map(|address| address.to_string());
    let servers = servers.into_iter().chain(["127.0.0.1:1".to_owned(), "no-such-host.invalid".to_owned()]);
    let table = |server: String| {
        format!(
            "[[notify]]\nurl = \"http://{server}/\"\non = [\"started\", \"command\", \"command-refused\", \"notify-failed\"]\n"
        )
    };
    let tables: String = servers.map(table).collect();
    let mut machine = Machine::start(None, &[], &tables);
    machine.is_held();
    let on_time = machine.on_time();
    for _ in 0..60 {
        // Most of them are rejected, and each rejection is an event.
        machine.verb("zero").output().unwrap();
        std::thread::sleep(Duration::from_millis(50));
    }
    drop(on_time);
    let failed = |place: usize| format!("notify[{place}]: a message to http://");
    until("it is said of whoever answers wrongly or not at all", || {
        let said = machine.gateway.so_far().join("\n");
        let unsaid: Vec<String> = (2..6).map(failed).filter(|words| !said.contains(words)).collect();
        if unsaid.is_empty() { Ok(()) } else { Err(format!("{unsaid:?}: {said}")) }
    });
    let asked = BootClock::default().passed();
    machine.gateway.signal("TERM");
    assert!(machine.gateway.ends_within(Duration::from_secs(60)).success());
    let took = BootClock::default().passed() - asked;
    // A stop that waited for the silent server would take twenty seconds.
    assert!(took < Duration::from_secs(18), "{took:?}");
    let said = machine.gateway.said.join("\n");
    for place in 0..6 {
        let count = said.matches(&failed(place)).count();
        // A silent server is reported after twenty seconds, which may not have passed.
        assert!(count == 1 || (place < 2 && count == 0), "{place} {said}");
        let words = format!("notify[{place}]: ");
        assert!(
            said.lines().any(|line| line.contains(&words) && line.contains("dropped ")),
            "{words} {said}"
        );
    }
    for why in [
        "does not speak HTTP/1.1",
        "before it had answered",
        "no program listens",
        "finds no address for the host name of the server",
    ] {
        assert!(said.contains(why), "{why}: {said}");
    }
}
