//! Measure of every attack: the machine must be polled on time meanwhile.

use std::io::Write;
use std::net::TcpListener;
use std::path::Path;
use std::sync::LazyLock;
use std::sync::mpsc::channel;
use std::time::Duration;

use core_affinity::CoreId;
use isotherm::gateway::Options;
use isotherm_core::quantity::Moment;

use crate::device::gateway::beside;
use crate::device::{Device, Seen, State, Times, What, profile};
use crate::process::PATIENCE;
use crate::rig::Machine;
use crate::support::starved::{Starved, worked};
use crate::support::tell;

/// Largest allowed delay of a poll during an attack.
const WITHIN: Duration = Duration::from_millis(50);
/// Delay of the computer itself above which it must have stalled. This must be rare, otherwise the measurement is
/// invalid.
const STOOD_STILL: Duration = Duration::from_millis(250);
/// Delay of the computer above which it counts as busy. The delay of a single poll is then not meaningful.
const BUSY: Duration = Duration::from_millis(10);
/// Each of these may occur once, and in one of this number of polls.
const RARELY: usize = 50;

/// Guard that asserts at its drop that the device was polled on time, by the clock of the device.
pub(crate) struct OnTime {
    device: Device,
    every: Duration,
    from: Moment,
    /// Time for which the gateway waited for a processor.
    starved: Starved,
    before: Work,
}

impl OnTime {
    /// Begins with the next poll, for the gateway with this process id.
    pub(crate) fn from_now(device: &Device, every: Duration, gateway: u32) -> OnTime {
        for control in CONTROLS.iter() {
            next_poll(&control.0);
        }
        let (starved, before) = (Starved::of(gateway), Work::now());
        OnTime { device: device.clone(), every, from: next_poll(device), starved, before }
    }

    /// Polls that came too late although the computer itself was not late.
    fn late(&self) -> Vec<String> {
        let polls: Vec<Moment> =
            polls(&self.device.state()).into_iter().filter(|at| *at >= self.from).collect();
        let (mut late, mut void) = (Vec::new(), Vec::new());
        let (mut excused_ones, mut most) = (0, Duration::ZERO);
        for pair in polls.windows(2) {
            let [one, next] = [pair[0], pair[1]];
            let over = next.since(one).saturating_sub(self.every);
            if over <= WITHIN {
                continue;
            }
            let excused = excused(one, next).max(self.starved.between(one, next));
            let line = format!("{over:?} late at {next}, the computer {excused:?}");
            (excused_ones, most) = (excused_ones + 1, most.max(over));
            // After a stall of the computer all programs catch up at once, which takes up to as long again.
            let stalled = STOOD_STILL.max(excused) + excused;
            match () {
                () if over > WITHIN + excused && (excused <= BUSY || over > stalled) => late.push(line),
                () if over > WITHIN + excused.min(STOOD_STILL) => void.push(line),
                () => {}
            }
        }
        let test = std::thread::current().name().unwrap_or_default().to_owned();
        if excused_ones > 0 {
            // `println!` would hide the line if the test passes.
            let _ = writeln!(
                std::io::stderr(),
                "{test}: of {} polls {excused_ones} later than {WITHIN:?} beside the computer's own lateness, {most:?} at most",
                polls.len()
            );
        }
        if void.len() > 1 + polls.len() / RARELY {
            if Work::now().is_shared_since(self.before) {
                let (void, all) = (void.len(), polls.len());
                tell(&format!("{test}: {void} of {all} polls are void: others had a third of the computer"));
            } else {
                late.append(&mut void);
            }
        }
        late
    }
}

impl Drop for OnTime {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            next_poll(&self.device);
            let late = self.late();
            assert!(late.is_empty(), "{late:#?}");
        }
    }
}

/// Delay of this computer itself around this time span.
pub(crate) fn excused(from: Moment, to: Moment) -> Duration {
    CONTROLS.iter().map(|control| control.worst(from, to)).max().unwrap_or_default()
}

/// Times at which the device was polled.
pub(crate) fn polls(state: &State) -> Vec<Moment> {
    let is_poll = |seen: &&Seen| matches!(seen.what, What::Asked { .. });
    state.seen.iter().filter(is_poll).map(|seen| seen.at).collect()
}

