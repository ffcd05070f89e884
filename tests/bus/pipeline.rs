//! Tests of `pipeline = 2`: a corrected position and the request for the next one are sent together, to devices that
//! support it and to others.
#![allow(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::io::{ErrorKind, Read, Result, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::gateway::{Options, Pace};
use isotherm::observe::status::{GatewayApi, Status};

use crate::support::device;

use device::gateway::{beside, events, reported, wait_until};
use device::server::{Question, hang_up, serve};

const PROFILE: &str = r#"
[machine]
name = "readout"
arm = "auto"
[bus.cell]
type = "modbus-tcp"
address = "ADDRESS"
timeout = "200ms"
pipeline = 2
[device.scale]
bus = "cell"
unit = 1
every = "25ms"
[signal.bed]
device = "scale"
register = "holding:0"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "5s"
max_rate = "none"
[signal.position]
device = "scale"
register = "holding:1"
type = "u16"
scale = 0.01
unit = "mm"
max_age = "5s"
[axis.y]
limit = 40.0
step = 1.0
rate = 100.0
every = "50ms"
on_fault = { action = "hold" }
[[axis.y.model]]
name = "bed"
kind = "linear"
terms = [ { signal = "bed", gain = 1.0, reference = 20.0 } ]
[output.corrected]
axis = "y"
device = "scale"
writes = "corrected"
position = "position"
register = "holding:10"
type = "u16"
scale = 0.01
"#;

const QUESTION: usize = 12;

/// Reaction of a device to a request that arrives before it has answered the one before.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Bears {
    It,
    /// The request is never answered.
    Loses,
    /// The request is answered with the number of another one.
    Renumbers,
    /// The first request is answered, and the connection is closed.
    Closes,
}

/// Scale whose position changes with each read, and its record of the requests.
#[derive(Default)]
struct Scale {
    position: u16,
    /// Last written value.
    holds: [u8; 2],
    pairs: u32,
    writes: u32,
    /// Position and written value of each write for another position than the last one read.
    wrong: Vec<(u16, u16)>,
}

fn scale(bears: Bears) -> (Arc<Mutex<Scale>>, SocketAddr) {
    let scale = Arc::new(Mutex::new(Scale::default()));
    let seen = scale.clone();
    (scale, serve(move |question, stream| answer(&seen, bears, question, stream)))
}

fn answer(scale: &Mutex<Scale>, bears: Bears, question: &Question, stream: &mut TcpStream) -> Result<()> {
    let mut scale = scale.lock().unwrap();
    if question.is_read() && question.from() > 0 {
        return stream.write_all(&question.answer(&[3, 2, scale.holds[0], scale.holds[1]]));
    }
    if question.is_read() {
        scale.position = scale.position % 60_000 + 1;
        return stream.write_all(&question.answer(&question.read(&[200, scale.position])));
    }
    scale.writes += 1;
    scale.holds = question.words()[0].to_be_bytes();
    // The bed has its reference temperature, so the correction is zero.
    if question.words() != [scale.position] {
        let wrong = (scale.position, question.words()[0]);
        scale.wrong.push(wrong);
    }
    let done = question.answer(&question.done());
    if !is_followed(stream)? {
        return stream.write_all(&done);
    }
    scale.pairs += 1;
    if bears == Bears::It {
        return stream.write_all(&done);
    }
    let mut second = [0; QUESTION];
    stream.read_exact(&mut second)?;
    stream.write_all(&done)?;
    match bears {
        Bears::Closes => return hang_up(),
        Bears::Renumbers => {
            let number = u16::from_be_bytes([second[0], second[1]]).wrapping_add(9).to_be_bytes();
            stream.write_all(&[&number[..], &[0, 0, 0, 7, 1, 3, 4, 0, 200, 0, 1]].concat())?;
        }
        Bears::Loses | Bears::It => {}
    }
    Ok(())
}

/// Returns whether another request has arrived.
fn is_followed(stream: &TcpStream) -> Result<bool> {
    stream.set_nonblocking(true)?;
    let found = stream.peek(&mut [0; QUESTION]);
    stream.set_nonblocking(false)?;
    match found {
        Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(false),
        found => Ok(found? == QUESTION),
    }
}

