//! Test of a gateway with a server that is killed, loses sessions, stops answering and sends wrong times.
//!
//! The test runs for as long as `TEST_OPCUA_SECONDS` says. The gateway also reads 500 more nodes ten times a second. A
//! judge knows only the journal of the server: values, requests and times. The judge checks every write against the
//! rules of an output.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

use super::gateway::{beside, events, wait_until};
use super::held::wait;
use super::rig::{Server, subscribing};
use crate::support::starved::Starved;
use isotherm::clock::Clock;
use isotherm::gateway::Options;
use isotherm::observe::status::Status;

/// Duration in `tests/run`; `tests/run long` sets an hour.
const SECONDS: u64 = 40;
/// Limit and step of the output, in counts.
const LIMIT: f64 = 400.0;
const STEP: f64 = 10.0;
/// Greatest age in seconds of the server values on which a change may depend. It is `max_age`, plus the time of a
/// reading, a decision and a write.
const WINDOW: f64 = 2.0 + 1.5;
/// Longest permitted interval in seconds. The gateway reads the output every 0.2 s, and the heartbeat counts every 0.5
/// s.
const LATE: f64 = 3.0;
/// Time in seconds after an interruption until the gateway works normally again.
const RESUMED: f64 = 15.0;
/// Number of nodes that are read in addition to the machine, ten times a second.
const MANY: usize = 500;

fn seconds() -> u64 {
    let Ok(text) = std::env::var("TEST_OPCUA_SECONDS") else { return SECONDS };
    text.parse().unwrap_or_else(|_| panic!("TEST_OPCUA_SECONDS={text}: say 3600"))
}

/// Fault of the server.
#[derive(Clone, Copy, Debug)]
enum Trouble {
    Killed,
    Gone,
    SessionLost,
    SubscriptionLost,
    Silent,
    Bad,
    Behind,
    Ahead,
    AnswersLate,
}

const TROUBLES: [Trouble; 9] = [
    Trouble::SubscriptionLost,
    Trouble::Killed,
    Trouble::Behind,
    Trouble::SessionLost,
    Trouble::Bad,
    Trouble::AnswersLate,
    Trouble::Silent,
    Trouble::Ahead,
    Trouble::Gone,
];

/// Random numbers, the same again for the same seed.
struct Chance(u64);

impl Chance {
    /// Returns a number below `most`.
    fn below(&mut self, most: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % most
    }
}

fn pause(seconds: u64) {
    std::thread::sleep(Duration::from_secs(seconds));
}

fn befalls(trouble: Trouble, mut server: Server, arguments: &[&str]) -> Server {
    let for_a_while = |server: &mut Server, begins: &str, ends: &str| {
        server.does(begins);
        pause(4);
        server.does(ends);
    };
    match trouble {
        Trouble::Killed => return server.dies(arguments),
        Trouble::Gone => return server.dies_for(Duration::from_secs(4), arguments),
        Trouble::SessionLost => drop(server.does("drop")),
        Trouble::SubscriptionLost => drop(server.does("forget")),
        Trouble::Silent => for_a_while(&mut server, "silent on", "silent off"),
        Trouble::Bad => for_a_while(&mut server, "status bed BadSensorFailure", "status bed Good"),
        Trouble::Behind => for_a_while(&mut server, "stamp bed -3600", "stamp bed 0"),
        Trouble::Ahead => for_a_while(&mut server, "stamp bed 3600", "stamp bed 0"),
        Trouble::AnswersLate => drop(server.does("hold offset 1.3")),
    }
    server
}

/// State of the server, from its journal, and the checks of each write.
#[derive(Default)]
struct Judge {
    /// Expected offset in counts, with its start; `None` while no value is valid.
    wanted: Vec<(f64, Option<f64>)>,
    bed: f64,
    is_good: bool,
    is_on_time: bool,
    /// Whether the output was read since the last write.
    was_read: bool,
    read: Regular,
    beat: Regular,
    /// Last value of the heartbeat, since the last start of the server.
    beats: Option<f64>,
    /// End of the time in which an interruption excuses delays.
    excused: f64,
    writes: usize,
    wrong: Vec<String>,
    /// Time that a busy computer may add to each interval.
    slack: f64,
}

/// Repeated event, with its last time.
#[derive(Default)]
struct Regular(Option<f64>);

impl Regular {
    /// Records the event. Returns whether it is late.
    fn comes(&mut self, at: f64, excused: f64, slack: f64) -> bool {
        let last = self.0.replace(at);
        last.is_some_and(|last| at - last.max(excused) > LATE + slack)
    }
}

