//! The measure of every attack: meanwhile the machine is held on time.

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

/// Polls stay within this of their time, whoever attacks.
const WITHIN: Duration = Duration::from_millis(50);
/// A computer that lets everybody be later than this has stood still: that is rare, or the measure is none.
const STOOD_STILL: Duration = Duration::from_millis(250);
/// A computer that is later than this is busy: then nobody knows how late one poll would have been on an idle one.
const BUSY: Duration = Duration::from_millis(10);
/// Either may happen once, and at one poll of so many.
const RARELY: usize = 50;

/// As long as this lives, the device is polled on time, by its own clock: else the test fails where it ends.
pub(crate) struct OnTime {
    device: Device,
    every: Duration,
    from: Moment,
    /// What the gateway waits for a processor.
    starved: Starved,
    before: Work,
}

impl OnTime {
    /// From the next poll on, by the gateway of this number.
    pub(crate) fn from_now(device: &Device, every: Duration, gateway: u32) -> OnTime {
        for control in CONTROLS.iter() {
            next_poll(&control.0);
        }
        let (starved, before) = (Starved::of(gateway), Work::now());
        OnTime { device: device.clone(), every, from: next_poll(device), starved, before }
    }

    /// The polls that came later than they may, where this computer itself was not late.
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
            match () {
                () if over > WITHIN + excused && (excused <= BUSY || over > STOOD_STILL + excused) => {
                    late.push(line);
                }
                () if over > WITHIN + excused.min(STOOD_STILL) => void.push(line),
                () => {}
            }
        }
        let test = std::thread::current().name().unwrap_or_default().to_owned();
        if excused_ones > 0 {
            // Not by `println!`: of a test that holds nobody would see it.
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

/// How late this computer itself was about this span.
pub(crate) fn excused(from: Moment, to: Moment) -> Duration {
    CONTROLS.iter().map(|control| control.worst(from, to)).max().unwrap_or_default()
}

/// When the device was polled.
pub(crate) fn polls(state: &State) -> Vec<Moment> {
    let is_poll = |seen: &&Seen| matches!(seen.what, What::Asked { .. });
    state.seen.iter().filter(is_poll).map(|seen| seen.at).collect()
}

fn next_poll(device: &Device) -> Moment {
    let now = device.now();
    let next = |state: &State| polls(state).last().copied().filter(|at| *at >= now);
    device.wait(PATIENCE, next).expect("the device is polled no more")
}

/// A machine that nobody attacks, held by a gateway in this process: as late as its polls come, so late does this computer let
/// anybody's be.
struct Control(Device);

/// It is polled more often than any other: whatever delays one of theirs is to be seen in one of its own.
const CONTROLLED_EVERY: Duration = Duration::from_millis(50);
/// What delays the one delays the other a moment before or after it.
const BESIDE: Duration = Duration::from_secs(1);
/// Where there are more cores, a process that has none finds one.
const MOST_CORES: usize = 8;

/// One on each core: the others may be idle while whoever is on one waits.
static CONTROLS: LazyLock<Vec<Control>> = LazyLock::new(|| {
    let cores = core_affinity::get_core_ids().unwrap_or_default();
    assert!(!cores.is_empty(), "which cores this process may use is not known");
    cores.into_iter().take(MOST_CORES).map(Control::on).collect()
});

impl Control {
    fn on(core: CoreId) -> Control {
        let (tells, told) = channel();
        // Until this process ends. Device and gateway are there, too: threads stay where they were begun.
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
        Control(told.recv().unwrap())
    }

    /// The latest that it was polled about this span.
    fn worst(&self, from: Moment, to: Moment) -> Duration {
        let (from, to) = (from.before(BESIDE), to.after(BESIDE));
        let polls = polls(&self.0.state());
        let about = polls.windows(2).filter(|pair| pair[1] >= from && pair[0] <= to);
        about.map(|pair| pair[1].since(pair[0]).saturating_sub(CONTROLLED_EVERY)).max().unwrap_or_default()
    }
}

/// What the processors of this computer have done so far, in ticks.
#[derive(Clone, Copy, Default)]
struct Work {
    all: u64,
    idle: u64,
    /// Work of this test and of what it has started.
    own: u64,
}

impl Work {
    fn now() -> Work {
        let read = |path: &Path| std::fs::read_to_string(path).unwrap_or_default();
        let text = read(Path::new("/proc/stat"));
        let words = text.lines().next().unwrap_or_default().split_whitespace().skip(1);
        // For users, for the system, idle, and what others had of the computer below.
        let ticks: Vec<u64> = words.take(8).filter_map(|word| word.parse().ok()).collect();
        let group = worked(&read(Path::new("/proc/self/stat"))).map(|(group, _)| group);
        let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
        let worked = processes.filter_map(|process| worked(&read(&process.path().join("stat"))));
        let own = worked.filter(|(other, _)| Some(*other) == group).map(|(_, ticks)| ticks).sum();
        Work { all: ticks.iter().sum(), idle: ticks.iter().skip(3).take(2).sum(), own }
    }

    /// Whether others had more than a third of this computer since then.
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
    // Longer than a busy computer is late itself.
    std::thread::sleep(Duration::from_secs(4));
    machine.gateway.goes_on();
    next_poll(&machine.device);
    assert_ne!(on_time.late(), [""; 0]);
    // It would fail this test, too.
    std::mem::forget(on_time);
}
