//! Virtual machine and gateway in one process, over real loopback sockets. The clock runs as fast as both allow. The
//! rig records all requests to devices and all events.

use std::fs::Metadata;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

use isotherm::clock::{Clock, Hold};
use isotherm::gateway::{Gateway, Options, Outcome};
use isotherm::observe::events::Entry;
use isotherm::observe::requester::{Channel, Requester};
use isotherm::observe::status::{Answer, Command, GatewayApi, Status};
use isotherm::virtual_machine::{
    AcceptedSet, FaultScript, PlantSpec, Ports, SeenRequest, Setup, UnknownUnit, VirtualMachine,
};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Parity, Profile, Serial, Transport, parse};

use crate::faults::law;

pub(crate) const BENCH: &str = include_str!("bench.toml");
pub(crate) const LATHE: &str = include_str!("lathe.toml");
/// Fast serial line, so that a test of a whole day is not long.
pub(crate) const PORT: Transport =
    Transport::Serial(Serial { baud: 115_200, parity: Parity::Even, stop_bits: 1 });
/// Serial line of the same speed with frames of Modbus ASCII.
pub(crate) const ASCII_PORT: Transport = Transport::ModbusAscii {
    serial: Serial { baud: 115_200, parity: Parity::Even, stop_bits: 1 },
    data_bits: 7,
};
pub(crate) const GRINDER: &str = include_str!("../../../profiles/surface-grinder.toml");

/// Interval of the samples of the gateway's status.
const SAMPLE_EVERY: Duration = Duration::from_secs(1);

/// Hardware, and the clock that it shares with its clients.
pub(crate) struct World {
    pub(crate) profile: Profile,
    pub(crate) clock: Clock,
    pub(crate) machine: VirtualMachine,
    hold: Option<Hold>,
}

/// Access to a gateway while it runs.
pub(crate) struct Stage<'a> {
    pub(crate) source: &'a Arc<dyn GatewayApi>,
    pub(crate) clock: &'a Clock,
}

type Act<'a> = Box<dyn FnOnce(&Stage<'_>) + 'a>;

/// One run of a gateway.
pub(crate) struct Trial<'a> {
    world: &'a mut World,
    options: Options,
    acts: Vec<(Duration, Act<'a>)>,
    is_killed: bool,
}

/// Status at one moment.
pub(crate) struct Sample {
    pub(crate) at: Moment,
    pub(crate) status: Status,
}

/// Result of a run.
pub(crate) struct Trace {
    pub(crate) profile: Profile,
    pub(crate) begin: Moment,
    pub(crate) samples: Vec<Sample>,
    pub(crate) events: Vec<Entry>,
    pub(crate) wire: Vec<SeenRequest>,
    /// Sets that the controls have taken.
    pub(crate) taken: Vec<AcceptedSet>,
    pub(crate) outcome: Outcome,
    /// Time of the request to stop, and time at which the gateway had stopped.
    pub(crate) stopped: (Moment, Moment),
}

pub(crate) fn block_on<F: Future>(future: F) -> F::Output {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(future)
}

/// Variable that makes every line of every test use other frames: `rtu-over-tcp`, `rtu` for ports, `ascii-over-tcp`,
/// or `ascii` for ports.
const LINES: &str = "TEST_LINES";

pub(crate) fn profile(text: &str) -> Profile {
    let loaded = parse(Path::new("bench.toml"), text, &[], &[]);
    let mut profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let transport = match std::env::var(LINES).as_deref() {
        Err(_) | Ok("tcp") => return profile,
        Ok("rtu-over-tcp") => Transport::RtuOverTcp,
        Ok("rtu") => PORT,
        Ok("ascii-over-tcp") => Transport::ModbusAsciiOverTcp,
        Ok("ascii") => ASCII_PORT,
        Ok(other) => panic!("{LINES}: no line is made of `{other}`"),
    };
    profile.buses.iter_mut().for_each(|bus| bus.transport = transport);
    profile
}

pub(crate) fn speaks_rtu(profile: &Profile) -> bool {
    profile.buses[0].transport != Transport::Tcp
}

/// Bench with a timeout that a busy computer does not exceed, for results that are compared exactly.
pub(crate) fn patient() -> String {
    BENCH.replace("100ms", "900ms")
}

/// Runs the bench with these faults.
pub(crate) fn bench(faults: &str, span: Duration) -> Trace {
    run(BENCH, faults, span)
}

/// Runs this profile with these faults.
pub(crate) fn run(text: &str, faults: &str, span: Duration) -> Trace {
    block_on(async { World::new(text, faults).await.gateway().run(span).await })
}

/// Waits until the disk has stored everything. It is slower than a clock that nothing holds, and rows are dropped if
/// too many wait.
fn catches_up(directory: &Path, quiet: Duration) {
    let written = || {
        let entries = std::fs::read_dir(directory).into_iter().flatten();
        let files = entries.filter_map(|entry| entry.ok()?.metadata().ok());
        let changed =
            |file: &Metadata| file.modified().unwrap().duration_since(UNIX_EPOCH).unwrap().as_nanos();
        files.map(|file| changed(&file) + u128::from(file.len())).sum::<u128>()
    };
    let mut before = 0;
    while before != written() || is_writing() {
        before = written();
        std::thread::sleep(quiet);
    }
}

