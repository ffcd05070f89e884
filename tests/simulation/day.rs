//! Simulation of one machine by one seed. The gateway is killed, stopped, suspended and started again; operators use
//! the page.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::fieldbus::connection::Dial;
use isotherm::fieldbus::kinds::opcua::namespaces::NamespaceTable;
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::status::GatewayApi;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Profile, parse};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use tokio::sync::Notify;

use crate::disk::MemoryDisk;
use crate::framing::Framing;
use crate::laws::Laws;
use crate::link::{Counts, Note, World};
use crate::machine::{CNC, LINES, Machine, X, Y};
use crate::people::People;
use crate::scene::Scene;
use crate::script::{self, Happening};
use crate::stream::{Shared, SimulatedDial};
use crate::time::Passage;

const SECOND: Duration = Duration::from_secs(1);
/// Interval at which an operator checks the page.
const VISIT: Duration = Duration::from_secs(20);
/// Wall-clock time of the computer at the start, if its clock is correct.
const BEGIN: Moment = Moment::from_nanos(1_767_225_600_000_000_000);

/// A rule that is removed from the gateway, to show that it is necessary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Without {
    Nothing,
    /// The age of a reading is counted from the request.
    Age,
    /// The namespace of a server is identified by its URI.
    Uris,
}

/// Result of a simulation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Outcome {
    pub(crate) ran: Duration,
    pub(crate) counts: Counts,
    pub(crate) changes: u64,
    pub(crate) taken: u64,
    /// Number of registers that returned from values read with other settings.
    pub(crate) went_back: u64,
    /// Hash of all notes; equal in two runs of one seed.
    pub(crate) fingerprint: u64,
    /// First violation, with the notes before it.
    pub(crate) breach: Option<String>,
}

pub(crate) const TEXT: &str = include_str!("profile.toml");

pub(crate) fn profile() -> Profile {
    parsed(TEXT)
}

/// Profile of the machine without a check of its module.
pub(crate) fn profile_without_checks() -> Profile {
    parsed(&text_without_checks())
}

pub(crate) fn text_without_checks() -> String {
    TEXT.replace("verify = [{ register = \"holding:60\", equals = 7, what = \"type code\" }]\n", "")
}

/// Profile of the machine in which sensors and control are OPC UA servers.
pub(crate) fn profile_of_nodes() -> Profile {
    let mut text = TEXT.to_owned();
    for line in ["sensors", "cnc"] {
        let modbus = format!("type = \"modbus-tcp\"\naddress = \"{line}:502\"");
        let opcua = format!("type = \"opcua\"\nsecurity = \"none\"\naddress = \"opc.tcp://{line}:4840\"");
        text = text
            .replace(&modbus, &opcua)
            .replace(&format!("bus = \"{line}\"\nunit = 1"), &format!("bus = \"{line}\""));
    }
    let inputs = "device = \"thermocouples\"\n";
    text = text.replace(&format!("{inputs}register = \""), &format!("{inputs}node = \"ns=1;s="));
    text = text.replace("{ register = \"holding:60\",", "{ node = \"ns=1;s=holding:60\", type = \"u16\",");
    for register in ["holding:10", "holding:20"] {
        text = text.replace(&format!("register = \"{register}\""), &format!("node = \"ns=1;s={register}\""));
    }
    parsed(&text.replace("register = \"holding:50\"", "node = \"ns=1;s=holding:50\"\ntype = \"i16\""))
}

pub(crate) fn parsed(text: &str) -> Profile {
    let parsed = parse(Path::new("simulation.toml"), text, &[], &[]);
    parsed.unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Runs the machine of this seed for this time.
pub(crate) fn run(scene: &Scene, seed: u64, span: Duration, without: Without) -> Outcome {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build();
    let runtime = runtime.unwrap_or_else(|error| panic!("no runtime: {error}"));
    runtime.block_on(async { Day::begin(scene, seed, without).run(span).await })
}

struct Day<'a> {
    scene: &'a Scene,
    random: Pcg32,
    passage: Passage,
    shared: Shared,
    disk: MemoryDisk,
    disk_full_until: Duration,
    without: Without,
    next: (Duration, Happening),
    visits_at: Duration,
    people: People,
    /// Pending edit, until a time at which an operator may enter it.
    edit: Option<(usize, u16, i64)>,
}

