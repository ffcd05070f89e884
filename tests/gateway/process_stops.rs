//! Pauses of the computer: the program is stopped by SIGSTOP for seconds and minutes. It is stopped while it waits for
//! an answer, between a reading and its write, and at any moment. It then continues, reports the pause once, and does
//! nothing that is based on readings older than `max_age`.
//!
//! A computer that is too busy pauses as well, and the program reports it. Additional reports are void if the kernel
//! shows that a thread of the program or of the device had to wait for so long. The test then tries again.
//!
//! `TEST_STANDS_STILL_FOR=60,600` sets other times, in seconds; `tests/run long` uses these.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::support::device;
use crate::support::process;

use crate::support::starved::Starved;
use crate::support::tell;

use device::{Device, STEP, State, Times};
use process::{Running, file, isotherm};

/// Default durations of a pause, s.
const SPANS: [u64; 2] = [5, 14];
/// Short pause, longer than the largest age of a reading.
const SHORT: Duration = Duration::from_millis(1200);
/// Short pauses in one run, and runs in parallel.
const SHORTS: usize = 5;
const RUNS: u64 = 2;
/// Time in which the axis must continue.
const PATIENCE: Duration = Duration::from_secs(60);
const MAX_AGE: Duration = Duration::from_secs(1);
/// A thread that waits for a processor for this long pauses for a second, together with its intended wait.
const STARVED: Duration = Duration::from_millis(300);
/// Number of attempts if the observation of a run is void.
const TRIES: usize = 4;
const TIMES: Times =
    Times { timeout: Duration::from_millis(200), every: Duration::from_millis(500), max_age: MAX_AGE };

/// Moment at which the program is paused.
#[derive(Clone, Copy, Debug)]
enum Phase {
    /// The program waits for an answer, which comes during the pause and requests another value.
    Answer,
    /// The program has decided a step, and has not sent it yet.
    Decided,
}

/// Program, its device, and the errors found.
struct Lane {
    name: String,
    device: Device,
    program: Running,
    page: String,
    stalled_at: u64,
    wrong: Vec<String>,
    /// The program, and this process with the device.
    starved: [Starved; 2],
    _home: tempfile::TempDir,
}

impl Lane {
    fn new(name: String, delay: Duration) -> Lane {
        let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), delay);
        let home = tempfile::tempdir().unwrap();
        let profile = file(home.path(), "walker.toml", &device::profile(device.address(), TIMES));
        let state = home.path().join("state");
        let mut command = isotherm(home.path());
        command.arg("run").arg(profile).arg("--state").arg(state).args(["--listen", "127.0.0.1:0"]);
        let mut program = Running::start(&mut command);
        let starved = [program.id(), std::process::id()].map(Starved::of);
        let page = program.receives("page http://").replace("page http://", "");
        Lane { name, device, program, page, stalled_at: 0, wrong: Vec::new(), starved, _home: home }
    }

    /// Checks that the axis reaches the requested value.
    fn arrives(&mut self, at: i16) {
        self.device.asks(at);
        let arrived = |state: &State| (state.offset() == at).then_some(());
        for _ in 0..PATIENCE.as_secs() {
            if self.program.has_ended() {
                return self.wrong.push(format!("it has ended and cannot go to {at}"));
            }
            if self.device.wait(Duration::from_secs(1), arrived).is_some() {
                return;
            }
        }
        let offset = self.device.offset();
        self.wrong.push(format!("the axis is asked to {at} and stands at {offset} after {PATIENCE:?}"));
    }

    fn stands_still_for(&mut self, span: Duration) {
        std::thread::sleep(span);
        self.stalled_at += 1;
        self.program.resumes();
    }

    /// Pauses the program while it waits for an answer. The answer comes during the pause, and is too old when it is
    /// read.
    fn while_it_waits(&mut self, span: Duration) {
        let standing = self.device.offset();
        self.device.hold();
        let asked = |state: &State| (state.held > 0).then_some(());
        assert!(self.device.wait(PATIENCE, asked).is_some(), "{}: no temperature is asked for", self.name);
        self.program.stands_still();
        self.device.asks(standing - 5 * STEP);
        self.device.release();
        self.device.wait(PATIENCE, |state| (state.held == 0).then_some(()));
        self.device.asks(standing);
        self.stands_still_for(span);
    }

    /// Pauses the program between a reading and its write. After the pause, the write is no longer needed.
    fn while_it_is_silent(&mut self, span: Duration) {
        for _ in 0..100 {
            self.device.asks(self.device.offset() + 20 * STEP);
            let about = |state: &State| state.is_about_to_write().then_some(state.seen.len());
            let seen = self.device.wait(PATIENCE, about);
            let seen = seen.unwrap_or_else(|| panic!("{}: nothing is about to be written", self.name));
            self.program.stands_still();
            std::thread::sleep(Duration::from_millis(20));
            if self.device.state().seen.len() == seen {
                self.device.asks(self.device.offset());
                self.stands_still_for(span);
                return;
            }
            // It had sent the write before it stopped.
            self.program.resumes();
            std::thread::sleep(MAX_AGE);
        }
        panic!("{}: it was never stopped in time", self.name);
    }

    /// Number of pauses that the program reports: over its API, and on stderr after its end.
    fn has_reported(&mut self) -> (u64, usize) {
        let status = status(&self.page);
        let reported = status["event_counts"]["stood-still"].as_u64().unwrap_or_default();
        if status.is_null() {
            self.wrong.push("its page does not answer".to_owned());
        }
        if !self.program.has_ended() {
            self.program.signal("TERM");
        }
        let exit = self.program.ends_within(process::PATIENCE);
        if !exit.success() {
            self.wrong.push(format!("it ended with {exit}"));
        }
        (reported, self.program.said.iter().filter(|line| line.contains("stood still")).count())
    }

    /// Returns whether the computer kept a thread from the processor for so long that the program may report a pause.
    /// The intended wait of the thread is added to that time.
    fn was_starved(&self) -> bool {
        self.starved.iter().any(|starved| starved.longest() >= STARVED)
    }

    /// All errors, one line each. `None` if the observation is void.
    fn end(mut self) -> Option<Vec<String>> {
        let was_starved = self.was_starved();
        let (reported, said) = self.has_reported();
        if (reported, u64::try_from(said).unwrap()) != (self.stalled_at, self.stalled_at) {
            let times = self.stalled_at;
            self.wrong.push(format!("it stood still {times} times, counts {reported} and has told {said}"));
        }
        let seen = self.device.state().seen.clone();
        self.wrong.extend(device::acted_wrongly(&seen, MAX_AGE));
        if was_starved && !self.wrong.is_empty() {
            println!("{}: void, the computer was too busy: {:?}", self.name, self.wrong);
            return None;
        }
        println!("{}: {} writes, wrong: {:?}", self.name, self.device.state().writes(), self.wrong);
        if !self.wrong.is_empty() {
            println!("{}", self.program.said.join("\n"));
        }
        Some(self.wrong.into_iter().map(|what| format!("{}: {what}", self.name)).collect())
    }
}