/// Returns whether a thread that saves logs or state is running, ready to run or waiting for the disk. On a busy
/// computer that takes longer than any time without a change.
fn is_writing() -> bool {
    let threads = std::fs::read_dir("/proc/self/task").unwrap().flatten();
    let status = threads.filter_map(|thread| std::fs::read_to_string(thread.path().join("status")).ok());
    status.into_iter().any(|status| {
        let line = |name: &str| status.lines().find_map(|line| line.strip_prefix(name)).unwrap_or("").trim();
        matches!(line("Name:"), "storage" | "state") && !line("State:").starts_with('S')
    })
}

impl World {
    pub(crate) async fn new(text: &str, faults: &str) -> World {
        World::of(profile(text), faults).await
    }

    pub(crate) async fn of(profile: Profile, faults: &str) -> World {
        // RTU has no transactions. It has checksums, which can be wrong.
        let faults = if speaks_rtu(&profile) {
            faults
                .replace("wrong-transaction", "wrong-checksum")
                .replace("one-behind-stale", "wrong-checksum")
        } else {
            faults.to_owned()
        };
        let faults = FaultScript::parse(&faults, &profile).unwrap_or_else(|error| panic!("{error}"));
        World::start(profile, faults, None).await
    }

    pub(crate) async fn start(profile: Profile, faults: FaultScript, clock: Option<Clock>) -> World {
        let plant = PlantSpec::shipped("surface-grinder").unwrap().unwrap();
        World::with(plant, profile, faults, clock).await
    }

    pub(crate) async fn with(
        plant: PlantSpec,
        mut profile: Profile,
        faults: FaultScript,
        clock: Option<Clock>,
    ) -> World {
        let clock = clock.unwrap_or_else(|| Clock::simulated(plant.start(), None));
        let hold = clock.hold();
        let setup = Setup {
            plant: Some(plant),
            seed: 1,
            faults,
            ports: Ports::Free,
            unknown_unit: UnknownUnit::Silence,
            journal: true,
            probe_every: Some(Duration::from_secs(120)),
            ..Setup::default()
        };
        let machine = VirtualMachine::start(&profile, setup, &clock).await.unwrap();
        for (bus, address) in machine.addresses() {
            profile.buses[bus.0].address = address.to_string();
        }
        World { profile, clock, machine, hold: Some(hold) }
    }

    /// Lets this time pass without a gateway.
    pub(crate) async fn wait(&mut self, span: Duration) {
        let mut ticket = self.clock.join();
        drop(self.hold.take());
        ticket.sleep_until(self.clock.now().after(span)).await;
        self.hold = Some(self.clock.hold());
    }

    pub(crate) fn gateway(&mut self) -> Trial<'_> {
        Trial { world: self, options: Options::default(), acts: Vec::new(), is_killed: false }
    }
}

/// Sender of the commands of a test.
pub(crate) fn somebody() -> Arc<Requester> {
    Arc::new(Requester::new(Channel::Socket, "somebody"))
}

impl<'a> Trial<'a> {
    pub(crate) fn options(mut self, change: impl FnOnce(&mut Options)) -> Self {
        change(&mut self.options);
        self
    }