/// Reason for the end of a run of the gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Killed,
    Stopped,
    Over,
}

impl<'a> Day<'a> {
    fn begin(scene: &'a Scene, seed: u64, without: Without) -> Day<'a> {
        let mut random = Pcg32::seed_from_u64(seed);
        let passage = Passage::begin();
        let his = random.random_range(-90..90);
        let phases = [(); 4].map(|()| random.random_range(0.0..1.0));
        let machine = Machine::new(phases, scene.beyond.bases(), Laws::new(his));
        let disk = MemoryDisk::default();
        let random_of_lines = Pcg32::seed_from_u64(seed ^ 0x5eed);
        let mut world = World::new(machine, random_of_lines, passage.clone(), disk.is_dead.clone());
        world.servers.are_there = scene.profile.buses.iter().any(|bus| bus.opcua.is_some());
        for bus in &scene.profile.buses {
            let line = LINES.iter().position(|name| *name == bus.name);
            line.into_iter().for_each(|line| world.lines[line].framing = Framing::of(bus.transport));
        }
        let next = script::next(&mut random, scene.beyond, Happening::Look, Duration::ZERO);
        Day {
            scene,
            random,
            shared: Shared(Arc::new(Mutex::new(world))),
            passage,
            disk,
            disk_full_until: Duration::ZERO,
            without,
            next,
            visits_at: VISIT,
            people: People::default(),
            edit: None,
        }
    }

    async fn run(mut self, span: Duration) -> Outcome {
        loop {
            match self.run_gateway(span).await {
                End::Over => break,
                End::Killed | End::Stopped => {
                    let pause = Duration::from_millis(self.random.random_range(50..40_000));
                    let until = self.passage.now() + pause;
                    self.absent(until).await;
                }
            }
        }
        let world = self.shared.world();
        let laws = &world.machine.laws;
        let breach = laws.broken.clone().map(|why| story(&world, &why));
        Outcome {
            ran: world.passage.now(),
            counts: Counts { noticed: laws.signs.noticed, ..world.counts },
            changes: laws.changes,
            taken: laws.taken_count,
            went_back: laws.panel.went_back,
            fingerprint: world.fingerprint,
            breach,
        }
    }

    /// Simulates the machine without a gateway until this time.
    async fn absent(&mut self, until: Duration) {
        while self.passage.now() < until {
            let at = until.min(self.next.0);
            self.passage.timer(at).await;
            if self.passage.now() >= self.next.0 {
                // There is no gateway that could be killed or stopped.
                let _ = self.happens(None);
            }
        }
    }

    /// Runs the gateway once, until an event ends it.
    async fn run_gateway(&mut self, span: Duration) -> End {
        {
            let mut world = self.shared.world();
            world.bury();
            world.counts.runs += 1;
            world.machine.laws.begins();
        }
        let wrong = match self.random.random_range(0..8) {
            0 => Duration::from_secs(86_400 * 300),
            1 => Duration::from_secs(3600 * self.random.random_range(1..48)),
            _ => Duration::ZERO,
        };
        let clock = Clock::set_to(BEGIN.after(self.passage.now()).before(wrong), self.passage.passing());
        let (shared, without) = (self.shared.clone(), self.without);
        let dialer = move |bus: &isotherm_profile::Bus| {
            let line = LINES.iter().position(|name| *name == bus.name)?;
            let has_nodes = bus.opcua.is_some();
            let namespaces = (has_nodes && without != Without::Uris).then(NamespaceTable::default);
            let (shared, starts) = (shared.clone(), [None; 2]);
            Some(Box::new(SimulatedDial { shared, line, has_nodes, namespaces, starts }) as Box<dyn Dial>)
        };
        let options = Options {
            directory: Some(PathBuf::from("/state")),
            disk: Arc::new(self.disk.clone()),
            has_threads: false,
            dialer: Arc::new(dialer),
            is_unchecked: self.without == Without::Age,
            ..Options::default()
        };
        let gateway = Gateway::new(self.scene.profile.clone(), &clock, options);
        let source = gateway.source();
        let stop = Notify::new();
        let mut is_stopping = false;
        let running = gateway.run(stop.notified(), std::future::pending());
        let mut running = Box::pin(running);
        loop {
            let now = self.passage.now();
            if now >= span || self.shared.world().machine.laws.broken.is_some() {
                return End::Over;
            }
            let killed = self.shared.world().is_killed;
            if killed {
                return self.dies();
            }
            let at = self.next.0.min(self.visits_at).min(now + SECOND);
            tokio::select! {
                biased;
                _ = &mut running => return End::Stopped,
                () = self.passage.timer(at) => {}
            }
            let now = self.passage.now();
            self.disk.is_full.store(now < self.disk_full_until, Ordering::Relaxed);
            self.types(now);
            if now >= self.next.0 {
                match self.happens(Some(&source)) {
                    Some(End::Killed) => return self.dies(),
                    Some(_) if !is_stopping => {
                        is_stopping = true;
                        stop.notify_one();
                    }
                    _ => {}
                }
            }
            if now >= self.visits_at {
                self.visits_at = now + VISIT;
                self.people.visit(&mut self.shared.world(), &source, now);
            }
        }
    }

    fn dies(&self) -> End {
        let mut world = self.shared.world();
        world.kill();
        let now = self.passage.now();
        world.did(now, "killed", 0);
        End::Killed
    }

    /// Executes the due event. Returns the reason if the event ends the gateway.
    fn happens(&mut self, source: Option<&Arc<dyn GatewayApi>>) -> Option<End> {
        let (_, what) = self.next;
        let now = self.passage.now();
        let mut end = None;
        let mut world = self.shared.world();
        world.pass(now);
        world.counts.faults += u64::from(!matches!(what, Happening::Calm | Happening::Look));
        match what {
            Happening::Edit(change) => self.edit = Some((CNC, Y, change)),
            Happening::Foreign(value) => self.edit = Some((CNC, X, value)),
            Happening::FullDisk(span) => {
                self.disk_full_until = now + span;
                // The gateway must write its promises to disk before it writes to the control.
                world.keeps_waiting(CNC, now + span);
                world.did(now, "the disk is full for s", span.as_secs());
            }
            Happening::Kill => end = Some(End::Killed),
            Happening::Stop => {
                world.did(now, "stopped", 0);
                end = Some(End::Stopped);
            }
            Happening::Look => {
                let why = source.and_then(|source| self.people.what_is_wrong(&mut world, source, now));
                if let Some(why) = why {
                    world.machine.laws.broken.get_or_insert(why);
                }
            }
            Happening::Calm => {
                (self.disk_full_until, self.edit) = (now, None);
                script::befalls(&mut world, what, now);
            }
            _ => script::befalls(&mut world, what, now),
        }
        drop(world);
        self.next = script::next(&mut self.random, self.scene.beyond, what, now);
        end
    }

    /// Writes the pending edit of the operator or of another client, while no request is under way.
    fn types(&mut self, now: Duration) {
        let Some((line, at, value)) = self.edit else { return };
        let mut world = self.shared.world();
        world.pass(now);
        let is_quiet = now.saturating_sub(world.lines[line].used_at) > Duration::from_millis(60);
        let register = world.machine.laws.registers.iter().find(|one| one.line == line && one.at == at);
        let Some(register) = register.filter(|_| is_quiet && !world.is_held(line)) else { return };
        let to = if at == Y { register.value + value } else { value };
        // An operator does not enter a value under way, a recently sent value, or zero. The gateway must also have read
        // the register after a restart of the control, and after a late write: otherwise it sees two changes as one.
        if to == 0 || register.was_sent(to, now) || !register.is_known() || !register.is_shown() {
            return;
        }
        let change = to - register.value;
        self.edit = None;
        world.note(now, Note::Did(if at == Y { "the operator types" } else { "somebody else writes" }, to));
        world.machine.puts(line, at, to, now);
        if at == Y {
            world.machine.laws.registers[1].his += change;
        }
    }
}

/// Text of a violation, with the notes before it.
fn story(world: &World, why: &str) -> String {
    let mut story = String::new();
    for (at, note) in world.notes.iter().skip(world.notes.len().saturating_sub(90)) {
        let _ = writeln!(story, "{:>14.3} s  {note:?}", at.as_secs_f64());
    }
    let _ = writeln!(story, "{:>14.3} s  {why}", world.passage.now().as_secs_f64());
    story
}