/// Status of the program. Null if it does not answer.
fn status(page: &str) -> serde_json::Value {
    let ask = || {
        let mut stream = TcpStream::connect(page).ok()?;
        stream.set_read_timeout(Some(PATIENCE)).ok()?;
        let request = format!("GET /api/status HTTP/1.1\r\nHost: {page}\r\nConnection: close\r\n\r\n");
        stream.write_all(request.as_bytes()).ok()?;
        let mut reply = String::new();
        stream.read_to_string(&mut reply).ok()?;
        serde_json::from_str(reply.split_once("\r\n\r\n")?.1).ok()
    };
    ask().unwrap_or_default()
}

fn spans() -> Vec<Duration> {
    let Ok(text) = std::env::var("TEST_STANDS_STILL_FOR") else {
        return SPANS.map(Duration::from_secs).to_vec();
    };
    let second = |word: &str| {
        let seconds = word.trim().parse();
        Duration::from_secs(seconds.unwrap_or_else(|_| panic!("TEST_STANDS_STILL_FOR={text}: say 60,600")))
    };
    text.split(',').map(second).collect()
}

fn for_long(span: Duration, phase: Phase) -> Option<Vec<String>> {
    let mut lane = Lane::new(format!("{span:?}, {phase:?}"), Duration::ZERO);
    lane.arrives(5 * STEP);
    match phase {
        Phase::Answer => lane.while_it_waits(span),
        Phase::Decided => lane.while_it_is_silent(span),
    }
    // Everything from now on is its own action.
    std::thread::sleep(MAX_AGE);
    let standing = lane.device.offset();
    lane.arrives(standing + 3 * STEP);
    lane.arrives(standing);
    lane.end()
}

/// Pauses the program at any moment of its cycle. It requests another value each time.
fn for_short(seed: u64) -> Option<Vec<String>> {
    let mut lane = Lane::new(format!("{SHORTS} times {SHORT:?}, seed {seed}"), Duration::from_millis(20));
    let mut random = Pcg32::seed_from_u64(seed);
    let mut asked = 50 * STEP;
    lane.arrives(STEP);
    for _ in 0..SHORTS {
        lane.device.asks(asked);
        std::thread::sleep(Duration::from_millis(600 + random.random_range(0..600)));
        lane.program.stands_still();
        asked = -asked;
        // An answer that is under way still contains the value from before.
        std::thread::sleep(Duration::from_millis(60));
        lane.device.asks(asked);
        lane.stands_still_for(SHORT);
    }
    let standing = lane.device.offset();
    lane.arrives(standing + 2 * STEP);
    lane.end()
}

/// Errors of the first run that is not void. Empty if all of them are void.
fn tried(run: impl Fn() -> Option<Vec<String>>) -> Vec<String> {
    (0..TRIES).find_map(|_| run()).unwrap_or_else(|| {
        tell(&format!("a program that stands still: {TRIES} runs are void, the computer was too busy"));
        Vec::new()
    })
}

/// Runs the lanes in parallel, and collects their errors.
#[track_caller]
fn side_by_side(lanes: Vec<Box<dyn FnOnce() -> Vec<String> + Send>>) {
    let lanes: Vec<_> = lanes.into_iter().map(std::thread::spawn).collect();
    let wrong: Vec<String> = lanes.into_iter().flat_map(|lane| lane.join().unwrap()).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn however_long_it_stood_still_it_goes_on_tells_it_once_and_acts_on_nothing_of_before() {
    let phases = [Phase::Answer, Phase::Decided];
    let lanes = spans().into_iter().flat_map(|span| phases.map(|phase| (span, phase)));
    side_by_side(
        lanes.map(|(span, phase)| Box::new(move || tried(|| for_long(span, phase))) as Box<_>).collect(),
    );
}

#[test]
fn at_whatever_moment_it_stood_still_it_acts_on_nothing_of_before() {
    side_by_side((0..RUNS).map(|seed| Box::new(move || tried(|| for_short(seed))) as Box<_>).collect());
}
