//! The gateway on a CAN bus of a real kernel; `tests/vcan/run bench` runs it.
//!
//! - From a position on the wire to the corrected one on the wire: the kernel's time stamps of the two frames. The limit:
//!   the median is under 200 µs.
//! - How often the gateway's thread wakes while 20,000 foreign frames a second pass, beside the same bus without them,
//!   second by second in turns. The limit: 5 % more. How long it is from wake to sleep is told beside it and has no limit:
//!   the user-mode kernel has one processor, so that this holds the kernel's own work for the foreign frames, too, and
//!   its clock of processor time goes in steps of 10 ms, which is too coarse to tell the two apart.

#![allow(
    clippy::unwrap_used,
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a bench may stop where it stands"
)]

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::status::Source;
use isotherm::profile;
use socketcan::{CanFilter, CanFrame, CanSocket, EmbeddedFrame, Frame, Socket, SocketOptions, StandardId};
use tokio::runtime::{Handle, RuntimeMetrics};

/// From wire to wire.
const LATENCY: Duration = Duration::from_micros(200);
/// Wakes with foreign traffic per those without.
const SHARE: f64 = 1.05;
/// Seconds of each.
const ROUNDS: u64 = 20;
/// Foreign frames a second.
const FOREIGN: u64 = 20_000;

const POSITION: u16 = 0x300;
const CORRECTED: u16 = 0x20c;

const PROFILE: &str = r#"
[machine]
name = "bench"
arm = "auto"
[bus.can]
type = "can"
interface = "INTERFACE"
timeout = "100ms"
[device.scale]
bus = "can"
[device.module]
bus = "can"
[device.display]
bus = "can"
node = 12
[signal.position]
device = "scale"
frame = { id = 0x300, start = 0, length = 32, order = "little", signed = true }
scale = 0.001
unit = "mm"
max_age = "60s"
[signal.bed]
device = "module"
frame = { id = 0x301, start = 0, length = 16, order = "little", signed = true }
scale = 0.1
unit = "degC"
max_age = "60s"
[axis.z]
limit = 40.0
step = 1.0
rate = 20.0
every = "200ms"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "one"
kind = "linear"
terms = [{ signal = "bed", gain = 1.0, reference = 20.0 }]
[output.shown]
axis = "z"
device = "display"
writes = "corrected"
position = "position"
pdo = { cob_id = 0x20C, start = 0, length = 32, signed = true }
scale = 0.001
"#;

/// A running gateway.
struct Running {
    source: Arc<dyn Source>,
    /// Measures itself.
    runtime: RuntimeMetrics,
    stop: Option<tokio::sync::oneshot::Sender<()>>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Running {
    fn start(interface: &str) -> Running {
        let text = PROFILE.replace("INTERFACE", interface);
        let loaded = profile::parse(Path::new("bench.toml"), &text, &[], &[]);
        let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
        let (tell, told) = std::sync::mpsc::channel();
        let (stop, stopped) = tokio::sync::oneshot::channel();
        let thread = std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
            runtime.block_on(async {
                let gateway = Gateway::new(profile, &Clock::wall(), Options::default());
                tell.send((gateway.source(), Handle::current().metrics())).unwrap();
                gateway.run(async { drop(stopped.await) }, std::future::ready(())).await;
            });
        });
        let (source, runtime) = told.recv().unwrap();
        Running { source, runtime, stop: Some(stop), thread: Some(thread) }
    }

    /// Milliseconds busy, and sleeps, so far.
    fn spent(&self) -> [f64; 2] {
        let busy = self.runtime.worker_total_busy_duration(0);
        [busy.as_secs_f64() * 1000.0, self.runtime.worker_park_count(0) as f64]
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        drop(self.stop.take());
        let _ = self.thread.take().map(std::thread::JoinHandle::join);
    }
}

fn frame(id: u16, data: &[u8]) -> CanFrame {
    CanFrame::new(StandardId::new(id).unwrap(), data).unwrap()
}

/// Positions and temperatures, and what the gateway makes of them.
struct Machine {
    socket: CanSocket,
    wire: CanSocket,
    sent: i32,
}

impl Machine {
    fn new(interface: &str) -> Machine {
        let socket = CanSocket::open(interface).unwrap();
        socket.set_filter_drop_all().unwrap();
        let wire = CanSocket::open(interface).unwrap();
        let both = [POSITION, CORRECTED].map(|id| CanFilter::new(u32::from(id), 0x7ff));
        wire.set_filters(&both).unwrap();
        wire.set_recv_timestamp(true).unwrap();
        wire.set_nonblocking(true).unwrap();
        Machine { socket, wire, sent: 0 }
    }

    fn bed(&self) {
        self.socket.write_frame(&frame(0x301, &[250, 0])).unwrap();
    }

    fn position(&mut self) {
        self.sent += 1;
        self.socket.write_frame(&frame(POSITION, &self.sent.to_le_bytes())).unwrap();
    }

    /// From the position to its correction, both as the kernel has stamped them. Nobody else runs meanwhile.
    fn once(&mut self) -> Option<Duration> {
        self.position();
        std::thread::sleep(Duration::from_millis(2));
        let (mut from, mut to) = (None, None);
        while let Ok((heard, at)) = self.wire.read_frame_with_timestamp() {
            match heard.raw_id() {
                id if id == u32::from(POSITION) => from = Some(at),
                _ => to = Some(at),
            }
        }
        to?.duration_since(from?).ok()
    }
}

