//! Serial server that buffers the frames of a serial line over a socket. It passes on requests and answers late and in
//! blocks, to the client that is connected then, whatever the client has requested in the meantime.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Options, Pace};
use isotherm::observe::status::Status;
use isotherm_core::quantity::Moment;

use crate::late_writes::control::{Control, Shared};
use crate::late_writes::device::gateway::{self, wait_until};
use crate::late_writes::device::server::Question;
use crate::late_writes::rig::{LEDGER, all_at_once, nobody_is_blamed};
use crate::support::frames::{Frames, Received};

/// Two units with two registers each. An answer that is taken for another one has a wrong value.
const PROFILE: &str = r#"
[machine]
name = "buffered"
[bus.line]
type = "TYPE"
address = "ADDRESS"
timeout = "3000ms"
late = "20s"
[device.module]
bus = "line"
unit = 2
every = "3200ms"
quirks = { one_request_per_field = true }
[device.cnc]
bus = "line"
unit = 1
every = "3200ms"
[signal.bed]
device = "module"
register = "holding:0"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "30s"
max_rate = "none"
[signal.air]
device = "module"
register = "holding:1"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "30s"
max_rate = "none"
"#;

const AXIS: &str = r#"
[axis.NAME]
limit = 40.0
step = 1.0
rate = 100.0
every = "3200ms"
on_fault = { action = "hold" }
[[axis.NAME.model]]
name = "one"
kind = "linear"
terms = [ { signal = "bed", gain = GAIN, reference = 20.0 } ]
[output.cnc_NAME]
axis = "NAME"
device = "cnc"
writes = "offset"
register = "holding:REGISTER"
type = "i16"
scale = 0.1
"#;

/// Kind of the buffered message, and the kind of request that it belongs to.
#[derive(Clone, Copy, Debug)]
struct Keeps {
    what: What,
    about: About,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    /// The request to the unit.
    Question,
    /// The answer to the connected client, and every later answer until it is sent.
    Answer,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum About {
    Temperature,
    Look,
    Write,
}

/// Every third request of the kind is buffered, but not more than a test has time for. Each time is longer than a
/// timeout, and shorter than the four timeouts that a late answer may take. The longest ends when a gateway that does
/// not wait for it would have asked again. A busy computer adds two seconds at most.
const EACH: usize = 3;
const MOST: usize = 2;
const SPANS: [Duration; 3] =
    [Duration::from_millis(4000), Duration::from_millis(6000), Duration::from_millis(9200)];

/// Period of polls and axes, because a profile has no period shorter than a timeout. With such a period, this line
/// would be idle most of the time.
const PACE: Duration = Duration::from_millis(200);

/// Time of one exchange with a unit.
const EXCHANGE: Duration = Duration::from_millis(20);

/// Server side of the socket.
#[derive(Default)]
struct Out {
    newest: Option<TcpStream>,
    kept: Vec<u8>,
    until: Moment,
}

impl Out {
    fn passes_on(&mut self, now: Moment) {
        if now >= self.until && !self.kept.is_empty() {
            let lump = std::mem::take(&mut self.kept);
            // A client that has just disconnected receives nothing.
            let _ = self.newest.as_mut().map(|stream| stream.write_all(&lump));
        }
    }
}

/// Starts the serial server in front of this control. Returns its address, and how often it has buffered something.
fn serve(frames: Frames, control: &Shared, keeps: Keeps) -> (SocketAddr, Arc<Mutex<usize>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (out, count) = (Arc::new(Mutex::new(Out::default())), Arc::new(Mutex::new(0)));
    let (bytes, line) = channel::<Vec<u8>>();
    let accepting = out.clone();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            stream.set_nodelay(true).unwrap();
            accepting.lock().unwrap().newest = Some(stream.try_clone().unwrap());
            let bytes = bytes.clone();
            std::thread::spawn(move || {
                let mut some = [0; 256];
                while let Ok(count @ 1..) = stream.read(&mut some) {
                    bytes.send(some[..count].to_vec()).unwrap();
                }
            });
        }
    });
    let passing = out.clone();
    std::thread::spawn(move || {
        loop {
            passing.lock().unwrap().passes_on(Clock::wall().now());
            std::thread::sleep(Duration::from_millis(5));
        }
    });
    let (control, counted) = (control.clone(), count.clone());
    std::thread::spawn(move || {
        let (mut waiting, mut seen) = (Received::new(frames), 0);
        for some in line {
            waiting.push(&some);
            while let Some(question) = Question::of_rtu(&mut waiting.bytes, 0) {
                let span = (about(&question) == keeps.about).then(|| next(&mut seen, &counted)).flatten();
                if let Some(span) = span.filter(|_| keeps.what == What::Question) {
                    std::thread::sleep(span);
                }
                std::thread::sleep(EXCHANGE);
                let answer = frames.encode(carry_out(&question, &control));
                let mut out = out.lock().unwrap();
                if let Some(span) = span.filter(|_| keeps.what == What::Answer) {
                    out.until = Clock::wall().now().after(span);
                }
                out.kept.extend(answer);
            }
        }
    });
    (address, count)
}