fn next_poll(device: &Device) -> Moment {
    let now = device.now();
    let next = |state: &State| polls(state).last().copied().filter(|at| *at >= now);
    device.wait(PATIENCE, next).expect("the device is polled no more")
}

/// A machine without an attack, compensated by a gateway in this process. The delay of its polls shows the delay that
/// the computer causes for all programs.
struct Control(Device);

/// Poll interval of the control machine. It is shorter than that of all others, so that every stall is visible in it.
const CONTROLLED_EVERY: Duration = Duration::from_millis(50);
/// Time before and after a delay in which the control machine may show the same delay.
const BESIDE: Duration = Duration::from_secs(1);
/// Maximum number of control machines. With more cores, a waiting process finds a free one.
const MOST_CORES: usize = 8;

/// One control machine on each core: the other cores may be idle while a process waits for one.
static CONTROLS: LazyLock<Vec<Control>> = LazyLock::new(|| {
    let cores = core_affinity::get_core_ids().unwrap_or_default();
    assert!(!cores.is_empty(), "which cores this process may use is not known");
    cores.into_iter().take(MOST_CORES).map(Control::on).collect()
});

impl Control {
    fn on(core: CoreId) -> Control {
        let (tells, reported) = channel();
        // Runs until this process ends. Device and gateway run on the same core, because threads keep the affinity of
        // their creator.
        std::thread::spawn(move || {
            assert!(core_affinity::set_for_current(core));
            let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
            let times = Times {
                timeout: Duration::from_secs(5),
                every: CONTROLLED_EVERY,
                max_age: Duration::from_secs(5),
            };
            let text = profile(device.address(), times).replace("\"100ms\" }", "\"1ms\" }");
            tells.send(device).unwrap();
            beside(&text, Options::default(), |_| {
                loop {
                    std::thread::park()
                }
            })
        });
        Control(reported.recv().unwrap())
    }

    /// Longest delay of its polls around this time span.
    fn worst(&self, from: Moment, to: Moment) -> Duration {
        let (from, to) = (from.before(BESIDE), to.after(BESIDE));
        let polls = polls(&self.0.state());
        let about = polls.windows(2).filter(|pair| pair[1] >= from && pair[0] <= to);
        about.map(|pair| pair[1].since(pair[0]).saturating_sub(CONTROLLED_EVERY)).max().unwrap_or_default()
    }
}

/// Work of this computer's processors so far, in ticks.
#[derive(Clone, Copy, Default)]
struct Work {
    all: u64,
    idle: u64,
    /// Work of this test and of the programs that it has started.
    own: u64,
}

impl Work {
    fn now() -> Work {
        let read = |path: &Path| std::fs::read_to_string(path).unwrap_or_default();
        let text = read(Path::new("/proc/stat"));
        let words = text.lines().next().unwrap_or_default().split_whitespace().skip(1);
        // Ticks for users, for the system, idle ones, and those of other virtual machines.
        let ticks: Vec<u64> = words.take(8).filter_map(|word| word.parse().ok()).collect();
        let group = worked(&read(Path::new("/proc/self/stat"))).map(|(group, _)| group);
        let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
        let worked = processes.filter_map(|process| worked(&read(&process.path().join("stat"))));
        let own = worked.filter(|(other, _)| Some(*other) == group).map(|(_, ticks)| ticks).sum();
        Work { all: ticks.iter().sum(), idle: ticks.iter().skip(3).take(2).sum(), own }
    }

    /// Returns whether other programs had more than a third of this computer since then.
    fn is_shared_since(self, before: Work) -> bool {
        let [all, idle, own] = [
            self.all.saturating_sub(before.all),
            self.idle.saturating_sub(before.idle),
            self.own.saturating_sub(before.own),
        ];
        3 * all.saturating_sub(idle + own) > all
    }
}

#[test]
fn a_machine_whose_gateway_stands_still_for_seconds_is_not_held_on_time() {
    let machine = Machine::start(None, &[], "");
    let on_time = machine.on_time();
    assert_eq!(on_time.late(), [""; 0]);
    machine.gateway.stands_still();
    // The delay is longer than that of a busy computer.
    std::thread::sleep(Duration::from_secs(4));
    machine.gateway.resumes();
    next_poll(&machine.device);
    assert_ne!(on_time.late(), [""; 0]);
    // The guard would fail this test as well.
    std::mem::forget(on_time);
}
