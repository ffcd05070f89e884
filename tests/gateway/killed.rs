//! Invariant I12: the program is killed at any instant and started again. Operator offset and gateway share in a
//! register are then as before or as intended. The program itself is killed (SIGKILL) hundreds of times. The register
//! stays alive in this process, and an operator changes it from time to time.
//!
//! The true division is counted from the wire. A write of the gateway changes the gateway share by the change of the
//! register. An edit of the operator (thousands of counts) changes the operator offset. When the gateway arms, it
//! reports the share that it assumes.
//!
//! Half of the instants count from a message of the gateway, so that a slow computer delays them with the gateway. The
//! devices must not process a write after `late`, so their thread measures its own delay. A life in which the delay was
//! too long is void. The machine then starts again, and another life replaces it.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::virtual_machine::{Ports, Setup, VirtualMachine, Window};
use isotherm_core::quantity::Moment;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::support::process;
use crate::support::tell;

use process::{Running, file, isotherm};

/// Independent machines, each with its own register, disk and gateway.
const LANES: u64 = 10;
/// Kills of all machines together; `TEST_KILLS=1000` sets another number.
const KILLS: u64 = 300;
/// Longest life of a gateway after its start, or after it has armed, ms. In this time it starts, arms, and makes a
/// dozen changes.
const LONGEST_LIFE: u64 = 700;
/// Longest delay of the devices, ms. It is half of `late`, because a write may be under way for as long before they see
/// it.
const LATEST: u64 = 75;
/// Limit of void lives of one machine, and of its time. A computer that is too busy ends it with fewer kills.
const MOST_VOID: u64 = 100;
const LONGEST: Duration = Duration::from_secs(300);

/// Largest change of one write, in counts of 0.1 µm.
const STEP: i32 = 10;

const PROFILE: &str = r#"
[machine]
name = "joint"
arm = "auto"
[bus.cell]
type = "modbus-tcp"
address = "ADDRESS"
timeout = "50ms"
late = "150ms"
[device.module]
bus = "cell"
unit = 1
every = "25ms"
[device.cnc]
bus = "cell"
unit = 2
[signal.bed]
device = "module"
register = "input:0"
type = "i16"
scale = 0.1
unit = "degC"
range = [10.0, 40.0]
max_rate = "none"
max_age = "5s"
[axis.z]
limit = 40.0
step = 1.0
rate = 1000.0
deadband = 0.1
every = "25ms"
on_fault = { action = "zero" }
[[axis.z.model]]
name = "there"
kind = "linear"
offset = OFFSET
terms = [ { signal = "bed", gain = 0.01, reference = 0.0 } ]
[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
register = "holding:104"
type = "i32"
word_order = "msw-first"
scale = 0.1
share = "ledger"
"#;

/// Message that the two parts of a shared register are known.
const OPENED: &str = "the operator offset is";
/// Message of a gateway that arms.
const ARMED: &str = "armed, starting from";
/// Messages of a gateway that needs the operator to confirm the division, or knows of no share.
const QUESTION: &str = "the gateway share in it is assumed to be";
const FIRST: &str = "the gateway share in it is not known";
/// Last message of a gateway whose time to stop was not enough.
const BEFORE: &str = "isotherm: stopped before the fault actions were complete";

/// Operator at the CNC, who reads and writes the whole register.
struct Operator(TcpStream);

impl Operator {
    fn ask(&mut self, pdu: &[u8]) -> Vec<u8> {
        let length = u8::try_from(pdu.len() + 1).unwrap();
        let mut request = vec![0, 1, 0, 0, 0, length, 2];
        request.extend(pdu);
        self.0.write_all(&request).unwrap();
        let mut header = [0; 7];
        self.0.read_exact(&mut header).unwrap();
        let mut answer = vec![0; usize::from(header[5]) - 1];
        self.0.read_exact(&mut answer).unwrap();
        assert_eq!(answer[0], pdu[0], "{answer:?}");
        answer
    }

    fn read(&mut self) -> i32 {
        let answer = self.ask(&[3, 0, 104, 0, 2]);
        i32::from_be_bytes(answer[2..6].try_into().unwrap())
    }

    fn write(&mut self, counts: i32) {
        let mut pdu = vec![16, 0, 104, 0, 2, 4];
        pdu.extend(counts.to_be_bytes());
        self.ask(&pdu);
    }
}

/// The devices were so late that a write may have been processed after `late`. The reports of the gateway then prove
/// nothing.
#[derive(Debug)]
struct Void;

/// One machine with its gateway.
struct Lane {
    window: Window,
    /// Longest delay of the devices since this was last read, ms.
    behind: Arc<AtomicU64>,
    operator: Operator,
    home: tempfile::TempDir,
    up: PathBuf,
    down: PathBuf,
    /// Profile with very small decisions.
    still: PathBuf,
    /// True operator offset and gateway share, from the wire so far, counts.
    base: i32,
    share: i32,
    seen: usize,
    random: Pcg32,
    count: Count,
    clock: Clock,
    begun: Moment,
}

/// Number of events.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    kills: u64,
    writes: u64,
    armed: u64,
    edits: u64,
    /// Kills with a promise on disk that had arrived, and with one that had not.
    arrived: u64,
    outstanding: u64,
    questions: u64,
    voids: u64,
}