/// Time for which this request is buffered. `None` if it is not.
fn next(seen: &mut usize, count: &Mutex<usize>) -> Option<Duration> {
    *seen += 1;
    let mut count = count.lock().unwrap();
    let keeps = seen.is_multiple_of(EACH) && *count < MOST;
    *count += usize::from(keeps);
    keeps.then(|| SPANS[*count % SPANS.len()])
}

fn about(question: &Question) -> About {
    match (question.is_read(), question.unit) {
        (true, 2) => About::Temperature,
        (true, _) => About::Look,
        (false, _) => About::Write,
    }
}

fn carry_out(question: &Question, control: &Shared) -> Vec<u8> {
    let mut control = control.lock().unwrap();
    if question.is_read() {
        let pdu = control.read(question);
        return question.answer(&pdu);
    }
    control.put(question.from(), &question.words());
    question.answer(&question.done())
}

/// Runs up to 5 µm and down to −2 µm, with the other axis in the opposite direction.
fn kept(frames: Frames, keeps: Keeps, more: &str) {
    let name = format!("{frames:?} {keeps:?} {more:?}");
    let control = Control::of(|_| unreachable!());
    control.lock().unwrap().words[1] = 900;
    let (address, count) = serve(frames, &control, keeps);
    let axis = |name: &str, gain: &str, register: &str| {
        AXIS.replace("NAME", name).replace("GAIN", gain).replace("REGISTER", register) + more
    };
    let text = PROFILE.replace("ADDRESS", &address.to_string()).replace("TYPE", frames.type_through_tcp());
    let text = text + &axis("z", "1.0", "10") + &axis("y", "-1.0", "11");
    let seen = control.clone();
    let stands = move |z: i16| {
        let control = seen.lock().unwrap();
        control.offset() == z && *control.beside.last().unwrap() == -z
    };
    let cools = control.clone();
    let directory = tempfile::tempdir().unwrap();
    let pace = Some(Pace { polls: PACE, axes: PACE });
    let options = Options { directory: Some(directory.path().to_owned()), pace, ..Options::default() };
    let status = gateway::beside(&text, options, move |source| {
        let arrives = |status: &Status, at: i16| {
            believes_what_is_so(status);
            stands(at)
        };
        wait_until(source, "it arrives", |status| arrives(status, 50));
        cools.lock().unwrap().words[0] = 180;
        wait_until(source, "it goes back", |status| arrives(status, -20));
    });
    nobody_is_blamed(&control, &status, &name);
    let control = control.lock().unwrap();
    println!("{name}: kept {} times, {:?}", count.lock().unwrap(), control.stood);
    assert_eq!(*count.lock().unwrap(), MOST, "{name}");
    assert!(turns_once(&control.stood, 50) && turns_once(&control.beside, -50), "{:?}", control.stood);
}

/// Checks that only true temperatures were accepted. A late answer would have another value.
#[track_caller]
fn believes_what_is_so(status: &Status) {
    let value =
        |name: &str| status.signals.iter().find(|signal| signal.name == name).and_then(|one| one.value);
    let is = |value: Option<f64>, may: &[f64]| {
        value.is_none_or(|value| may.iter().any(|may| (may - value).abs() < 0.01))
    };
    assert!(is(value("bed"), &[25.0, 18.0]) && is(value("air"), &[90.0]), "{:?}", status.signals);
}

/// Returns whether the values go from zero to `at` and back, and never in the wrong direction.
fn turns_once(stood: &[i16], at: i16) -> bool {
    let Some(turn) = stood.iter().position(|value| *value == at) else { return false };
    let goes = |part: &[i16], way: i16| part.windows(2).all(|pair| (pair[1] - pair[0]).signum() == way);
    goes(&stood[..=turn], at.signum()) && goes(&stood[turn..], -at.signum())
}

#[test]
fn behind_a_serial_server_that_buffers_no_late_answer_is_believed_and_it_arrives_without_a_jump() {
    all_are_kept(Frames::Rtu);
}

#[test]
fn behind_a_serial_server_that_buffers_ascii_no_late_answer_is_accepted_and_it_arrives_without_a_jump() {
    all_are_kept(Frames::Ascii);
}

#[track_caller]
fn all_are_kept(frames: Frames) {
    let cases = [About::Temperature, About::Look, About::Write].into_iter();
    let cases = cases.flat_map(|about| [What::Question, What::Answer].map(|what| Keeps { what, about }));
    let cases = cases.flat_map(|keeps| ["", LEDGER].map(|more| (keeps, more)));
    all_at_once(cases.map(move |(keeps, more)| move || kept(frames, keeps, more)));
}
