//! Benchmark of 500 devices, each on a separate connection: processor time and memory of the gateway.
//!
//! Every device answers after 5 ms. The gateway reads eight of its registers ten times per second. The benchmark
//! measures two configurations:
//!
//! - One axis corrects a position of every device, as often as it is read.
//! - Each device has its own axis. The gateway writes its offset once per second, and the echo confirms it.
//!
//! The devices run in a separate process, so that only the gateway is measured. The limits:
//!
//! - No poll is missed or late.
//! - The gateway uses less than 25 % of a core and less than 40 MB.
//! - One poll with 500 devices costs at most 1.2 times as much as with 10 devices.
//! - 999 of 1000 times, the lock of the state is held for less than 50 µs, while a page reads the status twice per
//!   second.
//!
//! Run it with `cargo bench --bench fleet`. An argument sets the seconds of a measurement.

#![allow(clippy::unwrap_used, clippy::cast_precision_loss, reason = "a bench may stop where it stands")]

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::status::GatewayApi;
use isotherm_core::quantity::Moment;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

/// Response time of a device.
const DELAY: Duration = Duration::from_millis(5);
/// Polls of each device per second.
const RATE: u64 = 10;
/// Time before the measurement; connections and the first decisions are not measured.
const WARM_UP: Duration = Duration::from_secs(3);
const MOST_OF_A_CORE: f64 = 25.0;
const MOST_MEMORY_MB: f64 = 40.0;
const MOST_GROWTH: f64 = 1.2;
/// Limit of the time in seconds for which the lock may be held; it may be exceeded once in 1000 times.
const HELD: f64 = 50e-6;
const MOST_HELD_LONG: f64 = 0.001;
/// Period at which a page reads the status.
const PAGE: Duration = Duration::from_millis(500);

/// Assignment of axes to devices.
#[derive(Clone, Copy, PartialEq)]
enum Shape {
    /// One axis corrects a position of every device.
    OneAxis,
    /// Each device has an axis and an output that writes its offset.
    AxisEach,
}

impl Shape {
    fn named(name: &str) -> Shape {
        if name == "axis-each" { Shape::AxisEach } else { Shape::OneAxis }
    }

    fn name(self) -> &'static str {
        if self == Shape::AxisEach { "axis-each" } else { "one-axis" }
    }

    /// Writes to each device per second.
    fn writes(self) -> u64 {
        if self == Shape::AxisEach { 1 } else { RATE }
    }
}

/// Results for one number of devices.
struct Measured {
    devices: u64,
    reads: u64,
    writes: u64,
    wanted: u64,
    core_percent: f64,
    memory_mb: f64,
    poll_us: f64,
    failures: u64,
    late: u64,
    /// How often the state was locked, and how often for longer than the limit.
    locked: u64,
    locked_long: u64,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["serve"] => serve(),
        ["measure", shape, devices, seconds] => {
            measure(Shape::named(shape), devices.parse().unwrap(), seconds.parse().unwrap());
        }
        [] => compare("20"),
        [seconds] => compare(seconds),
        _ => panic!("fleet [SECONDS]"),
    }
}

/// Measures each number of devices in a separate process, because freed memory still counts for the process.
fn compare(seconds: &str) {
    let run = |shape: Shape, devices: u64| {
        let own = std::env::current_exe().unwrap();
        let output = Command::new(own)
            .args(["measure", shape.name(), &devices.to_string(), seconds])
            .stderr(Stdio::inherit())
            .output()
            .unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let figures: Vec<f64> =
            text.split_whitespace().map(|word| word.parse().unwrap_or_else(|_| panic!("{text}"))).collect();
        println!(
            "{}, {:>3} devices: {} reads of {}, {} writes, {} late, {} failures; {:.1} % of a core, {:.1} MB, \
             {:.1} µs a poll",
            shape.name(),
            figures[0],
            figures[1],
            figures[3],
            figures[2],
            figures[8],
            figures[7],
            figures[4],
            figures[5],
            figures[6]
        );
        figures
    };
    let span: f64 = seconds.parse().unwrap();
    for shape in [Shape::OneAxis, Shape::AxisEach] {
        let (few, many) = (run(shape, 10), run(shape, 500));
        let growth = many[6] / few[6];
        let wanted = many[0] * span * shape.writes() as f64;
        let missed = (many[3] - many[1]).max(wanted - many[2]).max(0.0);
        let verdicts = [
            (
                format!("missed {missed:.0}, limit 0 but for the two rounds at the ends"),
                missed <= 2.0 * many[0],
            ),
            (format!("{:.0} late, limit 0", many[8]), many[8] < 1.0),
            (format!("{:.1} % of a core, limit {MOST_OF_A_CORE}", many[4]), many[4] < MOST_OF_A_CORE),
            (format!("{:.1} MB, limit {MOST_MEMORY_MB}", many[5]), many[5] < MOST_MEMORY_MB),
            (format!("a poll costs {growth:.2} times as much, limit {MOST_GROWTH}"), growth <= MOST_GROWTH),
            (
                format!("locked for 50 µs or more {:.0} of {:.0} times, limit 1 in 1000", many[10], many[9]),
                many[10] <= MOST_HELD_LONG * many[9],
            ),
        ];
        for (words, is_reached) in verdicts {
            println!("{words}: {}", if is_reached { "reached" } else { "MISSED" });
        }
    }
}