/// Runs the gateway with this device and a script, as fast as both can. `verify` is the verification of writes.
fn run(address: SocketAddr, verify: &str, script: impl FnOnce(&dyn GatewayApi) + Send + 'static) -> Status {
    let pace = Pace { polls: Duration::from_micros(1), axes: Duration::from_millis(5) };
    let text = PROFILE.replace("ADDRESS", &address.to_string()) + &format!("verify = \"{verify}\"\n");
    beside(&text, Options { pace: Some(pace), ..Options::default() }, script)
}

#[test]
fn a_device_that_bears_it_is_asked_for_the_next_position_while_it_is_given_the_last_one_corrected() {
    for verify in ["echo", "read-back"] {
        let (scale, address) = scale(Bears::It);
        let seen = scale.clone();
        let status = run(address, verify, move |source| {
            wait_until(source, "a thousand pairs", |status| {
                seen.lock().unwrap().pairs > 1000 && status.devices[0].state == "ok"
            });
        });
        let scale = scale.lock().unwrap();
        assert_eq!(scale.wrong, [], "each position is corrected as it was told last");
        // The system decides whether the second request has arrived when the first is processed. Usually it has.
        assert!(scale.pairs > scale.writes / 2, "{verify}: {} of {}", scale.pairs, scale.writes);
        assert_eq!(reported(&status, "pipeline-given-up"), 0, "{:?}", events(&status));
        assert_eq!(status.devices[0].state, "ok", "{:?}", events(&status));
    }
}

#[test]
fn a_device_that_does_not_bear_it_is_asked_one_at_a_time_after_that_was_noticed() {
    for bears in [Bears::Loses, Bears::Renumbers, Bears::Closes] {
        let (scale, address) = scale(bears);
        let seen = scale.clone();
        let status = run(address, "echo", move |source| {
            wait_until(source, "it is given up", |status| reported(status, "pipeline-given-up") == 1);
            let (pairs, writes) = {
                let scale = seen.lock().unwrap();
                (scale.pairs, scale.writes)
            };
            wait_until(source, "it goes on", |_| seen.lock().unwrap().writes > writes + 200);
            assert_eq!(seen.lock().unwrap().pairs, pairs, "{bears:?}");
        });
        assert_eq!(scale.lock().unwrap().wrong, [], "{bears:?}");
        let told = events(&status).into_iter().find(|text| text.contains("two requests at a time"));
        assert!(
            told.is_some_and(|text| text.contains("remove `pipeline`")),
            "{bears:?}: {:?}",
            events(&status)
        );
    }
}

#[test]
fn check_online_tries_it_with_reads_and_names_the_device_that_does_not_bear_it() {
    let home = tempfile::tempdir().unwrap();
    let profile = home.path().join("readout.toml");
    // An answer may take as long as a busy computer needs.
    for (bears, timeout, words, fails) in [
        (Bears::It, "20s", "device scale: two requests at a time: both answered", false),
        (
            Bears::Loses,
            "3s",
            "device scale: two requests at a time: no answer in time: remove `pipeline` from bus cell",
            true,
        ),
    ] {
        let seen = Arc::new(Mutex::new(Vec::new()));
        let asked = seen.clone();
        let address = serve(move |question, stream| {
            asked.lock().unwrap().push(question.is_read());
            std::thread::sleep(Duration::from_millis(2));
            if bears == Bears::Loses && is_followed(stream)? {
                stream.read_exact(&mut [0; QUESTION])?;
            }
            stream.write_all(&question.answer(&question.read(&[200, 7])))
        });
        let text = PROFILE.replace("ADDRESS", &address.to_string()).replace("200ms", timeout);
        std::fs::write(&profile, text).unwrap();
        let mut check = Command::new(env!("CARGO_BIN_EXE_isotherm"));
        let output = check.args(["check", "--online"]).arg(&profile).output().unwrap();
        let said = String::from_utf8(output.stdout).unwrap() + &String::from_utf8(output.stderr).unwrap();
        assert!(said.contains(words), "{said}");
        assert_eq!(output.status.code(), Some(i32::from(fails)), "{said}");
        assert!(seen.lock().unwrap().iter().all(|is_read| *is_read), "nothing is written");
    }
}
