//! Benchmark of the free-running loop of the gateway against a blocking socket that exchanges the same bytes.
//!
//! One loop reads eight input registers, steps the axis and writes one holding register, which its echo verifies. Both
//! clients and their server are pinned to one processor; otherwise the result depends on the scheduler. Limit: the
//! gateway makes at least 0.80 of the loops of the blocking socket.

#![allow(clippy::unwrap_used, clippy::cast_precision_loss, reason = "a bench may stop where it stands")]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use criterion::{Criterion, Throughput};
use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options, Pace};

/// Minimum ratio of the gateway's loops to the loops of the blocking socket.
const LIMIT: f64 = 0.80;

/// Period of the axis that is shorter than any loop.
const STEP_EACH_LOOP: Duration = Duration::from_micros(1);

/// Profile with eight registers: two temperatures, a position, and registers that fill the gaps between them.
const PROFILE: &str = r#"
[machine]
name = "bench"
[bus.cell]
type = "modbus-tcp"
address = "ADDRESS"
timeout = "300ms"
[device.module]
bus = "cell"
unit = 1
every = "1s"
[device.readout]
bus = "cell"
unit = 1
[signal.bed]
device = "module"
register = "input:0"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "5s"
max_rate = "none"
[signal.wheelhead]
device = "module"
register = "input:1"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "5s"
max_rate = "none"
[signal.position]
device = "module"
register = "input:7"
type = "i16"
scale = 0.01
unit = "mm"
max_age = "5s"
[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
every = "1s"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "difference"
kind = "linear"
terms = [ { signal = "bed", gain = 2.4, reference = 0.0 }, { signal = "wheelhead", gain = -2.4, reference = 0.0 } ]
[output.readout_z]
axis = "z"
device = "readout"
writes = "corrected"
position = "position"
register = "holding:10"
type = "i16"
scale = 0.01
verify = "echo"
"#;

/// Minimal Modbus server: it reads eight registers, writes one, and accepts any number of connections.
struct Server {
    address: SocketAddr,
    loops: Arc<AtomicU64>,
}

impl Server {
    fn start() -> Server {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let loops = Arc::new(AtomicU64::new(0));
        let counter = loops.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let counter = counter.clone();
                std::thread::spawn(move || answer(stream.unwrap(), &counter));
            }
        });
        Server { address, loops }
    }

    fn loops(&self) -> u64 {
        self.loops.load(Ordering::Relaxed)
    }
}

fn answer(mut stream: TcpStream, loops: &AtomicU64) {
    stream.set_nodelay(true).unwrap();
    let mut request = [0u8; 64];
    let mut reply = [0u8; 25];
    while let Ok(length) = stream.read(&mut request) {
        if length < 12 {
            return;
        }
        let answered = if request[7] == 4 {
            reply[..4].copy_from_slice(&request[..4]);
            reply[4..9].copy_from_slice(&[0, 19, request[6], 4, 16]);
            // 27.5 °C, 24.0 °C, …, 12.34 mm
            reply[9..25].copy_from_slice(&[1, 19, 0, 240, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4, 210]);
            stream.write_all(&reply)
        } else {
            loops.fetch_add(1, Ordering::Relaxed);
            stream.write_all(&request[..12])
        };
        if answered.is_err() {
            return;
        }
    }
}

/// Blocking client that exchanges the same bytes.
struct PingPong {
    stream: TcpStream,
    transaction: u16,
}

impl PingPong {
    fn connect(server: &Server) -> PingPong {
        let stream = TcpStream::connect(server.address).unwrap();
        stream.set_nodelay(true).unwrap();
        PingPong { stream, transaction: 0 }
    }

    fn run_once(&mut self) {
        let mut reply = [0u8; 64];
        for pdu in [[4, 0, 0, 0, 8], [6, 0, 10, 4, 210]] {
            let [high, low] = self.transaction.to_be_bytes();
            self.transaction = self.transaction.wrapping_add(1);
            let mut request = [high, low, 0, 0, 0, 6, 1, 0, 0, 0, 0, 0];
            request[7..].copy_from_slice(&pdu);
            self.stream.write_all(&request).unwrap();
            let length = self.stream.read(&mut reply).unwrap();
            assert!(length >= 12);
        }
    }
}

