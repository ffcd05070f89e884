//! Benchmark of the gateway on a CAN bus of a real kernel. `tests/vcan/run bench` runs it.
//!
//! `isotherm run` is a separate process here, as on a machine. The benchmark measures:
//!
//! - Latency from a position frame to the corrected position frame, by the kernel's time stamps of both frames. Limit:
//!   the median is below 200 µs.
//! - Processor time and sleeps of the gateway with 20,000 foreign frames per second on its bus, compared with the same
//!   traffic on another bus. The seconds alternate. Limit of both: 5 % more. The comparison uses another bus because
//!   the sender may share the processor and its caches with the gateway. The benchmark also prints the figures without
//!   foreign traffic.

#![allow(
    clippy::unwrap_used,
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a bench may stop where it stands"
)]

mod meter;

use std::fs::File;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::Duration;

use isotherm::clock::Clock;
use socketcan::{CanFilter, CanFrame, CanSocket, EmbeddedFrame, Frame, Socket, SocketOptions, StandardId};
use tempfile::TempDir;

use meter::Meter;

/// Limit of the median latency from position frame to corrected position frame.
const LATENCY: Duration = Duration::from_micros(200);
/// Limit of processor time and of sleeps with foreign traffic on this bus, as a ratio to traffic on another bus.
const SHARE: f64 = 1.05;
/// Measured seconds for each kind of traffic.
const ROUNDS: u32 = 40;
/// CAN interface that the gateway does not use.
const OTHER: &str = "vcan1";
/// Foreign frames per second.
const FOREIGN: u32 = 20_000;

const POSITION: u16 = 0x300;
const CORRECTED: u16 = 0x20c;

/// Cz of the axis at 25 °C, in counts of the position.
const CZ: i32 = 5;

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
max_rate = "none"
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

/// A running gateway process.
struct Running {
    child: Child,
    /// Directory of profile, state and log.
    directory: TempDir,
    meter: Meter,
}

impl Running {
    fn start(interface: &str) -> Running {
        let directory = tempfile::tempdir().unwrap();
        let profile = directory.path().join("bench.toml");
        std::fs::write(&profile, PROFILE.replace("INTERFACE", interface)).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
        command.arg("run").arg(&profile).arg("--state").arg(directory.path());
        let log = File::create(directory.path().join("log")).unwrap();
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
        let (child, meter) = Meter::on(|| command.spawn().unwrap());
        Running { child, directory, meter }
    }

    fn log(&self) -> String {
        std::fs::read_to_string(self.directory.path().join("log")).unwrap()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

fn frame(id: u16, data: &[u8]) -> CanFrame {
    CanFrame::new(StandardId::new(id).unwrap(), data).unwrap()
}

/// Simulated machine: sends positions and temperatures, and receives the corrected positions.
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

    /// Returns the last corrected position received since the previous call; `None` if there was none.
    fn corrected(&self) -> Option<i32> {
        let heard = std::iter::from_fn(|| self.wire.read_frame().ok());
        let corrected = heard.filter(|frame| frame.raw_id() == u32::from(CORRECTED)).last()?;
        Some(i32::from_le_bytes(corrected.data().try_into().unwrap()))
    }

    /// Sends one position, and returns the time until its correction by the kernel's time stamps. Meanwhile this thread
    /// sleeps, so that it does not compete for the processor.
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
    for _ in 0..4000 {
        machine.bed();
        machine.position();
        std::thread::sleep(Duration::from_millis(5));
        if machine.corrected().is_some_and(|corrected| (corrected - machine.sent).abs() == CZ) {
            return;
        }
    }
    panic!("the axis does not follow: {}", running.log());
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
    assert!(spans.len() > 2900, "only {} of 3000: {}", spans.len(), running.log());
    let at = |share: f64| spans[((spans.len() - 1) as f64 * share) as usize];
    let (median, most, longest) = (at(0.5), at(0.99), at(1.0));
    println!(
        "position on the wire to corrected position on the wire: median {median:?}, 99 % {most:?}, longest {longest:?} \
         ({} times); limit {LATENCY:?}",
        spans.len()
    );
    median < LATENCY
}

/// Bus that carries the foreign frames.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Traffic {
    None,
    Elsewhere,
    Here,
}

const TURNS: [Traffic; 3] = [Traffic::None, Traffic::Elsewhere, Traffic::Here];

