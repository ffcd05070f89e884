//! Benchmark of the program's own time per poll, over in-memory sockets.
//!
//! A poll reads eight registers, steps an axis, and writes one register if the work is not read only. The server is a
//! task in the same process, so no system call for a socket is part of the time. The benchmark counts the processor
//! time of the process, and divides it by the number of polls. Three contenders take alternating turns:
//!
//! - The bytes alone: requests and answers of constant content. This is the cost of server, sockets and scheduler.
//! - tokio-modbus, as in its examples.
//! - The gateway: line task, Modbus TCP, axis and output.
//!
//! The own time of a contender is its time without that of the bytes alone.
//!
//! Run it with `cargo bench --bench poll`. With arguments, it runs one contender for a number of polls, for example
//! below perf or cachegrind: `poll isotherm 500-write 20000`.

#![allow(clippy::unwrap_used, clippy::cast_precision_loss, reason = "a bench may stop where it stands")]

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::fieldbus::connection::{Connection, Dial};
use isotherm::fieldbus::error::Fault;
use isotherm::fieldbus::kinds::modbus::tcp::ModbusTcp;
use isotherm::fieldbus::trace::Tap;
use isotherm::fieldbus::wire::Boxed;
use isotherm::gateway::{Gateway, Options, Pace};
use isotherm_profile::Bus;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};
use tokio::time::{Interval, interval, sleep};
use tokio_modbus::client::{Context, Reader, Writer, tcp};
use tokio_modbus::slave::Slave;

#[path = "fleet_profile/mod.rs"]
mod fleet_profile;

use fleet_profile::{REGISTERS, Work};

const REQUEST: usize = 12;
/// Length of the answer to a read of eight registers.
const READ_ANSWER: usize = 25;

/// Turns of each contender.
const TURNS: usize = 5;
/// Time before the measurement. It excludes connections and the first decisions.
const WARM_UP: Duration = Duration::from_millis(500);
/// Interval at which the measurement checks the number of polls.
const CHECK: Duration = Duration::from_millis(20);

/// Lines that are polled together.
struct Load {
    name: &'static str,
    /// Argument that selects this load.
    word: &'static str,
    work: Work,
    /// Whether each line is polled without pauses, instead of once per period.
    is_closed_loop: bool,
    /// Polls of one turn.
    polls: u64,
}

#[derive(Clone, Copy)]
enum Contender {
    Bytes,
    TokioModbus,
    Isotherm,
}

const CONTENDERS: [(&str, Contender); 3] = [
    ("bytes", Contender::Bytes),
    ("tokio-modbus", Contender::TokioModbus),
    ("isotherm", Contender::Isotherm),
];

fn loads() -> [Load; 4] {
    let load = |name, word, devices, reads_only| {
        let work = Work { devices, period: Duration::from_millis(100), reads_only };
        let is_closed_loop = devices == 1;
        Load { name, word, work, is_closed_loop, polls: if is_closed_loop { 200_000 } else { 10_000 } }
    };
    [
        load("one line without pauses, read only", "1-read", 1, true),
        load("one line without pauses, read and write", "1-write", 1, false),
        load("500 lines, 10 Hz, read only", "500-read", 500, true),
        load("500 lines, 10 Hz, read and write", "500-write", 500, false),
    ]
}

fn main() {
    if let Some(cores) = core_affinity::get_core_ids() {
        // New threads inherit the processor.
        core_affinity::set_for_current(cores[0]);
    }
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [] => compare(),
        [contender, load, polls] => {
            let (_, contender) = CONTENDERS.into_iter().find(|(name, _)| *name == contender).unwrap();
            let load = loads().into_iter().find(|one| one.word == load).unwrap();
            println!("{:.0} ns a poll", measure(contender, &load, polls.parse().unwrap()));
        }
        _ => panic!("poll [CONTENDER LOAD POLLS]"),
    }
}

fn compare() {
    println!(
        "{:<42}{:>8}{:>14}{:>10}   own time of isotherm",
        "ns a poll", "bytes", "tokio-modbus", "isotherm"
    );
    for load in loads() {
        let mut turns = CONTENDERS.map(|_| Vec::new());
        for _ in 0..TURNS {
            for ((_, contender), turns) in CONTENDERS.iter().zip(&mut turns) {
                turns.push(measure(*contender, &load, load.polls));
            }
        }
        let [bytes, tokio_modbus, isotherm] = turns.each_ref().map(|turns| median(turns.iter().copied()));
        // Ratio to the turn of tokio-modbus directly before.
        let ratio = median((0..TURNS).map(|turn| turns[2][turn] / turns[1][turn]));
        println!(
            "{:<42}{bytes:>8.0}{tokio_modbus:>14.0}{isotherm:>10.0}   {:.0}, of tokio-modbus {:.0}; \
             in total {ratio:.3} of tokio-modbus",
            load.name,
            isotherm - bytes,
            tokio_modbus - bytes
        );
    }
}

fn median(figures: impl Iterator<Item = f64>) -> f64 {
    let mut figures: Vec<f64> = figures.collect();
    figures.sort_by(f64::total_cmp);
    figures[figures.len() / 2]
}