fn counts(words: &[u16]) -> i32 {
    i32::from(words[0].cast_signed()) << 16 | i32::from(words[1])
}

/// Parses "… {after}12.3 µm …" to counts of 0.1 µm.
fn reported(line: &str, after: &str) -> Option<i32> {
    let number = line.split(after).nth(1)?.split(' ').next()?;
    let micron: f64 = number.replace('−', "-").parse().ok()?;
    #[allow(clippy::cast_possible_truncation, reason = "a few hundred counts")]
    Some((micron * 10.0).round() as i32)
}

/// Shares that a gateway reports at its end: the one that was last verified, and each value that may still arrive.
fn shares(line: &str) -> Vec<i32> {
    let verified = reported(line, "holds ").or_else(|| reported(line, "held "));
    let arriving = line.split_once("may still arrive").map_or("", |(before, _)| before);
    let arriving = arriving.rsplit_once('(').map_or("", |(_, values)| values);
    let arriving = arriving.split(" or ").filter_map(|value| reported(&format!("or {value}"), "or "));
    verified.into_iter().chain(arriving).collect()
}

impl Lane {
    fn new(seed: u64, window: Window, behind: Arc<AtomicU64>, address: SocketAddr) -> Lane {
        let (home, clock) = (tempfile::tempdir().unwrap(), Clock::wall());
        let text = |offset: &str| PROFILE.replace("ADDRESS", &address.to_string()).replace("OFFSET", offset);
        Lane {
            window,
            behind,
            operator: Operator(TcpStream::connect(address).unwrap()),
            up: file(home.path(), "up.toml", &text("35.0")),
            down: file(home.path(), "down.toml", &text("-35.0")),
            still: file(home.path(), "still.toml", &text("0.0")),
            home,
            base: 0,
            share: 0,
            seen: 0,
            random: Pcg32::seed_from_u64(seed),
            count: Count::default(),
            begun: clock.now(),
            clock,
        }
    }

    fn run(&self, profile: &Path) -> Running {
        let state = self.home.path().join("state");
        Running::start(isotherm(self.home.path()).arg("run").arg(profile).arg("--state").arg(state))
    }

    /// Returns the register value after all earlier requests were processed. The last request of a gateway waits in the
    /// same thread as those of the operator. When the third request of the operator is answered, every connection has
    /// had its turn.
    fn settled(&mut self) -> i32 {
        self.operator.read();
        self.operator.read();
        self.operator.read()
    }

    /// Replaces a machine with a void observation by another one with the same devices.
    fn begins_again(&mut self) {
        self.count.voids += 1;
        let _ = std::fs::remove_dir_all(self.home.path().join("state"));
        self.settled();
        self.operator.write(0);
        (self.base, self.share, self.seen) = (0, 0, self.window.requests().len());
        self.behind.store(0, Ordering::SeqCst);
    }

    /// Continues the count from the wire. No write changes more than one step or goes beyond the limit, and nothing
    /// else writes.
    fn count_on(&mut self) -> Result<(), Void> {
        if self.behind.swap(0, Ordering::SeqCst) > LATEST {
            return Err(Void);
        }
        let wire = self.window.requests();
        for seen in &wire[self.seen..] {
            if !seen.is_write() || seen.address.register().unwrap().offset != 104 {
                continue;
            }
            let (before, wanted) = (counts(&seen.before), counts(&seen.wanted));
            assert_eq!(before, self.base + self.share, "nobody else writes");
            let change = wanted - before;
            if change.abs() >= 500 {
                self.base += change;
            } else {
                self.share += change;
                self.count.writes += 1;
                assert!(change.abs() <= STEP && self.share.abs() <= 400, "{change} to {}", self.share);
            }
        }
        self.seen = wire.len();
        Ok(())
    }

