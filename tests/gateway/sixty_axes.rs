//! Sixty axes on the line of the sensors. No turn makes a sensor stale, and every write is based on fresh readings.
//!
//! The temperatures are a ramp. Therefore each value shows when it was read, and each offset shows the age of its
//! reading.
#![allow(clippy::unwrap_used, reason = "a test may stop where it stands")]
#![allow(clippy::disallowed_types, reason = "ages on a real line are the wall's")]
#![allow(clippy::cast_possible_truncation, reason = "counts that are known to be small")]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::status::{GatewayApi, Status};

use crate::support::starved::Starved;
use crate::support::tell;

const ANSWER_AFTER: Duration = Duration::from_millis(30);
const MAX_AGE: Duration = Duration::from_secs(4);
/// Additional age through transmission, rounding and a busy computer. A turn of all axes takes five seconds.
const ON_THE_WAY: Duration = Duration::from_secs(1);
/// If a thread waits for a processor for this long, the age of a reading is not known.
const STARVED: Duration = Duration::from_secs(1);
/// Time limit on a busy computer.
const PATIENCE: Duration = Duration::from_secs(300);
const SENSORS: u16 = 8;
const AXES: u16 = 60;
/// Slope of the temperature in °C/s, and gain of an axis in µm/°C.
const RAMP: f64 = 0.02;
const GAIN: f64 = 10.0;
const REFERENCE: f64 = 20.0;
/// Size of one count of an output in µm, and of a sensor in °C.
const COUNT: f64 = 1e-4;
const FINE: f64 = 1e-5;

/// Change of a register, and the age of its reading at that time.
struct Move {
    at: Instant,
    axis: u16,
    age: Duration,
}

struct Machine {
    begun: Instant,
    registers: BTreeMap<u16, u16>,
    moves: Vec<Move>,
    /// Times at which the sensors were read.
    read: Vec<Instant>,
    refused: Option<u16>,
    refusals: u32,
    longest_gap: Duration,
}

impl Machine {
    fn new(refused: Option<u16>) -> Arc<Mutex<Machine>> {
        Arc::new(Mutex::new(Machine {
            begun: Instant::now(),
            registers: BTreeMap::new(),
            moves: Vec::new(),
            read: Vec::new(),
            refused,
            refusals: 0,
            longest_gap: Duration::ZERO,
        }))
    }

    /// Number of changes of the register of an axis.
    fn moves_of(&self, axis: u16) -> usize {
        self.moves.iter().filter(|one| one.axis == axis).count()
    }

    /// Temperature that every sensor shows now, counts.
    fn temperature(&self) -> i32 {
        ((REFERENCE + RAMP * self.begun.elapsed().as_secs_f64()) / FINE).round() as i32
    }

    fn pair(&self, at: u16) -> i32 {
        let word = |at: u16| self.registers.get(&at).copied().unwrap_or_default().to_be_bytes();
        let ([a, b], [c, d]) = (word(at), word(at + 1));
        i32::from_be_bytes([a, b, c, d])
    }

    fn answer(&mut self, pdu: &[u8]) -> Vec<u8> {
        let word = |at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
        let (from, count) = (word(1), word(3));
        if pdu[0] == 16 {
            if self.refused == Some(from / 2) {
                self.refusals += 1;
                return vec![0x90, 2];
            }
            let before = self.pair(from);
            for (at, bytes) in (from..).zip(pdu[6..].chunks(2)) {
                self.registers.insert(at, u16::from_be_bytes([bytes[0], bytes[1]]));
            }
            let after = self.pair(from);
            if after != before {
                let read = f64::from(after) * COUNT / GAIN / RAMP;
                let age = self.begun.elapsed().saturating_sub(Duration::from_secs_f64(read.max(0.0)));
                self.moves.push(Move { at: Instant::now(), axis: from / 2, age });
            }
            return pdu[..5].to_vec();
        }
        let words: Vec<u16> = if pdu[0] == 4 {
            self.is_read();
            let [a, b, c, d] = self.temperature().to_be_bytes();
            let both = [u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d])];
            (from..from + count).map(|at| both[usize::from(at % 2)]).collect()
        } else {
            (from..from + count).map(|at| self.registers.get(&at).copied().unwrap_or_default()).collect()
        };
        let bytes = words.into_iter().flat_map(u16::to_be_bytes);
        [pdu[0], u8::try_from(2 * count).unwrap()].into_iter().chain(bytes).collect()
    }

    fn is_read(&mut self) {
        let now = Instant::now();
        let gap = self.read.last().map_or(Duration::ZERO, |last| now.duration_since(*last));
        self.longest_gap = self.longest_gap.max(gap);
        self.read.push(now);
    }
}

