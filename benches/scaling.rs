//! Benchmark of a gateway with 5,000 devices, compared with the same gateway with 500.
//!
//! `isotherm run` is a separate process here, as on a machine, with its web page, state and logs. The devices run in
//! one more process, each on its own loopback address. Each device has a line and an axis, and is polled once per
//! second. The limits:
//!
//! - No poll is late, and no request fails.
//! - One of 5,000 devices costs at most 1.2 times the processor time and memory of one of 500.
//! - `check` accepts the profile of 5,000 devices within one second.
//! - The web page answers within 100 ms: its file, and the first figures of its live stream.
//! - A gateway with 500 devices of eight signals, polled ten times per second, has 14 MB of memory.
//!
//! Run it with `cargo bench --features full --bench scaling`, because packages have all features. An argument sets the
//! seconds of a measurement. It requires 6,000 file descriptors (`ulimit -Hn`).

#![allow(clippy::unwrap_used, clippy::cast_precision_loss, reason = "a bench may stop where it stands")]

use std::process::{Command, Stdio};
use std::time::Duration;

use isotherm::clock::Clock;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serde_json::Value;

#[path = "devices/mod.rs"]
mod devices;
#[path = "fleet_profile/mod.rs"]
mod fleet_profile;
#[path = "process/mod.rs"]
mod process;
#[path = "program/mod.rs"]
mod program;

use devices::{Counts, Devices, server};
use fleet_profile::{REGISTERS, Work};
use program::{PROGRAM, Running, Written};

const FEW: u16 = 500;
const MANY: u16 = 5_000;
/// Registers with a signal: two temperatures and the position. The gateway reads those between them too.
const SIGNALS: [u16; 3] = [0, 1, 7];
/// Turns of both gateways.
const TURNS: usize = 3;
/// Longest time until each device has been read twice.
const START: Duration = Duration::from_secs(120);
/// Time between the start and the measurement, in which the gateway saves its first states.
const WARM_UP: Duration = Duration::from_secs(10);
/// Number of file descriptors for the connections of [`MANY`] devices, the page and the files.
const DESCRIPTORS: u64 = 6_000;
/// Number of requests for each figure of the page, and of calls of `check`.
const REPEATS: usize = 5;

const MOST_GROWTH: f64 = 1.2;
const MOST_CHECK_S: f64 = 1.0;
const MOST_PAGE_MS: f64 = 100.0;
const MOST_MEMORY_MB: f64 = 14.0;

/// Figures of one gateway in one turn.
struct Turn {
    /// Processor time of one device per second.
    busy_us: f64,
    /// Memory of the gateway before the first request for its page.
    memory_mb: f64,
    /// Memory of one device.
    memory_kb: f64,
    /// Polls that began a whole period late, and failed requests.
    late: f64,
    failed: f64,
    /// Reads as a share of the expected number; `writes` likewise.
    reads: f64,
    writes: f64,
    /// Time until the front page was complete, and until the live stream had sent its first figures.
    front_ms: f64,
    live_ms: f64,
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["devices", delay_ms] => server::serve(Duration::from_millis(delay_ms.parse().unwrap())),
        [] => compare(Duration::from_secs(10)),
        [seconds] => compare(Duration::from_secs(seconds.parse().unwrap())),
        _ => panic!("scaling [SECONDS]"),
    }
}

fn compare(span: Duration) {
    let limit = getrlimit(Resource::Nofile);
    assert!(
        limit.maximum.is_none_or(|most| most >= DESCRIPTORS),
        "{DESCRIPTORS} file descriptors are required: raise the hard limit (ulimit -Hn)"
    );
    // Gateway and devices inherit the limit.
    setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit }).unwrap();
    for (name, reads_only) in [("read and write, 1 Hz", false), ("read only, 1 Hz", true)] {
        let work = |devices| Work { devices, period: Duration::from_secs(1), reads_only };
        let (mut few, mut many) = (Vec::new(), Vec::new());
        for _ in 0..TURNS {
            few.push(turn(&work(FEW), &SIGNALS, span));
            many.push(turn(&work(MANY), &SIGNALS, span));
        }
        println!("{name}");
        print_turns(FEW, &few);
        print_turns(MANY, &many);
        judge(&few, &many);
    }
    let check = median(
        (0..REPEATS)
            .map(|_| check(&Work { devices: MANY, period: Duration::from_secs(1), reads_only: false })),
    );
    print_verdict(
        &format!("check of {MANY} devices {check:.2} s, limit {MOST_CHECK_S}"),
        check <= MOST_CHECK_S,
    );
    let work = Work { devices: FEW, period: Duration::from_millis(100), reads_only: false };
    let memory = turn(&work, &REGISTERS, span).memory_mb;
    print_verdict(
        &format!("{FEW} devices of eight signals, 10 Hz: {memory:.1} MB, limit {MOST_MEMORY_MB}"),
        memory <= MOST_MEMORY_MB,
    );
}

fn print_turns(devices: u16, turns: &[Turn]) {
    let each = |of: fn(&Turn) -> f64| median(turns.iter().map(of));
    println!(
        "{devices:>6} devices: {:>6.1} µs of processor time a second for each, {:>5.1} kB for each, {:>6.1} MB, {:.1} % \
         of the reads and {:.1} % of the writes, {:.0} late, {:.0} failed, page {:.1} ms, figures {:.1} ms",
        each(|turn| turn.busy_us),
        each(|turn| turn.memory_kb),
        each(|turn| turn.memory_mb),
        each(|turn| 100.0 * turn.reads),
        each(|turn| 100.0 * turn.writes),
        each(|turn| turn.late),
        each(|turn| turn.failed),
        each(|turn| turn.front_ms),
        each(|turn| turn.live_ms)
    );
}