    /// Checks the document on disk at the moment of a kill.
    fn look_at_the_ledger(&mut self) {
        let path = self.home.path().join("state/joint.state.json");
        let Ok(text) = std::fs::read_to_string(path) else { return };
        let document: serde_json::Value = serde_json::from_str(&text).unwrap();
        let kept = &document["outputs"]["cnc_z"]["kept"];
        let account = &kept["account"];
        if account.is_null() {
            return;
        }
        let sum = account["base"].as_i64().unwrap() + account["share"].as_i64().unwrap();
        let stands = i64::from(self.base + self.share);
        let promised = kept["promises"].as_array().unwrap();
        let open = promised.iter().filter(|promise| promise["is_under_way"] == true);
        let mut open = open.map(|promise| promise["value"].as_i64().unwrap()).filter(|value| *value != sum);
        if open.clone().any(|value| value == stands) {
            self.count.arrived += 1;
        } else if open.next().is_some() {
            self.count.outstanding += 1;
        }
    }

    fn live_and_die(&mut self) -> Result<(), Void> {
        let profile = if self.random.next_u32().is_multiple_of(2) { &self.up } else { &self.down };
        let mut gateway = self.run(profile);
        if self.random.next_u32().is_multiple_of(2) {
            gateway.hears_one_of(&[ARMED, QUESTION, FIRST]);
        }
        std::thread::sleep(Duration::from_micros(self.random.random_range(0..LONGEST_LIFE * 1000)));
        let said = gateway.killed();
        let share = self.share;
        let mut register = self.settled();
        self.count_on()?;
        self.count.kills += 1;
        let text = said.join("\n");
        for line in said.iter().filter(|line| line.contains(ARMED)) {
            self.count.armed += 1;
            let starts = reported(line, "starting from ").unwrap();
            assert_eq!(starts, share, "the share that stood there, of {}\n{text}", self.base);
        }
        self.look_at_the_ledger();
        if said.iter().any(|line| line.contains(QUESTION) || line.contains(FIRST)) {
            self.answer()?;
            register = self.settled();
        }
        assert_eq!(register, self.base + self.share);
        if self.random.random_range(0..4) == 0 {
            let edit = 1000 * self.random.random_range(1..4) * if self.base > 0 { -1 } else { 1 };
            self.operator.write(register + edit);
            self.count.edits += 1;
            self.count_on()?;
        }
        Ok(())
    }

    /// Does what the gateway asks the operator to do, and arms.
    fn answer(&mut self) -> Result<(), Void> {
        self.count.questions += 1;
        let mut gateway = self.run(&self.up);
        let line = gateway.hears_one_of(&[QUESTION, FIRST]);
        let share = if line.contains(FIRST) { 0 } else { reported(&line, "assumed to be ").unwrap() };
        self.operator.write(self.base + share);
        self.count_on()?;
        assert_eq!(self.share, share, "at most one step from the truth: {line}");
        let mut arm = isotherm(self.home.path());
        let arm = arm.arg("arm").arg(&self.up).arg("--state").arg(self.home.path().join("state"));
        assert!(arm.status().unwrap().success());
        // The two messages come from two tasks, in any order.
        let is_opened = if gateway.hears_one_of(&[ARMED, OPENED]).contains(OPENED) {
            gateway.receives(ARMED);
            true
        } else {
            gateway.hears_one_of(&[OPENED, QUESTION]).contains(OPENED)
        };
        if !is_opened {
            // While the operator armed, the register may have received a write of the gateway. The operator then reads
            // it and confirms again. That is refused within one second of the last time.
            process::until("he is heard again", || match arm.output().unwrap() {
                output if output.status.success() => Ok(()),
                output => Err(String::from_utf8_lossy(&output.stderr).into_owned()),
            });
            gateway.receives(OPENED);
        }
        gateway.killed();
        self.settled();
        self.count_on()
    }

    /// Stops the last gateway, which takes its share back. Only the operator offset is left.
    fn end(mut self) -> Count {
        while self.takes_its_share_back().is_err() {
            self.begins_again();
            if !self.lives() {
                break;
            }
        }
        self.count
    }

    /// Runs lives until one is not void. Returns whether there is time for another.
    fn lives(&mut self) -> bool {
        while self.live_and_die().is_err() {
            self.begins_again();
            if self.is_over() {
                return false;
            }
        }
        !self.is_over()
    }

    /// Returns whether the computer is too busy for its devices.
    fn is_over(&self) -> bool {
        self.count.voids > MOST_VOID || self.clock.now().since(self.begun) > LONGEST
    }