/// Runs the devices. Prints the port, then for each line of input the number of reads and writes so far.
fn serve() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let counts = Arc::new((AtomicU64::new(0), AtomicU64::new(0)));
    let counted = counts.clone();
    std::thread::spawn(move || {
        for _ in std::io::stdin().lock().lines() {
            println!("{} {}", counted.0.load(Ordering::Relaxed), counted.1.load(Ordering::Relaxed));
        }
        std::process::exit(0);
    });
    runtime.block_on(async {
        let listener = TcpListener::bind("0.0.0.0:0").await.unwrap();
        let begun = Clock::wall().now();
        println!("{}", listener.local_addr().unwrap().port());
        loop {
            let (stream, _) = listener.accept().await.unwrap();
            tokio::spawn(answer(stream, counts.clone(), begun));
        }
    });
}

async fn answer(mut stream: TcpStream, counts: Arc<(AtomicU64, AtomicU64)>, begun: Moment) {
    let clock = Clock::wall();
    stream.set_nodelay(true).unwrap();
    let mut request = [0u8; 12];
    let mut stands = [0, 0];
    while stream.read_exact(&mut request).await.is_ok() {
        tokio::time::sleep(DELAY).await;
        let mut reply = request.to_vec();
        if request[7] == 4 {
            reply.truncate(8);
            reply[5] = 19;
            reply.extend_from_slice(&[16, 1, 19, 0, 240, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 4, 210]);
            // The first register is a temperature that rises or falls by 1 °C per second, between 7.5 and 47.5 °C.
            let phase = clock.now().since(begun).as_millis() % 80_000;
            let tenths = u16::try_from(phase.min(80_000 - phase) / 100).unwrap();
            reply[9..11].copy_from_slice(&(75 + tenths).to_be_bytes());
            counts.0.fetch_add(1, Ordering::Relaxed);
        } else if request[7] == 3 {
            reply.truncate(8);
            reply[5] = 5;
            reply.extend_from_slice(&[2, stands[0], stands[1]]);
        } else {
            stands.copy_from_slice(&request[10..]);
            counts.1.fetch_add(1, Ordering::Relaxed);
        }
        if stream.write_all(&reply).await.is_err() {
            return;
        }
    }
}

fn axis(name: &str, device: u64, every: &str) -> String {
    format!(
        "[axis.{name}]\nlimit = 40.0\nstep = 2.0\nrate = 2.0\nevery = \"{every}\"\n\
         on_fault = {{ action = \"hold\" }}\n[[axis.{name}.model]]\nname = \"bed\"\nkind = \"linear\"\n\
         terms = [ {{ signal = \"s{device}_0\", gain = 1.0, reference = 27.5 }} ]\n"
    )
}

fn machine(shape: Shape, devices: u64, port: u16) -> String {
    let mut text = String::from("[machine]\nname = \"fleet\"\n");
    if shape == Shape::OneAxis {
        text += &axis("z", 0, "1s");
    }
    for device in 0..devices {
        write!(
            text,
            "[bus.b{device}]\ntype = \"modbus-tcp\"\naddress = \"127.0.{}.{}:{port}\"\ntimeout = \"90ms\"\n\
             [device.d{device}]\nbus = \"b{device}\"\nunit = 1\nevery = \"100ms\"\n\
             [output.o{device}]\ndevice = \"d{device}\"\nregister = \"holding:10\"\ntype = \"i16\"\n\
             verify = \"echo\"\n",
            device / 250,
            device % 250 + 1
        )
        .unwrap();
        if shape == Shape::OneAxis {
            write!(text, "axis = \"z\"\nwrites = \"corrected\"\nposition = \"s{device}_7\"\nscale = 0.01\n")
                .unwrap();
        } else {
            write!(text, "axis = \"z{device}\"\nwrites = \"offset\"\nscale = 1.0\n").unwrap();
            text += &axis(&format!("z{device}"), device, "1s");
        }
        for register in 0..8 {
            let unit = if register == 7 { "mm" } else { "degC" };
            let scale = if register == 7 { 0.01 } else { 0.1 };
            write!(
                text,
                "[signal.s{device}_{register}]\ndevice = \"d{device}\"\nregister = \"input:{register}\"\n\
                 type = \"i16\"\nscale = {scale}\nunit = \"{unit}\"\nmax_age = \"5s\"\n"
            )
            .unwrap();
        }
    }
    text
}

