//! Benchmark of the gateway against bare loops on this computer. It reproduces performance claims of the manual.
//!
//! Each contender is a separate process that reads eight input registers of a device, computes, and writes one
//! register. The devices run in one more process, which counts. The reference is a loop of system calls in C. The
//! others are libmodbus, as in its manual, and tokio-modbus. They have no quality, no model, no guard, and no
//! verification of writes.
//!
//! Run it with `cargo bench --bench peers`. An argument sets the seconds of a measurement. It requires a C compiler and
//! libmodbus-dev.

#![allow(clippy::unwrap_used, clippy::cast_precision_loss, reason = "a bench may stop where it stands")]

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

use isotherm::clock::Clock;

mod bare;
mod devices;
mod fleet;
mod gateway;
#[path = "../process/mod.rs"]
mod process;

use process::Process;

/// Turns of the contenders of the closed loop. They are many and short, because the speed of a computer changes within
/// seconds.
const TURNS: usize = 40;
const TURN: Duration = Duration::from_millis(500);
const STARTS: usize = 15;
const MOST_TO_START_MS: f64 = 15.0;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["devices", delay_ms] => devices::serve(Duration::from_millis(delay_ms.parse().unwrap())),
        ["tokio-modbus", port] => bare::closed_loop(port.parse().unwrap()),
        ["tasks", port, devices, period_ms, reads_only] => {
            bare::fleet(port.parse().unwrap(), &Work::of(devices, period_ms, reads_only));
        }
        ["isotherm", port] => gateway::closed_loop(port.parse().unwrap(), 1),
        ["isotherm-pipelined", port] => gateway::closed_loop(port.parse().unwrap(), 2),
        ["fleet", port, devices, period_ms, reads_only] => {
            gateway::fleet(port.parse().unwrap(), &Work::of(devices, period_ms, reads_only));
        }
        [] => compare(10),
        [seconds] => compare(seconds.parse().unwrap()),
        _ => panic!("peers [SECONDS]"),
    }
}

/// Work with many devices.
struct Work {
    devices: u16,
    period: Duration,
    reads_only: bool,
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
        let mut devices = Devices::start(own, 0);
        let begun = Clock::wall().now();
        let _contender = contender(own, "isotherm", devices.port, &[]);
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

/// Measures the loops per second of each contender on one processor, in alternating turns. Measures also the time from
/// the answer of the device to the arrival of the value that depends on it.
fn closed_loops(own: &Path, loops: &Path, span: Duration) {
    if let Some(cores) = core_affinity::get_core_ids() {
        // Processes that are started from here inherit the processor.
        core_affinity::set_for_current(cores[0]);
    }
    let contenders = [
        ("blocking sockets in C: the limit", loops, "ping-pong", None),
        ("two requests in one segment, in C", loops, "pipelined", None),
        ("libmodbus", loops, "libmodbus", None),
        ("tokio-modbus", own, "tokio-modbus", None),
        ("isotherm", own, "isotherm", Some(0.90)),
        ("isotherm, pipeline = 2", own, "isotherm-pipelined", Some(1.30)),
    ];
    let mut turns = contenders.map(|_| Vec::new());
    for _ in 0..TURNS {
        for ((_, program, mode, _), turns) in contenders.iter().zip(&mut turns) {
            let mut devices = Devices::start(own, 0);
            let _contender = contender(program, mode, devices.port, &[]);
            std::thread::sleep(Duration::from_millis(250));
            let (begun, before) = (Clock::wall().now(), devices.counts());
            std::thread::sleep(span);
            let passed = Clock::wall().now().since(begun).as_secs_f64();
            let counts = devices.counts();
            turns.push([(counts.writes - before.writes) as f64 / passed, counts.half_us, counts.most_us]);
        }
    }
    let median = |turns: &[[f64; 3]], of: usize| {
        let mut figures: Vec<f64> = turns.iter().map(|turn| turn[of]).collect();
        figures.sort_by(f64::total_cmp);
        figures[figures.len() / 2]
    };
    for ((name, .., least), taken) in contenders.iter().zip(&turns) {
        let [rate, half, most] = [0, 1, 2].map(|of| median(taken, of));
        // Ratio to the turn of the reference program directly before.
        let shares: Vec<[f64; 3]> =
            taken.iter().zip(&turns[0]).map(|(one, limit)| [one[0] / limit[0], 0.0, 0.0]).collect();
        let share = median(&shares, 0);
        let verdict = least.map_or(String::new(), |least| {
            format!(", at least {least:.2}: {}", if share >= least { "reached" } else { "MISSED" })
        });
        println!(
            "{name:<36}{rate:>8.0} loops/s, reaction p50 {half:>6.1} µs, p99 {most:>6.1}, {share:.3} of the limit{verdict}"
        );
    }
    if let Some(cores) = core_affinity::get_core_ids() {
        core_affinity::set_for_current(*cores.last().unwrap());
    }
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
fn contender(program: &Path, mode: &str, port: u16, more: &[String]) -> Process {
    Process::start(Command::new(program).arg(mode).arg(port.to_string()).args(more))
}

/// The process of the devices.
struct Devices {
    process: Child,
    asks: ChildStdin,
    said: BufReader<ChildStdout>,
    port: u16,
}

impl Devices {
    fn start(own: &Path, delay_ms: u64) -> Devices {
        let mut process = Command::new(own)
            .args(["devices", &delay_ms.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (asks, said) = (process.stdin.take().unwrap(), process.stdout.take().unwrap());
        let mut devices = Devices { process, asks, said: BufReader::new(said), port: 0 };
        devices.port = devices.receives().parse().unwrap();
        devices
    }

    fn receives(&mut self) -> String {
        let mut line = String::new();
        self.said.read_line(&mut line).unwrap();
        line.trim().to_owned()
    }

    fn counts(&mut self) -> Counts {
        writeln!(self.asks).unwrap();
        let counts: Vec<u64> = self.receives().split(' ').map(|count| count.parse().unwrap()).collect();
        let [reads, writes, half, most] = counts[..] else { panic!("four counts") };
        Counts { reads, writes, half_us: half as f64 / 1e3, most_us: most as f64 / 1e3 }
    }
}

/// Reads and writes so far, and the median and the 99th percentile of the reaction time since the last request.
struct Counts {
    reads: u64,
    writes: u64,
    half_us: f64,
    most_us: f64,
}

impl Drop for Devices {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
