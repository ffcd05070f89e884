//! What the lines, the page and the commands share: one lock, held for microseconds, never across a wait.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use super::arming::Arming;
use super::board::Board;
use super::commissioning::Commissioning;
use super::dependents::Dependents;
use super::keeper::Keeper;
use super::ledger::Ledger;
use super::levels::LevelsTold;
use super::noted::Noted;
use super::output::Outputs;
use super::pause::Pauses;
use super::probing::Probing;
use super::restart::Restarts;
use crate::clock::{Bell, Clock};
use crate::observe::events::{Event, Journal};
use crate::observe::status::Command;
use isotherm_core::compensation::{AxisState, Compensation, Control, Remembered};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Arm, AxisId, BusId, Profile};

mod probing;
mod step;
mod stop;
mod tell;

pub(super) use probing::refused_in_words;

/// The gateway's state, shared by its tasks.
pub(crate) struct Shared {
    pub(crate) profile: Arc<Profile>,
    pub(crate) clock: Clock,
    pub(crate) journal: Arc<Journal>,
    pub(crate) dry_run: bool,
    pub(crate) started: Moment,
    pub(super) ledger: Ledger,
    pub(super) dependents: Dependents,
    bells: Mutex<Vec<Bell>>,
    /// By bus: how often there was something new for it, and the turns that it took.
    news: Vec<AtomicU64>,
    turns: Vec<AtomicU64>,
    core: Mutex<Core>,
}

/// What stands behind the lock.
pub(super) struct Core {
    pub(super) board: Board,
    pub(super) compensation: Compensation,
    pub(super) arming: Noted<Arming>,
    pub(super) probing: Noted<Probing>,
    pub(super) outputs: Outputs,
    /// By output: what is known of its register, where one task alone carries it out.
    pub(super) registers: Vec<Option<isotherm_core::output::State>>,
    pub(super) devices: Vec<DeviceCount>,
    pub(super) commissioning: Commissioning,
    pub(super) buses: Vec<BusCount>,
    pub(super) keeper: Keeper,
    pub(super) restarts: Restarts,
    /// By axis: when a change that it decided must have left at the latest.
    pub(super) not_after: Vec<Moment>,
    pub(super) pauses: Pauses,
    pub(super) stopping: bool,
    /// The lines end now: no strobe stays up.
    pub(super) leaving: bool,
    /// An axis has been armed since the start.
    pub(super) was_armed: bool,
    /// What an axis rests on has been read since the start.
    pub(super) has_read: bool,
    /// When the axes were stepped last.
    pub(super) stepped_at: Moment,
    /// When the next one is due.
    next_due: Option<Moment>,
    /// Something failed inside: the process ends with an error after the fault actions.
    pub(super) failed: bool,
    controls: Vec<Control>,
    /// Events of a step, told when the lock is free again.
    pub(super) untold: Vec<Event>,
    told_states: Vec<AxisState>,
    pub(super) levels: Vec<LevelsTold>,
    /// Told, and not come to its end.
    extrapolating: Vec<bool>,
}

/// Requests and failures of one device.
#[derive(Clone, Debug, Default)]
pub(super) struct DeviceCount {
    pub(super) requests: u64,
    pub(super) failures: BTreeMap<&'static str, u64>,
    pub(super) answered: bool,
    pub(super) lost: Option<Lost>,
}

/// A device that does not answer.
#[derive(Clone, Debug, Default)]
pub(super) struct Lost {
    pub(super) fault: String,
    /// Requests that failed since.
    pub(super) missed: u64,
    pub(super) told: bool,
    /// It answers again, since then.
    pub(super) answers_since: Option<Moment>,
}

/// Cycles of one line.
#[derive(Clone, Debug, Default)]
pub(super) struct BusCount {
    pub(super) connected: bool,
    /// Attempts to connect since it went down.
    pub(super) down: Option<u64>,
    pub(super) cycles: u64,
    pub(super) overruns: u64,
    /// The last of them.
    pub(super) overrun_at: Option<Moment>,
    pub(super) jitter: [u64; JITTER_MS.len() + 1],
}