    /// Calls `act` at this time of the run. Calls must be in the order of their times.
    pub(crate) fn at(mut self, after: Duration, act: impl FnOnce(&Stage<'_>) + 'a) -> Self {
        self.acts.push((after, Box::new(act)));
        self
    }

    pub(crate) fn command(self, after: Duration, command: Command) -> Self {
        self.at(after, move |stage| {
            let answer = stage.source.command(command, None, &somebody()).unwrap();
            assert!(!matches!(answer, Answer::TooSoon(_)), "{answer:?}");
        })
    }

    /// Runs the gateway for this time, and then drops it without a stop.
    pub(crate) async fn killed_after(self, span: Duration) -> Trace {
        Trial { is_killed: true, ..self }.run(span).await
    }

    /// Runs the gateway for this time, and then stops it.
    pub(crate) async fn run(self, span: Duration) -> Trace {
        let Trial { world, options, acts, is_killed } = self;
        let clock = world.clock.clone();
        let begin = clock.now();
        let directory = options.directory.clone();
        let gateway = Gateway::new(world.profile.clone(), &clock, options);
        let source = gateway.source();
        let (mut watcher, mut last) = (clock.join(), clock.join());
        drop(world.hold.take());
        let (mut samples, mut events, mut reported) = (Vec::new(), Vec::new(), 0);
        let mut acts = acts.into_iter().peekable();
        let mut asked = begin;
        let outcome = {
            let mut look = |at: Moment| {
                let mut status = source.status();
                let total: u64 = status.event_counts.values().sum();
                let new = usize::try_from(total - reported).unwrap();
                reported = total;
                let kept = status.events.len();
                events.extend(status.events.drain(kept - new.min(kept)..));
                status.events.clear();
                samples.push(Sample { at, status });
            };
            let outcome = {
                let watch = async {
                    loop {
                        let now = watcher.now();
                        while let Some((_, act)) = acts.next_if(|(after, _)| now >= begin.after(*after)) {
                            act(&Stage { source: &source, clock: &clock });
                        }
                        look(now);
                        let second = now.since(begin).as_secs();
                        if let Some(directory) = directory.as_deref().filter(|_| second.is_multiple_of(20)) {
                            catches_up(directory, Duration::from_millis(2));
                        }
                        watcher.sleep_until(now.next_tick(begin, SAMPLE_EVERY)).await;
                    }
                };
                let over = async {
                    last.sleep_until(begin.after(span)).await;
                    asked = last.now();
                    drop(last);
                };
                let run = async {
                    if !is_killed {
                        return gateway.run(over, std::future::pending()).await;
                    }
                    tokio::select! {
                        outcome = gateway.run(std::future::pending(), std::future::pending()) => outcome,
                        () = over => Outcome { failed: false, rested: false, left: String::new(), handover: None },
                    }
                };
                tokio::select! {
                    outcome = run => outcome,
                    never = watch => never,
                    error = world.machine.failure() => panic!("{error}"),
                }
            };
            look(clock.now());
            outcome
        };
        world.hold = Some(clock.hold());
        if is_killed {
            // No time passes, and its disk contains everything that it was given.
            directory.iter().for_each(|directory| catches_up(directory, Duration::from_millis(500)));
        }
        let ended = clock.now();
        let wire = world.machine.window().requests();
        let wire = wire.into_iter().filter(|seen| seen.at >= begin).collect();
        let taken = world.machine.window().taken();
        let taken = taken.into_iter().filter(|taken| taken.at >= begin).collect();
        let profile = world.profile.clone();
        Trace { profile, begin, samples, events, wire, taken, outcome, stopped: (asked, ended) }
    }
}

impl Trace {
    /// Number of events of this kind.
    pub(crate) fn reported(&self, kind: &str) -> usize {
        self.events.iter().filter(|event| event.kind == kind).count()
    }

    /// All events as lines, for the message of a failed test.
    pub(crate) fn lines(&self) -> String {
        self.events
            .iter()
            .map(|event| format!("{} {}: {}\n", &event.at[11..19], event.kind, event.text))
            .collect()
    }

    /// States of the first axis before it was stopping.
    pub(crate) fn states(&self) -> Vec<&'static str> {
        let states = self.samples.iter().filter(|sample| sample.at <= self.stopped.0);
        let mut states: Vec<_> = states.map(|sample| sample.status.axes[0].state).collect();
        states.dedup();
        states
    }

    /// States of the first axis between two times of the run, s.
    pub(crate) fn states_between(&self, from: u64, to: u64) -> Vec<&'static str> {
        let mut states: Vec<_> = self.between(from, to).map(|sample| sample.status.axes[0].state).collect();
        states.dedup();
        states
    }

    pub(crate) fn between(&self, from: u64, to: u64) -> impl Iterator<Item = &Sample> {
        let at = |seconds| self.begin.after(Duration::from_secs(seconds));
        self.samples.iter().filter(move |sample| sample.at >= at(from) && sample.at <= at(to))
    }

    /// Qualities of a signal between two times of the run, s.
    pub(crate) fn qualities(&self, signal: &str, from: u64, to: u64) -> Vec<&'static str> {
        let of = |sample: &Sample| {
            sample.status.signals.iter().find(|known| known.name == signal).map(|known| known.quality)
        };
        let mut qualities: Vec<_> = self.between(from, to).filter_map(of).collect();
        qualities.dedup();
        qualities
    }

    /// Values written to an output, in its unit and in the order of the wire.
    pub(crate) fn writes(&self, output: &str) -> Vec<(Moment, f64)> {
        let output = self.profile.outputs.iter().find(|known| known.name == output).unwrap();
        let writes = self.wire.iter().filter_map(|seen| law::of_output(seen, output));
        writes.map(|seen| (seen.at, output.encoding.decode(&seen.wanted).unwrap())).collect()
    }

    /// Counts of the heartbeat.
    pub(crate) fn beats(&self) -> Vec<u16> {
        let Some(heartbeat) = &self.profile.heartbeat else { return Vec::new() };
        let beats = self.wire.iter().filter(|seen| {
            seen.is_write() && seen.device == heartbeat.device && seen.address == heartbeat.address
        });
        beats.map(|seen| seen.wanted[0]).collect()
    }

    /// Time since the start of the run, s.
    pub(crate) fn seconds(&self, at: Moment) -> f64 {
        at.since(self.begin).as_secs_f64()
    }
}