/// Measures the processor time of a poll in nanoseconds, over this number of polls.
fn measure(contender: Contender, load: &Load, polls: u64) -> f64 {
    let reads = Arc::new(AtomicU64::new(0));
    let counted = reads.clone();
    let measured = async move {
        sleep(WARM_UP).await;
        let (busy_before, before) = (busy(), counted.load(Ordering::Relaxed));
        while counted.load(Ordering::Relaxed) < before + polls {
            sleep(CHECK).await;
        }
        1e9 * (busy() - busy_before) / (counted.load(Ordering::Relaxed) - before) as f64
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        match contender {
            Contender::Isotherm => run_gateway(load, &reads, measured).await,
            Contender::Bytes | Contender::TokioModbus => {
                for _ in 0..load.work.devices {
                    let (stream, ticks) = (connected(&reads), load.ticks());
                    let reads_only = load.work.reads_only;
                    match contender {
                        Contender::Bytes => tokio::spawn(poll_bytes(stream, ticks, reads_only)),
                        _ => tokio::spawn(poll_tokio_modbus(stream, ticks, reads_only)),
                    };
                }
                measured.await
            }
        }
    })
}

impl Load {
    /// Returns the interval between two polls of a line; `None` without pauses.
    fn ticks(&self) -> Option<Interval> {
        (!self.is_closed_loop).then(|| interval(self.work.period))
    }
}

/// Waits for the next poll.
async fn next(ticks: &mut Option<Interval>) {
    if let Some(ticks) = ticks {
        ticks.tick().await;
    }
}

/// Processor time of this process, user and system, in seconds.
fn busy() -> f64 {
    let spent = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    spent.tv_sec as f64 + spent.tv_nsec as f64 * 1e-9
}

/// Runs the gateway until the measurement ends, and returns its result.
async fn run_gateway(load: &Load, reads: &Arc<AtomicU64>, measured: impl Future<Output = f64>) -> f64 {
    let line = |line| fleet_profile::tcp(line, "502");
    let loaded =
        isotherm_profile::parse(Path::new("poll.toml"), &load.work.profile(&REGISTERS, line), &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let reads = reads.clone();
    let dialer = Arc::new(move |_: &Bus| Some(Box::new(MemoryDial(reads.clone())) as Box<dyn Dial>));
    let at_once = Duration::from_micros(1);
    let pace = load.is_closed_loop.then_some(Pace { polls: at_once, axes: at_once });
    let gateway = Gateway::new(profile, &Clock::wall(), Options { dialer, pace, ..Options::default() });
    let mut found = None;
    gateway.run(async { found = Some(measured.await) }, std::future::ready(())).await;
    found.unwrap()
}

/// Opens connections to a server in this process.
struct MemoryDial(Arc<AtomicU64>);

impl Dial for MemoryDial {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        let connection: Result<Connection, Fault> =
            Ok(Connection::ModbusTcp(ModbusTcp::new(connected(&self.0), tap)));
        Box::pin(std::future::ready(connection))
    }
}

/// Returns a connection to a new server, which counts its reads.
fn connected(reads: &Arc<AtomicU64>) -> DuplexStream {
    let (ours, theirs) = duplex(512);
    tokio::spawn(serve(theirs, reads.clone()));
    ours
}

/// Serves eight registers: two temperatures, five other values, and a position. Also serves one register that clients
/// write.
async fn serve(mut stream: DuplexStream, reads: Arc<AtomicU64>) {
    let mut request = [0; REQUEST];
    let mut written = [0; 2];
    let mut read_answer = [0; READ_ANSWER];
    read_answer[5..].copy_from_slice(&[19, 1, 4, 16, 1, 19, 0, 240, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 4, 210]);
    while stream.read_exact(&mut request).await.is_ok() {
        let [high, low] = written;
        let answered = match request[7] {
            4 => {
                reads.fetch_add(1, Ordering::Relaxed);
                read_answer[..2].copy_from_slice(&request[..2]);
                stream.write_all(&read_answer).await
            }
            3 => stream.write_all(&[request[0], request[1], 0, 0, 0, 5, request[6], 3, 2, high, low]).await,
            _ => {
                written.copy_from_slice(&request[10..]);
                stream.write_all(&request).await
            }
        };
        if answered.is_err() {
            return;
        }
    }
}

/// Exchanges constant bytes with a server.
async fn poll_bytes(mut stream: DuplexStream, mut ticks: Option<Interval>, reads_only: bool) {
    let mut answer = [0; READ_ANSWER];
    loop {
        next(&mut ticks).await;
        stream.write_all(&[0, 1, 0, 0, 0, 6, 1, 4, 0, 0, 0, 8]).await.unwrap();
        stream.read_exact(&mut answer).await.unwrap();
        if !reads_only {
            stream.write_all(&[0, 2, 0, 0, 0, 6, 1, 6, 0, 10, 0, 84]).await.unwrap();
            stream.read_exact(&mut answer[..REQUEST]).await.unwrap();
        }
    }
}

/// Polls a device with tokio-modbus. Cz = 2.4 µm/°C · (bed − wheelhead), in counts of 0.1 µm.
async fn poll_tokio_modbus(stream: DuplexStream, mut ticks: Option<Interval>, reads_only: bool) {
    let mut device: Context = tcp::attach_slave(stream, Slave(1));
    loop {
        next(&mut ticks).await;
        let registers = device.read_input_registers(0, 8).await.unwrap().unwrap();
        if !reads_only {
            let [bed, wheelhead] =
                [registers[0], registers[1]].map(|register| f64::from(register.cast_signed()));
            #[allow(clippy::cast_possible_truncation, reason = "a few hundred counts")]
            let counts = (2.4 * (bed - wheelhead)) as i16;
            device.write_single_register(10, counts.cast_unsigned()).await.unwrap().unwrap();
        }
    }
}