/// Runs the gateway in this process, and prints the figures of [`Measured`] in one line.
fn measure(shape: Shape, devices: u64, seconds: u64) {
    let mut server = Command::new(std::env::current_exe().unwrap())
        .arg("serve")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(server.stdout.take().unwrap());
    let mut receives = move || {
        let mut line = String::new();
        said.read_line(&mut line).unwrap();
        line.trim().to_owned()
    };
    let port: u16 = receives().parse().unwrap();
    let mut asks = server.stdin.take().unwrap();
    let text = machine(shape, devices, port);
    let loaded = isotherm_profile::parse(Path::new("fleet.toml"), &text, &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    drop(text);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let measured = runtime.block_on(async move {
        let gateway = Gateway::new(profile, &Clock::wall(), Options::default());
        let source = gateway.source();
        let mut measured = None;
        // The measurement is a task of the gateway's own runtime. The axes need no input of it.
        let watching = async {
            tokio::time::sleep(WARM_UP).await;
            let mut counts = || {
                writeln!(asks).unwrap();
                let counts = receives();
                let (reads, writes) = counts.split_once(' ').unwrap();
                (reads.parse::<u64>().unwrap(), writes.parse::<u64>().unwrap())
            };
            let clock = Clock::wall();
            let begun = (clock.now(), busy(), counts(), failures(&source), late(&source));
            let held = locks(&source);
            // A page reads the status in a separate thread.
            let (asked, ended) = (source.clone(), Arc::new(AtomicBool::new(false)));
            let is_over = ended.clone();
            let page = std::thread::spawn(move || {
                while !is_over.load(Ordering::Relaxed) {
                    drop(asked.status());
                    std::thread::sleep(PAGE);
                }
            });
            tokio::time::sleep(Duration::from_secs(seconds)).await;
            ended.store(true, Ordering::Relaxed);
            let span = clock.now().since(begun.0).as_secs_f64();
            let (ended, spent) = (counts(), busy() - begun.1);
            let (reads, writes) = (ended.0 - begun.2.0, ended.1 - begun.2.1);
            measured = Some(Measured {
                devices,
                reads,
                writes,
                wanted: devices * RATE * seconds,
                core_percent: 100.0 * spent / span,
                memory_mb: memory_mb(),
                poll_us: 1e6 * spent / (reads + writes) as f64,
                failures: failures(&source) - begun.3,
                late: late(&source) - begun.4,
                locked: locks(&source).0 - held.0,
                locked_long: locks(&source).1 - held.1,
            });
            page.join().unwrap();
        };
        gateway.run(watching, std::future::ready(())).await;
        measured.unwrap()
    });
    let _ = server.kill();
    let _ = server.wait();
    println!(
        "{} {} {} {} {} {} {} {} {} {} {}",
        measured.devices,
        measured.reads,
        measured.writes,
        measured.wanted,
        measured.core_percent,
        measured.memory_mb,
        measured.poll_us,
        measured.failures,
        measured.late,
        measured.locked,
        measured.locked_long
    );
}

fn failures(source: &Arc<dyn GatewayApi>) -> u64 {
    source.status().devices.iter().flat_map(|device| device.failures.values()).sum()
}

/// Number of polls that began a whole period late.
fn late(source: &Arc<dyn GatewayApi>) -> u64 {
    source.status().buses.iter().map(|bus| bus.overruns).sum()
}

/// Returns how often the state was locked, and how often for longer than the limit.
fn locks(source: &Arc<dyn GatewayApi>) -> (u64, u64) {
    let held = source.status().lock_held;
    let count =
        |longer_than: f64| held.iter().filter(|(bound, _)| *bound > longer_than).map(|(_, n)| n).sum();
    (count(0.0), count(HELD * 1.01))
}

/// Processor time of this process, user and system, in seconds.
fn busy() -> f64 {
    let spent = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    spent.tv_sec as f64 + spent.tv_nsec as f64 * 1e-9
}

fn memory_mb() -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = text.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
}
