//! Benchmark of the gateway against bare loops on this computer. It reproduces performance claims of the manual.
//!
//! Each contender is a separate process that reads eight input registers of a device, computes, and writes one
//! register. The devices run in one more process, which counts. The reference is a loop of system calls in C. The
//! others are libmodbus, as in its manual, and tokio-modbus. They have no quality, no model, no guard, and no
//! verification of writes.
//!
//! The closed loop runs over TCP, and over RTU on a pseudo-terminal. RTU requires a silence of 1.75 ms before each
//! request at 115,200 baud. The reference and the gateway keep it. libmodbus leaves it to its caller, so it runs with
//! and without the silence.
//!
//! Run it with `cargo bench --bench peers`. An argument sets the seconds of a measurement. It requires a C compiler and
//! libmodbus-dev.

#![allow(clippy::unwrap_used, clippy::cast_precision_loss, reason = "a bench may stop where it stands")]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use isotherm::clock::Clock;

mod bare;
#[path = "../devices/mod.rs"]
mod devices;
mod fleet;
#[path = "../fleet_profile/mod.rs"]
mod fleet_profile;
mod gateway;
#[path = "../process/mod.rs"]
mod process;
mod rtu;

use devices::{Devices, server};
use fleet_profile::Work;
use process::Process;

/// Turns of the contenders of the closed loop over TCP. They are many and short, because the speed of a computer
/// changes within seconds.
const TURNS: usize = 40;
/// Turns of the contenders over RTU. Their speed depends mostly on the silence between two frames.
const RTU_TURNS: usize = 10;
const TURN: Duration = Duration::from_millis(500);
/// Time between the first write of a contender and its measurement.
const WARM_UP: Duration = Duration::from_millis(250);
const STARTS: usize = 15;
const MOST_TO_START_MS: f64 = 15.0;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["devices", delay_ms] => server::serve(Duration::from_millis(delay_ms.parse().unwrap())),
        ["rtu-device"] => rtu::serve(),
        ["tokio-modbus", port] => bare::closed_loop(port.parse().unwrap()),
        ["tasks", port, devices, period_ms, reads_only] => {
            bare::fleet(port.parse().unwrap(), &Work::of(devices, period_ms, reads_only));
        }
        ["isotherm", port] => gateway::closed_loop(port, 1),
        ["isotherm-pipelined", port] => gateway::closed_loop(port, 2),
        ["isotherm-rtu", port] => gateway::rtu(port),
        ["fleet", port, devices, period_ms, reads_only] => {
            gateway::fleet(port, &Work::of(devices, period_ms, reads_only));
        }
        [] => compare(10),
        [seconds] => compare(seconds.parse().unwrap()),
        _ => panic!("peers [SECONDS]"),
    }
}

impl Work {
    fn of(devices: &str, period_ms: &str, reads_only: &str) -> Work {
        let period = Duration::from_millis(period_ms.parse().unwrap());
        Work { devices: devices.parse().unwrap(), period, reads_only: reads_only == "1" }
    }

    fn words(&self) -> [String; 3] {
        let period = self.period.as_millis().to_string();
        [self.devices.to_string(), period, u8::from(self.reads_only).to_string()]
    }
}

fn compare(seconds: u64) {
    let loops = compiled();
    let own = std::env::current_exe().unwrap();
    let span = Duration::from_secs(seconds);
    start(&own);
    closed_loops(&own, &loops, span.min(TURN));
    fleet::fleets(&own, &loops, span);
}

/// Measures the time from the start of the process to its first write, which a read and a decision precede.
fn start(own: &Path) {
    let mut took = [0; STARTS].map(|_| {
        let mut devices = Devices::start(&["devices", "0"]);
        let begun = Clock::wall().now();
        let _contender = contender(own, "isotherm", &devices.port, &[]);
        while devices.counts().writes == 0 {}
        Clock::wall().now().since(begun).as_secs_f64() * 1e3
    });
    took.sort_by(f64::total_cmp);
    let median = took[STARTS / 2];
    let reached = if median < MOST_TO_START_MS { "reached" } else { "MISSED" };
    println!(
        "isotherm, from its start to its first write {median:.1} ms, at most {MOST_TO_START_MS}: {reached}\n"
    );
}

/// Program of the closed loop.
struct Contender<'a> {
    name: &'static str,
    program: &'a Path,
    mode: &'static str,
    /// Smallest ratio of its loops to those of the first contender; `None` without a limit.
    least: Option<f64>,
}

/// Figures of a contender in one turn.
#[derive(Clone, Copy)]
struct LoopTurn {
    /// Loops per second.
    rate: f64,
    /// Median and 99th percentile of the time from an answer of the device to the arrival of the value that depends on
    /// it.
    half_us: f64,
    most_us: f64,
    /// Processor time of one loop.
    busy_us: f64,
}