fn serve(machine: &Arc<Mutex<Machine>>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let machine = machine.clone();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let machine = machine.clone();
            std::thread::spawn(move || speak(stream.unwrap(), &machine));
        }
    });
    address
}

fn speak(mut stream: TcpStream, machine: &Mutex<Machine>) {
    stream.set_nodelay(true).unwrap();
    let mut header = [0; 7];
    while stream.read_exact(&mut header).is_ok() {
        let mut pdu = vec![0; usize::from(u16::from_be_bytes([header[4], header[5]])) - 1];
        if stream.read_exact(&mut pdu).is_err() {
            return;
        }
        let answer = machine.lock().unwrap().answer(&pdu);
        std::thread::sleep(ANSWER_AFTER);
        let length = u16::try_from(answer.len() + 1).unwrap().to_be_bytes();
        let frame = [&header[..4], &length, &header[6..], &answer].concat();
        if stream.write_all(&frame).is_err() {
            return;
        }
    }
}

fn profile(address: SocketAddr, axes: u16, every: &str) -> isotherm_profile::Profile {
    let mut text = format!(
        "[machine]\nname = \"sixty\"\narm = \"auto\"\n\
         [bus.cell]\ntype = \"modbus-tcp\"\naddress = \"{address}\"\ntimeout = \"5s\"\n\
         [device.thermocouples]\nbus = \"cell\"\nunit = 1\nevery = \"1s\"\n\
         [device.cnc]\nbus = \"cell\"\nunit = 2\n"
    );
    let pair = "type = \"i32\"\nword_order = \"msw-first\"";
    for sensor in 0..SENSORS {
        write!(
            text,
            "[signal.t{sensor}]\ndevice = \"thermocouples\"\nregister = \"input:{}\"\n{pair}\nscale = {FINE:.5}\n\
             unit = \"degC\"\nmax_age = \"{}s\"\nmax_rate = \"none\"\n",
            2 * sensor,
            MAX_AGE.as_secs()
        )
        .unwrap();
    }
    for axis in 0..axes {
        let sensor = axis % SENSORS;
        write!(
            text,
            "[axis.a{axis}]\nlimit = 60.0\nstep = 30.0\nrate = 100.0\nevery = \"{every}\"\n\
             on_fault = {{ action = \"hold\" }}\n[[axis.a{axis}.model]]\nname = \"own\"\nkind = \"linear\"\n\
             terms = [{{ signal = \"t{sensor}\", gain = {GAIN:.1}, reference = {REFERENCE:.1} }}]\n\
             [output.o{axis}]\naxis = \"a{axis}\"\ndevice = \"cnc\"\nwrites = \"offset\"\n\
             register = \"holding:{}\"\n{pair}\nscale = {COUNT:.4}\nshare = \"ledger\"\n",
            2 * axis
        )
        .unwrap();
    }
    let loaded = isotherm_profile::parse(Path::new("sixty.toml"), &text, &[], &[]);
    loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Observations since every axis was armed.
#[derive(Debug, Default)]
struct Seen {
    armed_after: Duration,
    /// Longest wait of a thread of this process, gateway and devices, for a processor.
    starved: Duration,
    /// Signals that became bad, with their quality.
    spoilt: Vec<String>,
    reported: BTreeMap<String, u64>,
}

/// Runs the gateway until every axis is armed and each of these axes has moved this often since its start. On a busy
/// computer that takes longer.
fn run(
    profile: isotherm_profile::Profile,
    machine: &Arc<Mutex<Machine>>,
    axes: &[u16],
    moves: usize,
) -> Seen {
    let (machine, axes) = (machine.clone(), axes.to_vec());
    let is_done = move || {
        let machine = machine.lock().unwrap();
        axes.iter().all(|axis| machine.moves_of(*axis) >= moves)
    };
    let directory = tempfile::tempdir().unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let starved = Starved::of(std::process::id());
    let mut seen = runtime.block_on(async {
        let options = Options { directory: Some(directory.path().to_owned()), ..Options::default() };
        let gateway = Gateway::new(profile, &Clock::wall(), options);
        let source = gateway.source();
        let done = tokio::task::spawn_blocking(move || watch(source.as_ref(), &is_done));
        let (tell, reported) = tokio::sync::oneshot::channel();
        let stop = async move { drop(tell.send(done.await)) };
        gateway.run(stop, std::future::ready(())).await;
        reported.await.unwrap().unwrap()
    });
    seen.starved = starved.longest();
    seen
}

fn watch(source: &dyn GatewayApi, is_done: &dyn Fn() -> bool) -> Seen {
    let begun = Instant::now();
    let mut seen = Seen::default();
    let mut is_armed = false;
    while !(is_armed && is_done()) {
        std::thread::sleep(Duration::from_millis(100));
        let status = source.status();
        if !is_armed && status.axes.iter().all(|axis| axis.arming.armed) {
            (is_armed, seen.armed_after) = (true, begun.elapsed());
        }
        assert!(begun.elapsed() < PATIENCE, "{:?}", events(&status));
        let bad = status.signals.iter().filter(|signal| is_armed && signal.quality != "good");
        for bad in bad.map(|signal| format!("{} {}", signal.name, signal.quality)) {
            if !seen.spoilt.contains(&bad) {
                seen.spoilt.push(bad);
            }
        }
        seen.reported =
            status.event_counts.iter().map(|(kind, count)| ((*kind).to_owned(), *count)).collect();
    }
    seen
}

fn events(status: &Status) -> Vec<&str> {
    status.events.iter().map(|event| event.text.as_str()).collect()
}

/// Prints the number of moves of each axis, and the age of the oldest reading of a move. Returns the numbers.
fn reported(machine: &Machine, axes: u16, seen: &Seen) -> Vec<usize> {
    let counts: Vec<usize> = (0..axes).map(|axis| machine.moves_of(axis)).collect();
    let old = machine.moves.iter().filter(|one| one.age > MAX_AGE + ON_THE_WAY).count();
    let oldest = machine.moves.iter().max_by_key(|one| one.age);
    let oldest = oldest.map(|one| (one.axis, one.at.duration_since(machine.begun), one.age));
    println!(
        "{} moves, each axis {:?} to {:?} times, {old} on readings older than max_age; the oldest (axis, when, age) \
         {oldest:?}; sensors read {} times, {:?} apart at most; {seen:?}",
        machine.moves.len(),
        counts.iter().min(),
        counts.iter().max(),
        machine.read.len(),
        machine.longest_gap,
    );
    counts
}

#[track_caller]
fn nothing_rests_on_old_readings(machine: &Machine, seen: &Seen) {
    let old = machine.moves.iter().filter(|one| one.age > MAX_AGE + ON_THE_WAY);
    let old: Vec<_> = old.map(|one| (one.axis, one.age)).collect();
    let is_late = !old.is_empty() || !seen.spoilt.is_empty() || machine.longest_gap >= MAX_AGE;
    if is_late && seen.starved >= STARVED {
        let waited = seen.starved;
        return tell(&format!("sixty axes: void, the computer was too busy: a thread waited {waited:?}"));
    }
    assert!(old.is_empty(), "{} of {} moves on old readings: {old:?}", old.len(), machine.moves.len());
    assert!(seen.spoilt.is_empty(), "{:?}", seen.spoilt);
    assert!(machine.longest_gap < MAX_AGE, "{:?}", machine.longest_gap);
}

#[test]
fn sixty_axes_on_the_sensors_own_line_move_on_fresh_readings_only() {
    let machine = Machine::new(None);
    let axes: Vec<u16> = (0..AXES).collect();
    let seen = run(profile(serve(&machine), AXES, "10s"), &machine, &axes, 2);
    let machine = machine.lock().unwrap();
    let counts = reported(&machine, AXES, &seen);
    assert!(counts.iter().all(|count| *count >= 2), "{counts:?}");
    nothing_rests_on_old_readings(&machine, &seen);
}

#[test]
fn an_axis_whose_writes_are_refused_keeps_no_other_from_its_moves() {
    let machine = Machine::new(Some(1));
    let seen = run(profile(serve(&machine), 4, "2s"), &machine, &[0, 2, 3], 6);
    let machine = machine.lock().unwrap();
    let counts = reported(&machine, 4, &seen);
    assert_eq!(counts[1], 0, "{counts:?}");
    assert!(machine.refusals >= 2, "it was tried {} times", machine.refusals);
    for other in [0, 2, 3] {
        assert!(counts[other] >= 6, "{counts:?}");
    }
    nothing_rests_on_old_readings(&machine, &seen);
}