impl Judge {
    fn receives(&mut self, line: &str) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |place: usize| words[place].parse::<f64>().unwrap();
        match words[1..] {
            ["start"] => {
                (self.bed, self.is_good, self.is_on_time) = (20.0, true, true);
                (self.was_read, self.beats, self.excused) = (false, None, number(0) + RESUMED);
            }
            ["drop" | "forget"] | ["hold", ..] => {
                self.excused = number(0) + RESUMED;
                return;
            }
            ["read", "offset"] => {
                self.was_read = true;
                if self.read.comes(number(0), self.excused, self.slack) {
                    self.wrong.push(format!("looked at too seldom: {line}"));
                }
                return;
            }
            ["write", "life", ..] => return self.beats(line, number(0), number(4)),
            ["value", "bed", _] => self.bed = number(3),
            ["status", "bed", status] => self.is_good = status == "Good",
            ["stamp", "bed", _] => self.is_on_time = number(3).abs() < 1.0,
            ["write", "offset", ..] => return self.judges(line, number(0), number(3), number(4)),
            _ => return,
        }
        let wanted = (self.is_good && self.is_on_time).then_some((self.bed - 20.0) * 10.0);
        self.wanted.push((number(0), wanted));
    }

    /// Checks a write of `after` over `before` at this time.
    fn judges(&mut self, line: &str, at: f64, before: f64, after: f64) {
        self.writes += 1;
        let mut say = |what: &str| self.wrong.push(format!("{what}: {line}"));
        if after.abs() > LIMIT {
            say("beyond the limit");
        }
        if (after - before).abs() > STEP {
            say("more than a step");
        }
        if !std::mem::take(&mut self.was_read) {
            say("nobody has looked since the last write");
        }
        if after.to_bits() == before.to_bits() {
            return;
        }
        // The value at the start of the window counts as well.
        let begins = at - WINDOW - self.slack;
        let first = self.wanted.iter().rposition(|(since, _)| *since <= begins).unwrap_or(0);
        let wanted = self.wanted[first..].iter().filter_map(|(_, wanted)| *wanted);
        let (low, high) = wanted.fold((before, before), |(low, high), one| (low.min(one), high.max(one)));
        if !(low - 1.0..=high + 1.0).contains(&after) {
            say("away from everything that the server has held lately");
        }
    }

    /// Checks that the heartbeat counts up in every state. A value whose answer was lost is sent again. After an
    /// interruption, values may be missing.
    fn beats(&mut self, line: &str, at: f64, beat: f64) {
        let before = self.beats.replace(beat);
        if before == Some(beat) {
            return;
        }
        if self.beat.comes(at, self.excused, self.slack) {
            self.wrong.push(format!("the heartbeat stood still: {line}"));
        }
        if before.is_some_and(|before| !(1.0..=1.0 + RESUMED / 0.5).contains(&(beat - before))) {
            self.wrong.push(format!("no beat after {before:?}: {line}"));
        }
    }
}

#[test]
fn whatever_becomes_of_the_server_each_write_is_one_that_it_could_expect() {
    let directory = tempfile::tempdir().unwrap();
    let journal = directory.path().join("journal");
    let journaled = ["--journal".to_owned(), journal.display().to_string()];
    let arguments = [journaled, ["--many".to_owned(), MANY.to_string()]].concat();
    let (text, slack) = std::thread::spawn(move || storm(&arguments)).join().unwrap();
    let assess = assessed(&journal, slack);
    println!("{text}; {} writes, {} against the rules", assess.writes, assess.wrong.len());
    println!("kept from the processor for {slack:.1} s");
    assert!(assess.writes >= 5, "nothing to judge: {}", assess.writes);
    assert!(assess.wrong.is_empty(), "{:#?}", assess.wrong);
}

