//! Rate limits of commands and log lines.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::time::Duration;

use isotherm::clock::BootClock;

use crate::process::{Running, file, free_port, isotherm, until};
use crate::site::{BOTH, OPERATOR, Site, bearer};

const MACHINE: &str = include_str!("../interop/machine.toml");
const SECOND: Duration = Duration::from_secs(1);

fn now() -> Duration {
    BootClock::default().passed()
}

/// Maximum number of commands that may have been accepted since then.
fn most(begun: Duration) -> usize {
    usize::try_from((now() - begun).as_secs()).unwrap() + 1
}

#[test]
fn thousands_of_measured_errors_a_second_teach_no_more_than_one_a_second() {
    let probe = "[axis.z.probe]\nlimit = 10.0\nfilter = 1.0\nmax_error = 50.0\n[output.cnc_z]";
    let site = Site::of(BOTH, |text| text.replace("[output.cnc_z]", probe));
    until("it compensates", || match &site.status()["axes"][0] {
        axis if axis["state"] == "active" && axis["verified_um"].is_number() => Ok(()),
        axis => Err(axis.to_string()),
    });
    let begun = now();
    let measured = ("POST", "/api/axes/z/measured", &*bearer(OPERATOR), r#"{"error_um":-1.0}"#);
    let codes = site.floods(measured, |_| now() < begun + 3 * SECOND);
    let (most, sent) = (most(begun), codes.iter().map(|(_, count)| count).sum::<usize>());
    let taken = codes.iter().filter(|(code, _)| *code != 429).map(|(_, count)| count).sum::<usize>();
    assert!((1..=most).contains(&taken) && sent > 10 * most, "{codes:?}");
    let events = site.status()["event_counts"].clone();
    let count = |kind: &str| usize::try_from(events[kind].as_u64().unwrap_or_default()).unwrap();
    assert_eq!(count("command") + count("command-refused"), taken, "{events}");
    let learned = site.status()["axes"][0]["probe"]["history"].as_array().unwrap().len();
    assert!(learned <= taken, "{learned} {taken}");
    println!("{sent} in 3 s, {taken} taken, {learned} learned from");
}

#[test]
fn commands_over_the_socket_and_over_http_share_one_a_second() {
    let site = Site::with(BOTH);
    site.is_known();
    let socket = site.home.path().join("state/walker.sock");
    let ask = |line: &str| {
        let mut stream = UnixStream::connect(&socket).unwrap();
        stream.write_all(line.as_bytes()).unwrap();
        let mut said = String::new();
        stream.read_to_string(&mut said).unwrap();
        said
    };
    let (begun, mut taken, mut asked) = (now(), 0, 0);
    while now() < begun + 3 * SECOND {
        let said = ask("zero\n");
        assert!(said.starts_with("ok ") || said.contains("less than a second ago"), "{said}");
        let reply = site.post("/api/zero?axis=z", &bearer(OPERATOR));
        assert!(reply.code == 200 || reply.header("retry-after") == "1", "{reply:?}");
        taken += usize::from(said.starts_with("ok ")) + usize::from(reply.code == 200);
        asked += 2;
    }
    assert!((1..=most(begun)).contains(&taken) && asked > 2 * taken, "{taken} of {asked}");
    // Unknown commands have the same rate limit.
    let begun = now();
    let refused = (0..200).filter(|_| ask("zero axis=q\n").contains("no axis q")).count();
    assert!((1..=most(begun)).contains(&refused), "{refused}");
}

#[test]
fn whoever_disarms_again_within_a_second_finds_nothing_armed() {
    let site = Site::with(BOTH);
    site.is_known();
    let operator = bearer(OPERATOR);
    let soon = |verb: &str| {
        until(verb, || match site.post(&format!("/api/{verb}"), &operator) {
            reply if reply.code == 200 => Ok(()),
            reply => Err(reply.body),
        });
    };
    let is_armed = || site.status()["axes"][0]["armed"] == true;
    soon("arm");
    std::thread::sleep(SECOND * 9 / 10);
    assert_eq!(site.post("/api/disarm", &operator).code, 200);
    soon("arm");
    assert!(is_armed());
    // Soon after the last command.
    assert_eq!(site.post("/api/disarm", &operator).code, 200);
    assert!(!is_armed());
    let begun = now();
    let again = site.post("/api/disarm", &operator);
    assert!(again.code == 429 || now() >= begun + SECOND, "{again:?}");
    assert!(!is_armed());
}

#[test]
fn what_is_asked_for_in_sixty_thousand_letters_is_a_short_event() {
    let site = Site::with(BOTH);
    site.is_known();
    let long = "x".repeat(60_000);
    let operator = bearer(OPERATOR);
    for (path, token) in [
        (format!("/api/{long}"), ""),
        (format!("/api/disarm?axis={long}"), operator.as_str()),
        (format!("/api/acknowledge?alarm={long}"), &operator),
        (format!("/api/axes/{long}/measured"), &operator),
    ] {
        let reply = site.send("POST", &path, token, r#"{"error_um":1}"#);
        assert!((400..500).contains(&reply.code), "{}", reply.code);
        assert!(reply.body.len() < 2000, "{}", reply.body.len());
    }
    let status = site.get("/api/status", &operator).body;
    assert!(status.len() < 50_000, "{} bytes", status.len());
    until("they are kept", || {
        let (_, events) = site.verb(&["events", "--json"]);
        let is_there = events.contains("something unknown") && events.matches("xxx…").count() >= 2;
        if is_there { Ok(()) } else { Err(events) }
    });
    let files = std::fs::read_dir(site.home.path().join("state")).unwrap().map(|entry| entry.unwrap());
    let events = files.filter(|entry| entry.file_name().to_string_lossy().contains("events"));
    let size: u64 = events.map(|entry| entry.metadata().unwrap().len()).sum();
    assert!((1..20_000).contains(&size), "{size} bytes of events");
}

#[test]
fn clients_of_a_virtual_machine_that_speak_no_modbus_are_counted_to_its_last_word() {
    let home = tempfile::tempdir().unwrap();
    let address = format!("127.0.0.1:{}", free_port());
    let text = MACHINE.replace("127.0.0.1:1\"", &format!("{address}\""));
    let profile = file(home.path(), "machine.toml", &text);
    let mut devices = Running::start(isotherm(home.path()).arg("virtual").arg(&profile));
    devices.receives("stop with Ctrl-C");
    for _ in 0..5 {
        let mut stream = TcpStream::connect(&address).unwrap();
        stream.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
        assert_eq!(stream.read(&mut [0; 16]).unwrap_or(0), 0, "it is closed");
    }
    devices.signal("INT");
    assert!(devices.ends_within(Duration::from_secs(30)).success());
    let said = devices.said.join("\n");
    assert_eq!(said.matches("this is not Modbus TCP").count(), 2, "{said}");
    assert!(said.contains("closed 4 more connections"), "{said}");
}

#[test]
fn of_many_lines_of_one_kind_ten_a_second_are_logged_and_the_others_counted() {
    let signals: String = (0..40)
        .map(|place| {
            format!(
                "[signal.s{place}]\ndevice = \"cnc\"\nregister = \"holding:0\"\ntype = \"i16\"\nscale = 0.1\nunit = \"degC\"\n\
                 bad = [{{ raw = -999, means = \"open circuit\" }}]\nmax_age = \"5s\"\n"
            )
        })
        .collect();
    let mut site = Site::of("", |text| text.replace("[axis.z]", &format!("{signals}[axis.z]")));
    site.device.asks(-999);
    site.gateway.receives("more lines within a second were left out: signal-bad");
    let lines = site.gateway.said.iter().filter(|line| line.contains("signal s")).count();
    assert!(lines <= 20, "{lines} lines: {:#?}", site.gateway.said);
    until("each is an event all the same", || {
        match &site.get("/api/status", "").json()["event_counts"]["signal-bad"] {
            count if count.as_u64() >= Some(40) => Ok(()),
            count => Err(count.to_string()),
        }
    });
}