/// Measures the loops per second of each contender on one processor, in alternating turns.
fn closed_loops(own: &Path, loops: &Path, span: Duration) {
    if let Some(cores) = core_affinity::get_core_ids() {
        // Processes that are started from here inherit the processor.
        core_affinity::set_for_current(cores[0]);
    }
    let of = |name, program, mode, least| Contender { name, program, mode, least };
    let over_tcp = [
        of("blocking sockets in C: the limit", loops, "ping-pong", None),
        of("two requests in one segment, in C", loops, "pipelined", None),
        of("libmodbus", loops, "libmodbus", None),
        of("tokio-modbus", own, "tokio-modbus", None),
        of("isotherm", own, "isotherm", Some(0.90)),
        of("isotherm, pipeline = 2", own, "isotherm-pipelined", Some(1.30)),
    ];
    let turns = take_turns(&["devices", "0"], &over_tcp, TURNS, span);
    print_loops(&over_tcp, &turns);
    let ratio = ratio_of_rates(&turns[4], &turns[3]);
    let reached = if ratio > 1.0 { "reached" } else { "MISSED" };
    println!("    isotherm: {ratio:.3} of tokio-modbus, more than 1: {reached}\n");
    let over_rtu = [
        of("RTU on a pty in C: the limit", loops, "rtu", None),
        of("libmodbus without the silence", loops, "libmodbus-rtu", None),
        of("libmodbus, silence kept by its caller", loops, "libmodbus-rtu-silent", None),
        of("isotherm", own, "isotherm-rtu", None),
    ];
    print_loops(&over_rtu, &take_turns(&["rtu-device"], &over_rtu, RTU_TURNS, span));
    if let Some(cores) = core_affinity::get_core_ids() {
        core_affinity::set_for_current(*cores.last().unwrap());
    }
}

/// Runs the contenders in alternating turns, each with a new device. Returns the figures of each contender.
fn take_turns(
    device: &[&str],
    contenders: &[Contender<'_>],
    count: usize,
    span: Duration,
) -> Vec<Vec<LoopTurn>> {
    let mut turns = vec![Vec::new(); contenders.len()];
    for _ in 0..count {
        for (one, turns) in contenders.iter().zip(&mut turns) {
            let mut devices = Devices::start(device);
            let process = contender(one.program, one.mode, &devices.port, &[]);
            // The gateway waits on a new serial connection until no answer to an earlier program can arrive.
            while devices.counts().writes == 0 {
                std::thread::sleep(WARM_UP / 10);
            }
            std::thread::sleep(WARM_UP);
            let (begun, busy, before) = (Clock::wall().now(), process.busy(), devices.counts());
            std::thread::sleep(span);
            let passed = Clock::wall().now().since(begun).as_secs_f64();
            let (busy, counts) = (process.busy() - busy, devices.counts());
            let loops = (counts.writes - before.writes) as f64;
            turns.push(LoopTurn {
                rate: loops / passed,
                half_us: counts.half_us,
                most_us: counts.most_us,
                busy_us: 1e6 * busy / loops,
            });
        }
    }
    turns
}

/// Prints the medians of each contender, and its limit.
fn print_loops(contenders: &[Contender<'_>], turns: &[Vec<LoopTurn>]) {
    for (Contender { name, least, .. }, taken) in contenders.iter().zip(turns) {
        let each = |of: fn(&LoopTurn) -> f64| median(taken.iter().map(of));
        let share = ratio_of_rates(taken, &turns[0]);
        let verdict = least.map_or(String::new(), |least| {
            format!(", at least {least:.2}: {}", if share >= least { "reached" } else { "MISSED" })
        });
        println!(
            "{name:<38}{:>8.0} loops/s, {:>6.1} µs of processor time each, reaction p50 {:>6.1} µs, p99 {:>6.1}, \
             {share:.3} of the limit{verdict}",
            each(|turn| turn.rate),
            each(|turn| turn.busy_us),
            each(|turn| turn.half_us),
            each(|turn| turn.most_us)
        );
    }
}

/// Returns the median of the ratios of two contenders, each in the same turn.
fn ratio_of_rates(turns: &[LoopTurn], others: &[LoopTurn]) -> f64 {
    median(turns.iter().zip(others).map(|(one, other)| one.rate / other.rate))
}

fn median(figures: impl Iterator<Item = f64>) -> f64 {
    let mut figures: Vec<f64> = figures.collect();
    figures.sort_by(f64::total_cmp);
    figures[figures.len() / 2]
}

/// Compiles the loops in C, and returns the path of the program.
fn compiled() -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peers/loops.c");
    let program = std::env::current_exe().unwrap().with_file_name("peers-loops");
    let mut compile = Command::new("cc");
    compile.args(["-O2", "-o"]).arg(&program).arg(source).args(["-lmodbus", "-lpthread"]);
    let is_done = compile.status().is_ok_and(|status| status.success());
    assert!(is_done, "a C compiler and libmodbus are wanted: apt-get install gcc libc6-dev libmodbus-dev");
    program
}

/// Starts a contender.
fn contender(program: &Path, mode: &str, port: &str, more: &[String]) -> Process {
    Process::start(Command::new(program).arg(mode).arg(port).args(more))
}
