//! The computer stands still, and goes on: the program is stopped by SIGSTOP for seconds and minutes, while it waits for
//! an answer, between a reading and its write, and at any moment. It goes on, tells it once, and acts on nothing that is
//! older than `max_age`.
//!
//! A computer that is too busy stands still as well, and the program says so. What it says more often than it was stopped is
//! void where the kernel's own account has a thread of it, or of the device, kept waiting for so long; then it is tried again.
//!
//! `TEST_STANDS_STILL_FOR=60,600` names other spans, in seconds; `tests/run long` does these.
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

/// How long it stands still where nothing else is asked for, s.
const SPANS: [u64; 2] = [5, 14];
/// A short while, longer than any reading lives.
const SHORT: Duration = Duration::from_millis(1200);
/// Short whiles of one run, and runs side by side.
const SHORTS: usize = 5;
const RUNS: u64 = 2;
/// How long the axis has to go on.
const PATIENCE: Duration = Duration::from_secs(60);
const MAX_AGE: Duration = Duration::from_secs(1);
/// A thread that waits so long for a processor makes a gap of a second together with what it meant to wait.
const STARVED: Duration = Duration::from_millis(300);
/// How often a run is tried whose observation is void.
const TRIES: usize = 4;
const TIMES: Times =
    Times { timeout: Duration::from_millis(200), every: Duration::from_millis(500), max_age: MAX_AGE };

/// When it is made to stand still.
#[derive(Clone, Copy, Debug)]
enum Phase {
    /// It waits for an answer, which comes while it stands still and asks for something else.
    Answer,
    /// It has decided a step and is silent before it sends it.
    Decided,
}

/// A program, its device, and what was wrong.
struct Lane {
    name: String,
    device: Device,
    program: Running,
    page: String,
    stood_still: u64,
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
        let page = program.hears("page http://").replace("page http://", "");
        Lane { name, device, program, page, stood_still: 0, wrong: Vec::new(), starved, _home: home }
    }

    /// The axis comes to where it is asked to go.
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
        self.stood_still += 1;
        self.program.goes_on();
    }

    /// Stopped while it waits for an answer: that comes meanwhile, and is of the past when it is found.
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

    /// Stopped between a reading and the write that it asked for: there is nothing to be written any more.
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
            // It had sent it before it stopped.
            self.program.goes_on();
            std::thread::sleep(MAX_AGE);
        }
        panic!("{}: it was never stopped in time", self.name);
    }

    /// How often it says that it stood still: to a program that asks, and on stderr once it has ended.
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

    /// Whether the computer kept a thread from the processor for so long that the program may call it a standstill, together with
    /// what it waits for itself.
    fn was_starved(&self) -> bool {
        self.starved.iter().any(|starved| starved.longest() >= STARVED)
    }

    /// Everything that was wrong, a line each; `None` where the observation is void.
    fn end(mut self) -> Option<Vec<String>> {
        let was_starved = self.was_starved();
        let (reported, said) = self.has_reported();
        if (reported, u64::try_from(said).unwrap()) != (self.stood_still, self.stood_still) {
            let times = self.stood_still;
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

/// What the program tells of itself; nothing where it does not.
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
    // What it does now, it does by itself.
    std::thread::sleep(MAX_AGE);
    let standing = lane.device.offset();
    lane.arrives(standing + 3 * STEP);
    lane.arrives(standing);
    lane.end()
}

/// At any moment of its cycle; what it is asked for is another thing each time.
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
        // An answer that is under way is still one of before.
        std::thread::sleep(Duration::from_millis(60));
        lane.device.asks(asked);
        lane.stands_still_for(SHORT);
    }
    let standing = lane.device.offset();
    lane.arrives(standing + 2 * STEP);
    lane.end()
}

/// What was wrong in the first run that is not void; nothing where all of them are.
fn tried(run: impl Fn() -> Option<Vec<String>>) -> Vec<String> {
    (0..TRIES).find_map(|_| run()).unwrap_or_else(|| {
        tell(&format!("a program that stands still: {TRIES} runs are void, the computer was too busy"));
        Vec::new()
    })
}

/// Runs them side by side; each tells what was wrong.
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