/// Sends at most [`FOREIGN`] foreign frames per second to the bus that the channel names, until the channel closes.
/// Returns the number of sent frames.
fn babble(interface: &str, reported: &Receiver<Traffic>) -> u64 {
    let [here, elsewhere] = [interface, OTHER].map(|name| {
        let socket = CanSocket::open(name).unwrap();
        socket.set_filter_drop_all().unwrap();
        socket
    });
    let clock = Clock::wall();
    let (mut last, mut traffic, mut sent) = (clock.now(), Traffic::None, 0);
    loop {
        traffic = match reported.recv_timeout(Duration::from_millis(2)) {
            Ok(traffic) => traffic,
            Err(RecvTimeoutError::Timeout) => traffic,
            Err(RecvTimeoutError::Disconnected) => return sent,
        };
        let now = clock.now();
        let due = now.since(std::mem::replace(&mut last, now)).as_secs_f64() * f64::from(FOREIGN);
        let socket = match traffic {
            Traffic::None => continue,
            Traffic::Elsewhere => &elsewhere,
            Traffic::Here => &here,
        };
        // Foreign frames have different identifiers and different content.
        for number in 0..(due as u16).min(1000) {
            let foreign = frame(0x400 + number % 0x100, &number.to_le_bytes());
            sent += u64::from(socket.write_frame(&foreign).is_ok());
        }
    }
}

/// Measures one second of the gateway: 200 positions, one every 5 ms, and a temperature every 100 ms. Returns processor
/// time in ms and the number of sleeps.
fn second(running: &mut Running, machine: &mut Machine) -> [f64; 2] {
    let clock = Clock::wall();
    let before = (running.meter.busy(), running.meter.sleeps());
    let begun = clock.now();
    for round in 0..200_u32 {
        machine.position();
        if round % 20 == 0 {
            machine.bed();
        }
        std::thread::sleep(begun.after(Duration::from_millis(5) * (round + 1)).since(clock.now()));
    }
    let after = (running.meter.busy(), running.meter.sleeps());
    assert!(machine.corrected().is_some(), "{}", running.log());
    [(after.0 - before.0).as_secs_f64() * 1000.0, (after.1 - before.1) as f64]
}

fn foreign(interface: &str, running: &mut Running, machine: &mut Machine) -> bool {
    let mut spent = TURNS.map(|_| Vec::new());
    let mut sending = Duration::ZERO;
    let clock = Clock::wall();
    let sent = std::thread::scope(|scope| {
        let (tell, reported) = mpsc::channel();
        let sender = scope.spawn(move || babble(interface, &reported));
        for _ in 0..ROUNDS {
            for (traffic, spent) in TURNS.into_iter().zip(&mut spent) {
                tell.send(traffic).unwrap();
                let begun = clock.now();
                spent.push(second(running, machine));
                sending += if traffic == Traffic::None { Duration::ZERO } else { clock.now().since(begun) };
            }
        }
        drop(tell);
        sender.join().unwrap()
    });
    // The median ignores the few seconds that other processes of the computer disturbed.
    let median = |seconds: &[[f64; 2]], of: usize| {
        let mut values: Vec<f64> = seconds.iter().map(|second| second[of]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    println!("200 positions, {:.0} foreign frames a second:", sent as f64 / sending.as_secs_f64());
    let mut is_deaf = true;
    for (of, unit) in ["ms of processor time", "sleeps"].into_iter().enumerate() {
        let [none, elsewhere, here] = [0, 1, 2].map(|turn| median(&spent[turn], of));
        println!(
            "  {unit}: none {none:.3}, on another bus {elsewhere:.3}, on this bus {here:.3}: {:.3} times as much as on \
             another bus, limit {SHARE}; {:.3} times as much as with none",
            here / elsewhere,
            here / none
        );
        is_deaf &= here < elsewhere * SHARE;
    }
    is_deaf
}

fn main() {
    let Ok(interface) = std::env::var("ISOTHERM_VCAN") else {
        panic!(
            "this bench needs a CAN interface of its own: `tests/vcan/run bench` makes one and runs it there"
        );
    };
    let mut running = Running::start(&interface);
    let mut machine = Machine::new(&interface);
    wait_for(&running, &mut machine);
    let is_quick = latency(&running, &mut machine);
    let is_deaf = foreign(&interface, &mut running, &mut machine);
    assert!(is_quick && is_deaf, "a limit is passed");
}