/// Upper bounds of the jitter histogram, ms.
pub(super) const JITTER_MS: [f64; 7] = [0.5, 1.0, 2.0, 5.0, 10.0, 50.0, 200.0];

impl Shared {
    pub(super) fn new(
        profile: Arc<Profile>,
        clock: Clock,
        journal: Arc<Journal>,
        dry_run: bool,
        remembered: Remembered,
        (keeper, ledger): (Keeper, Ledger),
        bells: Vec<Bell>,
    ) -> Shared {
        let axes = profile.axes.iter().map(|axis| axis.settings.clone()).collect();
        let compensation = Compensation::new(profile.machine.clone(), axes, remembered);
        let core = Core {
            board: Board::new(&profile),
            next_due: compensation.next_due(),
            compensation,
            arming: Noted::new(vec![Arming::default(); profile.axes.len()]),
            probing: Noted::new(vec![Probing::default(); profile.axes.len()]),
            outputs: Outputs::new(&profile),
            registers: vec![None; profile.outputs.len()],
            devices: vec![DeviceCount::default(); profile.devices.len()],
            commissioning: Commissioning::new(&profile),
            buses: vec![BusCount::default(); profile.buses.len()],
            keeper,
            restarts: Restarts::new(&profile),
            not_after: vec![Moment::default(); profile.axes.len()],
            pauses: Pauses::default(),
            stopping: false,
            leaving: false,
            was_armed: false,
            has_read: false,
            stepped_at: Moment::default(),
            failed: false,
            untold: Vec::new(),
            controls: vec![Control::default(); profile.axes.len()],
            told_states: vec![AxisState::Off; profile.axes.len()],
            levels: vec![LevelsTold::default(); profile.axes.len()],
            extrapolating: vec![false; profile.axes.len()],
        };
        let dependents = Dependents::new(&profile);
        let started = clock.now();
        let counts = || profile.buses.iter().map(|_| AtomicU64::default()).collect();
        let (news, turns) = (counts(), counts());
        let (bells, core) = (Mutex::new(bells), Mutex::new(core));
        Shared { profile, clock, journal, dry_run, started, ledger, dependents, bells, news, turns, core }
    }

