//! Devices that send floods: hundreds of connections that are reset, endless garbage, answers byte by byte.
//!
//! The tests run in wall-clock time, because the sockets are real and there is nothing to wait for between them. The
//! back-off of the line determines when a reading returns.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options, Outcome};
use isotherm::observe::status::{GatewayApi, Status};
use isotherm_profile::parse;

const PROFILE: &str = r#"
[machine]
name = "storm"
[bus.mad]
type = "modbus-tcp"
address = "MAD"
[bus.sane]
type = "modbus-tcp"
address = "SANE"
[device.mad]
bus = "mad"
unit = 1
every = "100ms"
[device.sane]
bus = "sane"
unit = 1
every = "100ms"
[signal.mad]
device = "mad"
register = "holding:0"
type = "u16"
unit = "degC"
max_age = "5s"
range = "none"
max_rate = "none"
[signal.sane]
device = "sane"
register = "holding:0"
type = "u16"
unit = "degC"
max_age = "5s"
range = "none"
max_rate = "none"
"#;

/// Duration of the flood.
const STORM: Duration = Duration::from_secs(2);
/// Value that a device reads when it answers.
const VALUE: u8 = 42;
/// Limit for the recovery. The flood leaves time for pauses of 1 s and 2 s. One more of 4 s may have begun at its end,
/// after a request that waits for its answer. On a busy computer that request is lost as well, and pauses of 8 s and 16
/// s follow.
const RECOVERY: Duration = Duration::from_secs(60);

/// Serves every connection with `act` on a separate thread. Counts the connections.
fn server(act: impl Fn(TcpStream) + Send + Sync + 'static) -> (SocketAddr, Arc<AtomicU64>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (act, count) = (Arc::new(act), Arc::new(AtomicU64::new(0)));
    let counted = count.clone();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            counted.fetch_add(1, Ordering::Relaxed);
            let act = act.clone();
            std::thread::spawn(move || act(stream.unwrap()));
        }
    });
    (address, count)
}

/// Answers each request as a device does. `write` writes the bytes.
fn answer(mut stream: TcpStream, mut write: impl FnMut(&mut TcpStream, &[u8]) -> std::io::Result<()>) {
    let mut asked = [0; 12];
    while stream.read_exact(&mut asked).is_ok() {
        let reply = [asked[0], asked[1], 0, 0, 0, 5, asked[6], asked[7], 2, 0, VALUE];
        if write(&mut stream, &reply).is_err() {
            return;
        }
    }
}

fn sanely(stream: TcpStream) {
    answer(stream, |stream, bytes| stream.write_all(bytes));
}

/// Closes the connection with a reset, which the system sends if there are unread bytes.
fn reset(stream: &TcpStream) {
    let _ = stream.set_nonblocking(true);
    let _ = socket2::SockRef::from(stream).set_linger(Some(Duration::ZERO));
}

/// Server with a flood that is over after [`STORM`].
fn storm(rage: impl Fn(TcpStream) + Send + Sync + 'static) -> (SocketAddr, Arc<AtomicU64>) {
    let clock = Clock::wall();
    let over = clock.now().after(STORM);
    server(move |stream| if clock.now() < over { rage(stream) } else { sanely(stream) })
}

struct After {
    status: Status,
    outcome: Outcome,
    /// Growth of this process, MiB.
    grown: f64,
    recovered: Duration,
}

/// Memory of this process, MiB.
fn memory() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    let kilobytes: f64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
    kilobytes / 1024.0
}

fn value(status: &Status, name: &str) -> Option<f64> {
    status.signals.iter().find(|signal| signal.name == name).and_then(|signal| signal.value)
}