/// A gateway that runs without pauses until it is dropped.
struct Running {
    stop: Option<tokio::sync::oneshot::Sender<()>>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Running {
    fn start(server: &Server, axis_every: Duration) -> Running {
        let text = PROFILE.replace("ADDRESS", &server.address.to_string());
        let loaded = isotherm_profile::parse(Path::new("bench.toml"), &text, &[], &[]);
        let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
        // Poll without a pause, and step the axis as often as `axis_every` says.
        let pace = Some(Pace { polls: Duration::from_micros(1), axes: axis_every });
        let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
        let thread = std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
            runtime.block_on(async {
                let gateway = Gateway::new(profile, &Clock::wall(), Options { pace, ..Options::default() });
                let stopping = async { drop(stopped.await) };
                gateway.run(stopping, std::future::ready(())).await;
            });
        });
        let running = Running { stop: Some(stop), thread: Some(thread) };
        let begun = server.loops();
        while server.loops() < begun + 100 {
            std::thread::sleep(Duration::from_millis(1));
        }
        running
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

/// Measures how long the server takes for this number of further loops.
fn time_for(server: &Server, clock: &Clock, loops: u64) -> Duration {
    let begun = (clock.now(), server.loops());
    while server.loops() < begun.1 + loops {
        std::thread::sleep(Duration::from_micros(200));
    }
    let (span, seen) = (clock.now().since(begun.0), server.loops() - begun.1);
    span.mul_f64(loops as f64 / seen as f64)
}

fn loops_per_second(server: &Server, clock: &Clock, span: Duration) -> f64 {
    let begun = (clock.now(), server.loops());
    std::thread::sleep(span);
    (server.loops() - begun.1) as f64 / clock.now().since(begun.0).as_secs_f64()
}

fn main() {
    if let Some(cores) = core_affinity::get_core_ids() {
        // New threads inherit the processor.
        core_affinity::set_for_current(cores[0]);
    }
    let server = Server::start();
    let clock = Clock::wall();
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("closed loop");
    group.throughput(Throughput::Elements(1));
    let mut ping_pong = PingPong::connect(&server);
    group.bench_function("blocking ping-pong", |bencher| bencher.iter(|| ping_pong.run_once()));
    for (name, every) in [
        ("gateway, a step every loop", STEP_EACH_LOOP),
        ("gateway, a step every second", Duration::from_secs(1)),
    ] {
        let running = Running::start(&server, every);
        group.bench_function(name, |bencher| bencher.iter_custom(|loops| time_for(&server, &clock, loops)));
        drop(running);
    }
    group.finish();
    compare(&server, &clock);
}

/// Compares both clients in alternating turns, so that changes of the computer's speed affect both.
fn compare(server: &Server, clock: &Clock) {
    let span = Duration::from_millis(500);
    let mut ratios = Vec::new();
    for _ in 0..7 {
        let stop = Arc::new(AtomicBool::new(false));
        let (stopped, mut ping_pong) = (stop.clone(), PingPong::connect(server));
        let blocking = std::thread::spawn(move || {
            while !stopped.load(Ordering::Relaxed) {
                ping_pong.run_once();
            }
        });
        std::thread::sleep(Duration::from_millis(20));
        let base = loops_per_second(server, clock, span);
        stop.store(true, Ordering::Relaxed);
        blocking.join().unwrap();
        let running = Running::start(server, STEP_EACH_LOOP);
        let ours = loops_per_second(server, clock, span);
        drop(running);
        println!("ping-pong {base:>8.0} loops/s   gateway {ours:>8.0} loops/s   ratio {:.3}", ours / base);
        ratios.push(ours / base);
    }
    ratios.sort_by(f64::total_cmp);
    let median = ratios[ratios.len() / 2];
    let verdict = if median >= LIMIT { "reached" } else { "MISSED" };
    println!("median ratio {median:.3}, limit {LIMIT:.2}: {verdict}");
}