    /// Stops a gateway until its share is taken back. If a stop was too short (each write waits for the disk), its
    /// report of the share must be true, and the next gateway continues.
    fn takes_its_share_back(&mut self) -> Result<(), Void> {
        const TRIES: usize = 100;
        let mut profile = self.up.clone();
        for _ in 0..TRIES {
            let said = self.stopped(&profile)?;
            let Some(line) = said.lines().find(|line| line.starts_with(BEFORE)) else {
                assert_eq!((self.operator.read(), self.share), (self.base, 0), "{said}");
                return Ok(());
            };
            assert!(shares(line).contains(&self.share), "{} in truth: {said}", self.share);
            // The share that a slow disk has left becomes smaller with each further stop.
            profile = self.still.clone();
        }
        panic!("{TRIES} times in a row it did not come to its end");
    }

    /// Runs a gateway that arms and is then stopped. Returns what it has printed.
    fn stopped(&mut self, profile: &Path) -> Result<String, Void> {
        let mut gateway = self.run(profile);
        if !gateway.hears_one_of(&[ARMED, QUESTION, FIRST]).contains(ARMED) {
            gateway.killed();
            self.answer()?;
            gateway = self.run(profile);
            gateway.receives(ARMED);
        }
        gateway.signal("TERM");
        gateway.ends_within(process::PATIENCE);
        self.settled();
        self.count_on()?;
        Ok(gateway.said.join("\n"))
    }
}

/// Measures the delay of the thread of the devices.
async fn measure(behind: Arc<AtomicU64>) {
    const TICK: Duration = Duration::from_millis(5);
    let clock = Clock::wall();
    loop {
        let begun = clock.now();
        tokio::time::sleep(TICK).await;
        let late = clock.now().since(begun).saturating_sub(TICK);
        behind.fetch_max(u64::try_from(late.as_millis()).unwrap(), Ordering::SeqCst);
    }
}

/// Runs a machine on a separate thread, because its devices must answer while a gateway is killed. Returns its counts.
fn lane(seed: u64, kills: u64) -> Count {
    let (tell, here) = channel();
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let behind = Arc::new(AtomicU64::new(0));
    let measured = behind.clone();
    let devices = std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let text = PROFILE.replace("ADDRESS", "127.0.0.1:1502").replace("OFFSET", "0.0");
            let profile = isotherm_profile::parse(Path::new("joint.toml"), &text, &[], &[]).unwrap().profile;
            let setup = Setup { ports: Ports::Free, journal: true, ..Setup::default() };
            let machine = VirtualMachine::start(&profile, setup, &Clock::wall()).await.unwrap();
            tell.send((machine.window(), machine.addresses()[0].1.parse().unwrap())).unwrap();
            tokio::select! {
                _ = stopped => {}
                () = measure(measured) => {}
            }
        });
    });
    let (window, address) = here.recv().unwrap();
    let mut lane = Lane::new(seed, window, behind, address);
    for _ in 0..kills {
        if !lane.lives() {
            break;
        }
    }
    let count = lane.end();
    drop(stop);
    devices.join().unwrap();
    count
}

#[test]
fn killed_at_hundreds_of_instants_no_share_is_ever_lost_or_doubled() {
    let kills = std::env::var("TEST_KILLS").map_or(KILLS, |text| text.parse().unwrap());
    let lanes: Vec<_> =
        (0..LANES).map(|seed| std::thread::spawn(move || lane(seed, kills / LANES))).collect();
    let counts: Vec<Count> = lanes.into_iter().map(|lane| lane.join().unwrap()).collect();
    let sum = |of: fn(&Count) -> u64| counts.iter().map(of).sum::<u64>();
    let all = Count {
        kills: sum(|count| count.kills),
        writes: sum(|count| count.writes),
        armed: sum(|count| count.armed),
        edits: sum(|count| count.edits),
        arrived: sum(|count| count.arrived),
        outstanding: sum(|count| count.outstanding),
        questions: sum(|count| count.questions),
        voids: sum(|count| count.voids),
    };
    println!("{all:?}");
    if all.kills < kills {
        return tell(&format!("only {} of {kills} kills: the computer was too busy: {all:?}", all.kills));
    }
    // The important instants must be among them.
    assert!(all.armed * 10 > kills * 3 && all.edits * 20 > kills * 3, "{all:?}");
    assert!(all.arrived * 300 > kills && all.outstanding * 300 > kills, "{all:?}");
}