fn wait_for(running: &Running, machine: &mut Machine) {
    for _ in 0..2000 {
        machine.bed();
        machine.position();
        std::thread::sleep(Duration::from_millis(5));
        let status = running.source.status();
        if status.axes[0].state == "active" && status.axes[0].cz_um > 4.9 {
            return;
        }
    }
    panic!("the axis does not follow: {:?}", running.source.status().events);
}

fn latency(running: &Running, machine: &mut Machine) -> bool {
    while machine.once().is_some() {}
    let mut spans: Vec<Duration> = Vec::new();
    for round in 0..3000 {
        if round % 50 == 0 {
            machine.bed();
        }
        spans.extend(machine.once());
    }
    spans.sort_unstable();
    assert!(spans.len() > 2900, "only {} of 3000: {:?}", spans.len(), running.source.status().events);
    let at = |share: f64| spans[((spans.len() - 1) as f64 * share) as usize];
    let (median, most, longest) = (at(0.5), at(0.99), at(1.0));
    println!(
        "position on the wire to corrected position on the wire: median {median:?}, 99 % {most:?}, longest {longest:?} \
         ({} times); limit {LATENCY:?}",
        spans.len()
    );
    median < LATENCY
}

/// Foreign frames while it is told so, at most [`FOREIGN`] a second.
fn babble(interface: &str, on: &AtomicBool, over: &AtomicBool, sent: &AtomicU64) {
    let socket = CanSocket::open(interface).unwrap();
    socket.set_filter_drop_all().unwrap();
    // The processor is the gateway's whenever it wants it, as where frames come from outside.
    let thread = std::fs::read_link("/proc/thread-self").unwrap();
    let number = thread.file_name().unwrap();
    let nice = std::process::Command::new("renice").args(["-n", "19", "-p"]).arg(number).output();
    assert!(nice.unwrap().status.success(), "renice");
    let clock = Clock::wall();
    let mut last = clock.now();
    while !over.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(2));
        let now = clock.now();
        let due = now.since(std::mem::replace(&mut last, now)).as_secs_f64() * FOREIGN as f64;
        if on.load(Ordering::Relaxed) {
            // As different as foreign frames are.
            for number in 0..(due as u16).min(1000) {
                let foreign = frame(0x400 + number % 0x100, &number.to_le_bytes());
                sent.fetch_add(u64::from(socket.write_frame(&foreign).is_ok()), Ordering::Relaxed);
            }
        }
    }
}

/// What the gateway spends on each position of a second, one every 5 ms, with a temperature every 100 ms: busy, ms, and
/// sleeps.
fn second(running: &Running, machine: &mut Machine) -> Vec<[f64; 2]> {
    let clock = Clock::wall();
    let begun = clock.now();
    let mut last = running.spent();
    let each = (0..200_u32).map(|round| {
        machine.position();
        if round % 20 == 0 {
            machine.bed();
        }
        std::thread::sleep(begun.after(Duration::from_millis(5) * (round + 1)).since(clock.now()));
        let now = running.spent();
        let before = std::mem::replace(&mut last, now);
        [now[0] - before[0], now[1] - before[1]]
    });
    let each = each.collect();
    while machine.wire.read_frame().is_ok() {}
    each
}

fn foreign(interface: &str, running: &Running, machine: &mut Machine) -> bool {
    let [on, over] = [(); 2].map(|()| AtomicBool::new(false));
    let sent = AtomicU64::new(0);
    let (mut quiet, mut loud) = (Vec::new(), Vec::new());
    std::thread::scope(|scope| {
        scope.spawn(|| babble(interface, &on, &over, &sent));
        for _ in 0..ROUNDS {
            on.store(false, Ordering::Relaxed);
            quiet.extend(second(running, machine));
            on.store(true, Ordering::Relaxed);
            loud.extend(second(running, machine));
        }
        over.store(true, Ordering::Relaxed);
    });
    // What this computer did for others in between falls on few of them.
    let median = |each: &[[f64; 2]]| {
        let mut values: Vec<f64> = each.iter().map(|one| one[0]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let mean = |each: &[[f64; 2]]| each.iter().map(|one| one[1]).sum::<f64>() / each.len() as f64;
    let rate = sent.load(Ordering::Relaxed) / ROUNDS;
    let told = |quiet: f64, loud: f64, unit: &str| {
        println!(
            "for each position: {quiet:.4} {unit}, while {rate} foreign frames a second pass {loud:.4}: {:.3} times as much",
            loud / quiet
        );
    };
    told(median(&quiet), median(&loud), "ms from wake to sleep (median)");
    let (quiet, loud) = (mean(&quiet), mean(&loud));
    told(quiet, loud, "sleeps (mean)");
    println!("limit of sleeps {SHARE}");
    loud < quiet * SHARE
}

fn main() {
    let Ok(interface) = std::env::var("ISOTHERM_VCAN") else {
        panic!(
            "this bench needs a CAN interface of its own: `tests/vcan/run bench` makes one and runs it there"
        );
    };
    let running = Running::start(&interface);
    let mut machine = Machine::new(&interface);
    wait_for(&running, &mut machine);
    let is_quick = latency(&running, &mut machine);
    let is_deaf = foreign(&interface, &running, &mut machine);
    assert!(is_quick && is_deaf, "a limit is passed");
}