fn judge(few: &[Turn], many: &[Turn]) {
    // Ratio to the turn directly before.
    let growth = |of: fn(&Turn) -> f64| median(many.iter().zip(few).map(|(many, few)| of(many) / of(few)));
    let most = |of: fn(&Turn) -> f64| many.iter().map(of).fold(0.0, f64::max);
    let (busy, memory) = (growth(|turn| turn.busy_us), growth(|turn| turn.memory_kb));
    let (late, failed) = (most(|turn| turn.late), most(|turn| turn.failed));
    let each = |of: fn(&Turn) -> f64| median(many.iter().map(of));
    let (front, live) = (each(|turn| turn.front_ms), each(|turn| turn.live_ms));
    for (words, is_reached) in [
        (format!("{late:.0} late, limit 0"), late < 1.0),
        (format!("{failed:.0} failed, limit 0"), failed < 1.0),
        (format!("processor time of a device {busy:.2} times, limit {MOST_GROWTH}"), busy <= MOST_GROWTH),
        (format!("memory of a device {memory:.2} times, limit {MOST_GROWTH}"), memory <= MOST_GROWTH),
        (format!("front page {front:.1} ms, limit {MOST_PAGE_MS}"), front <= MOST_PAGE_MS),
        (format!("first figures of the page {live:.1} ms, limit {MOST_PAGE_MS}"), live <= MOST_PAGE_MS),
    ] {
        print_verdict(&words, is_reached);
    }
}

fn print_verdict(words: &str, is_reached: bool) {
    println!("    {words}: {}", if is_reached { "reached" } else { "MISSED" });
}

/// Measures a gateway with these registers as signals.
fn turn(work: &Work, signals: &[u16], span: Duration) -> Turn {
    let mut devices = Devices::start(&["devices", "5"]);
    let port = devices.port.clone();
    let gateway = Running::start(&profile(work, signals, &port));
    let clock = Clock::wall();
    let begun = clock.now();
    while devices.counts().reads < 2 * u64::from(work.devices) {
        assert!(clock.now().since(begun) < START, "not each device was read: {}", gateway.log());
        std::thread::sleep(Duration::from_millis(100));
    }
    std::thread::sleep(WARM_UP);
    let memory_mb = gateway.process.memory_mb();
    let before = Troubles::of(&gateway);
    // The gateway has then released the memory of that answer.
    std::thread::sleep(Duration::from_secs(2));
    let (begun, busy, counts) = (clock.now(), gateway.process.busy(), devices.counts());
    std::thread::sleep(span);
    let passed = clock.now().since(begun).as_secs_f64();
    let busy = gateway.process.busy() - busy;
    let Counts { reads, writes, .. } = devices.counts();
    let after = Troubles::of(&gateway);
    let number = f64::from(work.devices);
    let expected = number * passed / work.period.as_secs_f64();
    let page = |path: &str| {
        let took = |_| {
            let begun = clock.now();
            gateway.get(path);
            1e3 * clock.now().since(begun).as_secs_f64()
        };
        median((0..REPEATS).map(took))
    };
    Turn {
        busy_us: 1e6 * busy / passed / number,
        memory_mb,
        memory_kb: 1024.0 * memory_mb / number,
        late: after.late - before.late,
        failed: after.failed - before.failed,
        reads: (reads - counts.reads) as f64 / expected,
        writes: (writes - counts.writes) as f64 / expected,
        front_ms: page("/"),
        live_ms: page("/api/live"),
    }
}

/// Profile of these devices. A profile may have 4 MB, so it has no blanks around its equals signs.
fn profile(work: &Work, signals: &[u16], port: &str) -> String {
    work.profile(signals, |device| fleet_profile::tcp(device, port)).replace(" = ", "=")
}

/// Measures the time in seconds that `check` takes for the profile of these devices.
fn check(work: &Work) -> f64 {
    let written = Written::new(&profile(work, &SIGNALS, "502"));
    let mut command = Command::new(PROGRAM);
    command.arg("check").arg(&written.path).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let clock = Clock::wall();
    let begun = clock.now();
    let status = command.status().unwrap();
    let took = clock.now().since(begun).as_secs_f64();
    assert!(status.success(), "the profile is wrong");
    took
}

/// Late polls and failed requests since the start.
struct Troubles {
    late: f64,
    failed: f64,
}

impl Troubles {
    fn of(gateway: &Running) -> Troubles {
        let status = gateway.status();
        let late = |bus: &Value| bus["overruns"].as_f64().unwrap();
        let failed = |device: &Value| -> f64 {
            device["failures"].as_object().unwrap().values().filter_map(Value::as_f64).sum()
        };
        let (buses, devices) = (status["buses"].as_array().unwrap(), status["devices"].as_array().unwrap());
        Troubles { late: buses.iter().map(late).sum(), failed: devices.iter().map(failed).sum() }
    }
}

fn median(figures: impl Iterator<Item = f64>) -> f64 {
    let mut figures: Vec<f64> = figures.collect();
    figures.sort_by(f64::total_cmp);
    figures[figures.len() / 2]
}