    /// A task that panicked while it held the lock has already stopped the gateway; what it left is still needed for
    /// the fault actions.
    pub(super) fn core(&self) -> MutexGuard<'_, Core> {
        self.core.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The same for whoever must not wait for it.
    pub(super) fn try_core(&self) -> Option<MutexGuard<'_, Core>> {
        match self.core.try_lock() {
            Ok(core) => Some(core),
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    /// Heartbeats and control words go on: from the first arming, or where the profile arms from the first good reading,
    /// until the process ends.
    pub(super) fn may_beat(&self) -> bool {
        let core = self.core();
        !self.dry_run && (core.was_armed || (self.profile.arm == Arm::Auto && core.has_read))
    }

    /// The axes were stepped as lately as they should be: a gateway whose lines live but whose head does not counts no beat.
    pub(super) fn head_lives(&self, now: Moment) -> bool {
        let every = self.profile.axes.iter().map(|axis| axis.settings.every).min();
        every.is_none_or(|every| now.since(self.core().stepped_at) <= every * 2)
    }

    /// Tells an event.
    pub(crate) fn tell(&self, event: &Event) {
        self.journal.tell(self.clock.now(), event);
    }

    /// Wakes every line.
    pub(super) fn ring(&self) {
        self.ring_where(|_| true);
    }

    /// Wakes every line but this one, which is awake.
    pub(super) fn ring_others(&self, bus: BusId) {
        self.ring_where(|place| place != bus.0);
    }

    /// Wakes this line.
    pub(super) fn ring_line(&self, bus: BusId) {
        self.ring_at(bus.0..bus.0 + 1, |_| true);
    }

    fn ring_where(&self, chosen: impl Fn(usize) -> bool) {
        self.ring_at(0..self.news.len(), chosen);
    }

    fn ring_at(&self, places: Range<usize>, chosen: impl Fn(usize) -> bool) {
        let bells = self.bells.lock().unwrap_or_else(PoisonError::into_inner);
        for place in places.filter(|place| chosen(*place)) {
            if let (Some(bell), Some(news)) = (bells.get(place), self.news.get(place)) {
                news.fetch_add(1, Ordering::Relaxed);
                bell.ring();
            }
        }
    }

    /// A line has taken a turn.
    pub(super) fn turned(&self, bus: BusId) {
        self.turns[bus.0].fetch_add(1, Ordering::Relaxed);
    }

    /// How many turns a line has taken.
    pub(super) fn turns(&self, bus: BusId) -> u64 {
        self.turns[bus.0].load(Ordering::Relaxed)
    }

    /// How often there was something new for a line: what a line that never sleeps hears of a bell.
    pub(super) fn news(&self, bus: BusId) -> u64 {
        self.news[bus.0].load(Ordering::Relaxed)
    }

    /// A line's task was started anew and sleeps elsewhere now.
    pub(super) fn hang_bell(&self, bus: BusId, bell: Bell) {
        let mut bells = self.bells.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(place) = bells.get_mut(bus.0) {
            *place = bell;
        }
    }

    /// Steps each axis that is due and wakes the other lines that may have to write what was decided. Called by the line
    /// that has just read its inputs. When the next axis is due.
    pub(super) fn advance(&self, bus: BusId, now: Moment) -> Option<Moment> {
        let (lines, due, events) = {
            let mut core = self.core();
            let lines = if core.advance(self, now) { core.lines_of_decisions(self, now) } else { Vec::new() };
            (lines, core.next_due, std::mem::take(&mut core.untold))
        };
        events.iter().for_each(|event| self.tell(event));
        for line in lines.into_iter().filter(|line| *line != bus) {
            self.ring_line(line);
        }
        due
    }

    /// What has become of the last request to arm: `None` as long as an axis waits for something.
    pub(crate) fn arming(&self) -> Option<Result<String, String>> {
        let core = self.core();
        let names = self.profile.axes.iter().map(|axis| axis.settings.name.as_str());
        let refused = core.arming.iter().zip(names.clone()).find_map(|(arming, name)| {
            let why = arming.refusal.as_ref().filter(|_| arming.asked)?;
            Some(format!("axis {name} is not armed: {why}"))
        });
        if let Some(refused) = refused {
            return Some(Err(refused));
        }
        let all = core.arming.iter().all(|arming| arming.armed && !arming.asked);
        all.then(|| Ok(format!("{}: armed", names.collect::<Vec<_>>().join(", "))))
    }

    /// Does what a person asks for.
    pub(crate) fn obey(&self, command: Command) -> Result<String, String> {
        let mut core = self.core();
        let mut events = Vec::new();
        let names: Vec<&str> = self.profile.axes.iter().map(|axis| axis.settings.name.as_str()).collect();
        let names = names.join(", ");
        let answer = match command {
            Command::Arm if core.stopping => return Err("the gateway is stopping".to_owned()),
            Command::Arm => {
                for axis in 0..core.arming.len() {
                    let arming = &mut core.arming[axis];
                    arming.asked = !arming.armed || arming.tripped;
                    arming.refusal = None;
                }
                // At once where that can be: whoever asks hears whether he is refused.
                let now = self.clock.now();
                core.board.look(&self.profile, now);
                core.arm_where_possible(self, now);
                events.append(&mut core.untold);
                format!("{names}: will be armed as soon as devices and readings allow it")
            }
            Command::Disarm => {
                for (place, axis) in self.profile.axes.iter().enumerate() {
                    let told = core.disarm(AxisId(place), &axis.settings.name, "switched off by a person");
                    events.extend(told);
                }
                format!("{names}: off; what stands in the registers stays")
            }
            Command::Zero => {
                let now = self.clock.now();
                core.compensation.zero(now);
                core.keeper.zeroed(now);
                events.push(Event::Zeroed);
                "references are captured from now on".to_owned()
            }
        };
        drop(core);
        events.iter().for_each(|event| self.tell(event));
        self.ring();
        Ok(answer)
    }
}