/// Runs a gateway with a misbehaving device and a normal one, until the first one reads well after its flood.
fn weather(mad: SocketAddr) -> After {
    let (sane, _) = server(sanely);
    let text = PROFILE.replace("MAD", &mad.to_string()).replace("SANE", &sane.to_string());

    let loaded = parse(Path::new("storm.toml"), &text, &[], &[]).unwrap_or_else(|errors| panic!("{errors}"));
    let mut profile = loaded.profile;
    // Longer than a busy computer needs. The gateway waits for each lost answer of the misbehaving device.
    for bus in &mut profile.buses {
        bus.timeout = Duration::from_millis(if bus.name == "mad" { 900 } else { 10_000 });
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let clock = Clock::wall();
        let gateway = Gateway::new(profile, &clock, Options::default());
        let source: Arc<dyn GatewayApi> = gateway.source();
        let before = memory();
        let begun = clock.now();
        let (mut recovered, mut last) = (None, None);
        let watching = async {
            tokio::time::sleep(STORM).await;
            while recovered.is_none() && clock.now().since(begun) < STORM + RECOVERY {
                tokio::time::sleep(Duration::from_millis(20)).await;
                let status = source.status();
                let device = status.devices.iter().find(|device| device.name == "mad").unwrap();
                // On a busy computer that may be before there were enough requests.
                let is_asked = status.devices.iter().all(|device| device.requests > 5);
                if device.state == "ok" && value(&status, "mad").is_some() && is_asked {
                    recovered = Some(clock.now().since(begun.after(STORM)));
                }
                last = Some(status);
            }
        };
        let outcome = gateway.run(watching, std::future::pending()).await;
        let status = last.unwrap();
        let recovered = recovered.unwrap_or_else(|| panic!("it has not recovered: {:?}", status.devices));
        After { status, outcome, grown: memory() - before, recovered }
    })
}

/// Checks that nothing panics, memory is bounded, the other device is not affected, and only true values were accepted.
fn holds(after: &After) {
    assert!(!after.outcome.failed, "{:?}", after.status.events);
    assert!(after.grown < 32.0, "{} MiB more", after.grown);
    assert_eq!(value(&after.status, "mad"), Some(f64::from(VALUE)));
    let sane = after.status.devices.iter().find(|device| device.name == "sane").unwrap();
    assert!(sane.requests > 5 && sane.failures.is_empty(), "{} {:?}", sane.requests, sane.failures);
    assert!(after.recovered < RECOVERY, "{:?}", after.recovered);
}

#[test]
fn a_device_that_resets_every_connection_is_left_alone_more_and_more_and_comes_back() {
    let (mad, connections) = storm(|mut stream| {
        let mut asked = [0; 12];
        let _ = stream.read(&mut asked);
        reset(&stream);
    });
    let after = weather(mad);
    holds(&after);
    let made = connections.load(Ordering::Relaxed);
    assert!(made < 8, "{made} connections in a storm of two seconds at ten polls a second");
}

#[test]
fn resets_in_the_middle_of_answers_lose_readings_and_nothing_else() {
    let (mad, _) = storm(|stream| {
        let mut served = 0;
        answer(stream, |stream, bytes| {
            served += 1;
            if served % 5 == 0 {
                stream.write_all(&bytes[..5])?;
                reset(stream);
                return Err(std::io::ErrorKind::ConnectionReset.into());
            }
            stream.write_all(bytes)
        });
    });
    holds(&weather(mad));
}

#[test]
fn a_server_that_sends_garbage_without_end_is_believed_nothing_and_costs_no_memory() {
    let (mad, _) = storm(|mut stream| {
        let mut state = 1_u64;
        let mut block = [0_u8; 4096];
        loop {
            for byte in &mut block {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                *byte = state.to_be_bytes()[0];
            }
            if stream.write_all(&block).is_err() {
                return;
            }
        }
    });
    holds(&weather(mad));
}

#[test]
fn a_flood_of_headers_that_promise_more_than_comes_costs_no_memory() {
    let (mad, _) = storm(|mut stream| while stream.write_all(&[0, 0, 0, 0, 0xff, 0xff, 1, 3]).is_ok() {});
    holds(&weather(mad));
}

#[test]
fn an_answer_that_comes_one_byte_at_a_time_is_one_answer() {
    let (mad, _) = server(|stream| {
        answer(stream, |stream, bytes| {
            bytes.iter().try_for_each(|byte| {
                stream.write_all(&[*byte])?;
                std::thread::sleep(Duration::from_millis(2));
                Ok(())
            })
        });
    });
    let after = weather(mad);
    holds(&after);
    let device = after.status.devices.iter().find(|device| device.name == "mad").unwrap();
    assert!(device.requests > 5, "{} requests", device.requests);
}