#[test]
fn the_judge_notices_what_breaks_a_rule() {
    let wrong = |lines: &[&str]| {
        let mut assess = Judge::default();
        lines.iter().for_each(|line| assess.receives(line));
        assess.wrong.len()
    };
    let warm = |line: &str| wrong(&["0 start", "10 value bed 22", "10 read offset", line]);
    assert_eq!(warm("11 write offset 0 10"), 0);
    assert_eq!(warm("11 write offset 0 11"), 1, "more than a step");
    assert_eq!(warm("11 write offset 400 405"), 2, "beyond the limit, and away from everything");
    assert_eq!(warm("20 write offset 20 10"), 1, "what it held ten seconds ago");
    let bad = [
        "0 start",
        "10 value bed 22",
        "11 status bed BadSensorFailure",
        "20 read offset",
        "20 write offset 0 10",
    ];
    assert_eq!(wrong(&bad), 1, "nothing could be believed");
    let twice =
        ["0 start", "10 value bed 22", "10 read offset", "11 write offset 0 10", "12 write offset 10 20"];
    assert_eq!(wrong(&twice), 1, "nobody has looked between them");
    assert_eq!(wrong(&["0 start", "20 read offset", "24 read offset"]), 1, "looked at too seldom");
    assert_eq!(wrong(&["0 start", "20 read offset", "21 drop", "38 read offset"]), 0, "the session was lost");
    assert_eq!(wrong(&["0 start", "20 write life 0 4", "21 write life 4 6"]), 0, "one did not arrive");
    assert_eq!(wrong(&["0 start", "20 write life 0 4", "21 write life 4 3"]), 1, "an older beat");
    let again = ["0 start", "20 write life 0 4", "20.5 write life 4 4", "21 write life 4 5"];
    assert_eq!(wrong(&again), 0, "its answer was lost");
    let stands = ["0 start", "20 write life 0 4", "22 write life 4 4", "24 write life 4 5"];
    assert_eq!(wrong(&stands), 1, "always the same");
    assert_eq!(wrong(&["0 start", "20 write life 0 4", "24 write life 4 5"]), 1, "it stood still");
}

fn assessed(journal: &Path, slack: f64) -> Judge {
    let mut assess = Judge { slack, ..Judge::default() };
    std::fs::read_to_string(journal).unwrap().lines().for_each(|line| assess.receives(line));
    assess
}

/// Causes one fault after another, and waits after each until everything is right. Returns a summary, and the longest
/// waits of gateway and server for a processor, added, in seconds.
fn storm(arguments: &[String]) -> (String, f64) {
    let arguments: Vec<String> = arguments.to_vec();
    let server = Server::start(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let text = subscribing(server.port) + &beside_it();
    let clock = Clock::wall();
    let (tell, reported) = std::sync::mpsc::channel();
    let status = beside(&text, Options::default(), move |source| {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let (mut server, mut chance) = (server, Chance(7));
        let (begun, mut troubles) = (clock.now(), 0);
        let gateway = Starved::of(std::process::id());
        let mut servers = Starved::of(server.id());
        let mut longest = Duration::ZERO;
        while clock.now().since(begun).as_secs() < seconds() {
            let trouble = TROUBLES[troubles % TROUBLES.len()];
            longest = longest.max(servers.longest());
            server = befalls(trouble, server, &arguments);
            longest = longest.max(servers.longest());
            servers = Starved::of(server.id());
            troubles += 1;
            // One degree is one micrometre, which is ten counts.
            let tenths = chance.below(40);
            server.does(&format!("value bed {}", 20.0 + f64::from(u32::try_from(tenths).unwrap()) / 10.0));
            let wanted = tenths.to_string();
            wait(&mut server, |server| server.does("read offset") == wanted);
            // Signals on which the offset does not depend may be read again later.
            wait_until(source, "all is well", |status| goods(status) == 2 + MANY);
        }
        longest = longest.max(servers.longest());
        let _ = tell.send((troubles, clock.now().since(begun), gateway.longest() + longest));
    });
    let (troubles, span, starved) = reported.recv().unwrap();
    let count = events(&status).len();
    let text = format!("{troubles} troubles in {:.0} s, {count} events", span.as_secs_f64());
    (text, starved.as_secs_f64())
}

fn goods(status: &Status) -> usize {
    status.signals.iter().filter(|signal| signal.quality == "good").count()
}

/// Returns a heartbeat, and the nodes to read in addition to the machine.
fn beside_it() -> String {
    let mut text = String::from(
        "[heartbeat]\ndevice = \"cnc\"\nnode = \"ns=2;s=life\"\ntype = \"i16\"\nevery = \"500ms\"\n\
         [device.many]\nbus = \"control\"\nevery = \"100ms\"\nsource_time = \"changed\"\n",
    );
    for place in 0..MANY {
        let node = format!("device = \"many\"\nnode = \"ns=2;s=many{place}\"\n");
        write!(text, "[signal.many{place}]\n{node}unit = \"degC\"\nmax_age = \"5s\"\n").unwrap();
    }
    text
}
