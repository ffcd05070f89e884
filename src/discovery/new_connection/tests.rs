//! Tests with simulated devices on real sockets.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::Path;

use super::*;
use isotherm_core::codec::Table;

const TIMEOUT: Duration = Duration::from_millis(500);
const READ: (Register, u16) = (Register { table: Table::Holding, offset: 0 }, 1);

/// Behaviour of the simulated device.
#[derive(Clone, Copy, Debug)]
enum Peer {
    /// Ignores the requests on a connection before this time.
    Deaf(Duration),
    /// Ignores this number of requests on each connection.
    Loses(u32),
    /// Ignores the first request of each connection, for this number of connections.
    LosesAtFirst(usize),
}

/// Serves one connection after another. Returns the address.
fn serve(peer: Peer) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        for (connection, stream) in listener.incoming().enumerate() {
            let mut stream = stream.unwrap();
            std::thread::spawn(move || {
                if let Peer::Deaf(span) = peer {
                    std::thread::sleep(span);
                    stream.set_nonblocking(true).unwrap();
                    let _ = stream.read(&mut [0; 1024]);
                    stream.set_nonblocking(false).unwrap();
                }
                let mut lost = match peer {
                    Peer::Deaf(_) => 0,
                    Peer::Loses(count) => count,
                    Peer::LosesAtFirst(count) => u32::from(connection < count),
                };
                let mut question = [0; 12];
                while stream.read_exact(&mut question).is_ok() {
                    if lost > 0 {
                        lost -= 1;
                        continue;
                    }
                    let answer = [question[0], question[1], 0, 0, 0, 5, question[6], question[7], 2, 0, 7];
                    if stream.write_all(&answer).is_err() {
                        return;
                    }
                }
            });
        }
    });
    address
}

async fn found(peer: Peer, quirks: Quirks) -> Option<NewConnection> {
    let line: LineAddress = format!("tcp://{}", serve(peer)).parse().unwrap();
    let bus = line.bus(TIMEOUT);
    // `isotherm read` has sent this read before the test.
    assert!(!is_answered(&line, &bus, Quirks::default(), 1, READ).await, "{peer:?}");
    examine(&line, &bus, quirks, 1, READ).await
}

#[tokio::test]
async fn a_device_that_is_deaf_after_connecting_is_told_from_one_that_loses_the_first_request() {
    let usual = Quirks::default();
    let known = Quirks { loses_first_request: true, ..usual };
    let (deaf, loses, chance, again, dead, works) = tokio::join!(
        found(Peer::Deaf(Duration::from_millis(1250)), usual),
        found(Peer::Loses(1), usual),
        found(Peer::LosesAtFirst(1), usual),
        found(Peer::LosesAtFirst(2), usual),
        found(Peer::Loses(u32::MAX), usual),
        found(Peer::Loses(1), known),
    );
    assert_eq!(deaf, Some(NewConnection::Deaf(PAUSES[1])));
    assert_eq!(loses, Some(NewConnection::LosesFirst));
    assert_eq!(chance, None, "it answers now");
    assert_eq!(again, None, "it has answered with a pause, but also answers without one");
    assert_eq!(dead, None);
    assert_eq!(works, None, "it answers with the setting that it has");
}

#[test]
fn each_behaviour_names_its_key() {
    for (behaviour, key) in [
        (NewConnection::Deaf(PAUSES[1]), "quirks = { pause_after_connect = \"2s\" }"),
        (NewConnection::LosesFirst, "quirks = { loses_first_request = true }"),
    ] {
        assert!(behaviour.to_string().contains(key), "{behaviour}");
    }
}

fn profile(kind: &str, address: &str) -> Profile {
    let text = format!(
        "[machine]\nname = \"cell\"\n[bus.cell]\ntype = \"{kind}\"\naddress = \"{address}\"\ntimeout = \"250ms\"\n\
         [device.one]\nbus = \"cell\"\nunit = 1\nevery = \"1s\"\n[signal.bed]\ndevice = \"one\"\n\
         register = \"holding:0\"\ntype = \"i16\"\nunit = \"degC\"\n"
    );
    let loaded = isotherm_profile::parse(Path::new("cell.toml"), &text, &[], &[]);
    loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Advice for this profile, and the devices that were named before the long part of a test.
async fn advice(profile: &Profile) -> (Vec<NewConnectionAdvice>, Vec<String>) {
    let named = std::cell::RefCell::new(Vec::new());
    let found = examined(profile, |bus, device| {
        named.borrow_mut().push(format!("{} on {}", device.name, bus.name));
    });
    let found = found.await;
    (found, named.into_inner())
}

#[tokio::test]
async fn the_devices_of_a_profile_are_tested_if_none_answers() {
    let (found, named) = advice(&profile("modbus-tcp", &serve(Peer::Loses(1)))).await;
    let [NewConnectionAdvice { bus, device, advice: text }] = found.as_slice() else { panic!("{found:?}") };
    assert_eq!((bus.as_str(), device.as_str()), ("cell", "one"));
    assert!(text.contains("loses_first_request"), "{text}");
    assert_eq!(named, ["one on cell"]);
    let answers = profile("modbus-tcp", &serve(Peer::Loses(0)));
    assert_eq!(advice(&answers).await, (Vec::new(), Vec::new()));
}

/// Returns the address of a peer that sends all bytes back.
fn echo() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            std::thread::spawn(move || {
                let mut bytes = [0; 64];
                while let Ok(count @ 1..) = stream.read(&mut bytes) {
                    if stream.write_all(&bytes[..count]).is_err() {
                        return;
                    }
                }
            });
        }
    });
    address
}

#[tokio::test]
async fn a_line_that_returns_each_request_is_named() {
    let (found, _) = advice(&profile("modbus-rtu-over-tcp", &echo())).await;
    let [NewConnectionAdvice { device, advice: text, .. }] = found.as_slice() else { panic!("{found:?}") };
    assert_eq!(device, "one");
    assert!(text.starts_with("the request itself comes back instead of a reply; "), "{text}");
}
