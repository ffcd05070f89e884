//! What the lines, the page and the commands share: one lock, held for microseconds, never across a wait.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

use super::apply::part;
use super::arming::{Arming, Attempt};
use super::board::{Board, Change};
use super::keeper::Keeper;
use super::levels::LevelsTold;
use super::output::{OutputState, Standing};
use crate::clock::{Bell, Clock};
use crate::compensation::settings::OnFault;
use crate::compensation::{AxisState, Compensation, Control, Permit, Remembered, Snapshot, Unusable};
use crate::observe::events::{Event, Journal};
use crate::observe::status::Command;
use crate::profile::{AxisId, BusId, Output, OutputId, Profile, Writes};
use crate::quantity::{Micron, Moment};
use crate::reading::{Reason, SignalId};

/// The gateway's state, shared by its tasks.
pub(crate) struct Shared {
    pub(crate) profile: Arc<Profile>,
    pub(crate) clock: Clock,
    pub(crate) journal: Arc<Journal>,
    pub(crate) dry_run: bool,
    pub(crate) started: Moment,
    bells: Mutex<Vec<Bell>>,
    core: Mutex<Core>,
}

/// What stands behind the lock.
pub(super) struct Core {
    pub(super) board: Board,
    pub(super) compensation: Compensation,
    pub(super) arming: Vec<Arming>,
    pub(super) outputs: Vec<OutputState>,
    pub(super) devices: Vec<DeviceCount>,
    pub(super) buses: Vec<BusCount>,
    pub(super) keeper: Keeper,
    pub(super) stopping: bool,
    /// Something failed inside: the process ends with an error after the fault actions.
    pub(super) failed: bool,
    controls: Vec<Control>,
    told_states: Vec<AxisState>,
    pub(super) levels: Vec<LevelsTold>,
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
}

/// Cycles of one line.
#[derive(Clone, Debug, Default)]
pub(super) struct BusCount {
    pub(super) connected: bool,
    /// Attempts to connect since it went down.
    pub(super) down: Option<u64>,
    pub(super) cycles: u64,
    pub(super) overruns: u64,
    pub(super) jitter: [u64; JITTER_MS.len() + 1],
    pub(super) last_cycle: Moment,
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
        keeper: Keeper,
        bells: Vec<Bell>,
    ) -> Shared {
        let axes = profile.axes.iter().map(|axis| axis.settings.clone()).collect();
        let core = Core {
            board: Board::new(&profile),
            compensation: Compensation::new(profile.machine.clone(), axes, remembered),
            arming: vec![Arming::default(); profile.axes.len()],
            outputs: vec![OutputState::default(); profile.outputs.len()],
            devices: vec![DeviceCount::default(); profile.devices.len()],
            buses: vec![BusCount::default(); profile.buses.len()],
            keeper,
            stopping: false,
            failed: false,
            controls: vec![Control::default(); profile.axes.len()],
            told_states: vec![AxisState::Off; profile.axes.len()],
            levels: vec![LevelsTold::default(); profile.axes.len()],
        };
        let started = clock.now();
        Shared { profile, clock, journal, dry_run, started, bells: Mutex::new(bells), core: Mutex::new(core) }
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

    fn ring_where(&self, chosen: impl Fn(usize) -> bool) {
        let bells = self.bells.lock().unwrap_or_else(PoisonError::into_inner);
        bells.iter().enumerate().filter(|(place, _)| chosen(*place)).for_each(|(_, bell)| bell.ring());
    }

    /// A line's task was started anew and sleeps elsewhere now.
    pub(super) fn hang_bell(&self, bus: BusId, bell: Bell) {
        let mut bells = self.bells.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(place) = bells.get_mut(bus.0) {
            *place = bell;
        }
    }

    /// A position as it may be used now, and when it was taken.
    pub(super) fn position(&self, id: SignalId, now: Moment) -> (Option<f64>, Moment) {
        let core = self.core();
        (core.board.value(&self.profile, id, now), core.board.taken(id))
    }

    /// Steps each axis that is due and wakes the other lines, which may have to write. Called by the line that has
    /// just read its inputs.
    pub(super) fn advance(&self, now: Moment, bus: BusId) {
        let stepped = self.core().advance(self, now);
        if stepped {
            self.ring_others(bus);
        }
    }

    /// A request to stop: the axes take their fault actions. How long that takes at most.
    pub(super) fn begin_stop(&self) -> Duration {
        let mut core = self.core();
        core.stopping = true;
        let longest = core
            .compensation
            .decisions()
            .zip(&self.profile.axes)
            .map(|(decision, axis)| {
                let (guard, every) = (&axis.settings.guard, axis.settings.every);
                let steps = (decision.cz.abs().get() / guard.step.get()).ceil() + 1.0;
                match axis.settings.on_fault {
                    OnFault::Hold => every,
                    OnFault::Zero => every.mul_f64(steps + 1.0),
                    OnFault::Ramp { .. } => {
                        let slowest =
                            guard.step.get().min(guard.rate * every.as_secs_f64()) / guard.step.get();
                        let by_rate = Duration::from_secs_f64(decision.cz.abs().get() / guard.rate);
                        by_rate.max(Duration::from_secs_f64(steps * slowest)) + every * 2
                    }
                }
            })
            .max()
            .unwrap_or_default();
        drop(core);
        self.ring();
        longest + Duration::from_secs(2)
    }

    /// Every axis has done what its fault action asks for, and what it decided stands in the registers.
    pub(super) fn at_rest(&self) -> bool {
        let core = self.core();
        self.profile.axes.iter().enumerate().all(|(axis, settings)| {
            let Some(decision) = core.compensation.decision(axis) else { return true };
            let rested = match decision.state {
                AxisState::Off | AxisState::Zeroed => true,
                AxisState::Holding(_) => settings.settings.on_fault == OnFault::Hold,
                _ => false,
            };
            rested && core.has_arrived(&self.profile, axis, self.dry_run)
        })
    }

    /// What stays in the registers, in words.
    pub(super) fn what_is_left(&self) -> String {
        let core = self.core();
        let left: Vec<String> = self
            .profile
            .outputs
            .iter()
            .zip(&core.outputs)
            .filter(|(output, _)| output.writes.is_cz())
            .map(|(output, state)| match (state.standing, state.cz) {
                (Standing::Verified, Some(cz)) => format!("{} holds {cz}", output.name),
                (_, Some(cz)) => format!("{} held {cz} when it was last verified", output.name),
                (_, None) => format!("{} was never read", output.name),
            })
            .collect();
        if left.is_empty() { "no offset outputs".to_owned() } else { left.join(", ") }
    }

    /// Does what a person asks for.
    pub(crate) fn obey(&self, command: Command) -> Result<String, String> {
        let mut core = self.core();
        let names: Vec<&str> = self.profile.axes.iter().map(|axis| axis.settings.name.as_str()).collect();
        let names = names.join(", ");
        let answer = match command {
            Command::Arm if core.stopping => return Err("the gateway is stopping".to_owned()),
            Command::Arm => {
                for arming in &mut core.arming {
                    arming.asked = !arming.armed || arming.tripped;
                    arming.refusal = None;
                }
                format!("{names}: will be armed as soon as devices and readings allow it")
            }
            Command::Disarm => {
                for (place, axis) in self.profile.axes.iter().enumerate() {
                    core.disarm(self, AxisId(place), &axis.settings.name, "switched off by a person");
                }
                format!("{names}: off; what stands in the registers stays")
            }
            Command::Zero => {
                let now = self.clock.now();
                core.compensation.zero(now);
                core.keeper.zeroed(now);
                self.tell(&Event::Zeroed);
                "references are captured from now on".to_owned()
            }
        };
        drop(core);
        self.ring();
        Ok(answer)
    }
}

impl Core {
    fn advance(&mut self, shared: &Shared, now: Moment) -> bool {
        let profile = &shared.profile;
        self.board.look(profile, now);
        let due = self.compensation.next_due().is_some_and(|due| now >= due);
        if due {
            self.arm_where_possible(shared, now);
        }
        for (axis, arming) in self.arming.iter_mut().enumerate() {
            let permit = arming.permit(profile, axis, &self.outputs, self.stopping);
            self.controls[axis] =
                Control { permit, take_over: arming.take_over, take_over_slope: arming.take_over_slope };
        }
        let snapshot = Snapshot { now, readings: self.board.seen() };
        let stepped = self.compensation.step(&snapshot, &self.controls);
        if !stepped.anything {
            return false;
        }
        self.keeper.record(&snapshot, &self.controls, &self.compensation);
        for (axis, arming) in self.arming.iter_mut().enumerate() {
            if self.compensation.decision(axis).is_some_and(|decision| decision.at == now) {
                (arming.take_over, arming.take_over_slope) = (None, None);
            }
        }
        self.disarm_tripped(shared);
        self.keeper.remember(now, &self.compensation, profile, &self.outputs);
        if stepped.noticed.started {
            shared.tell(&Event::MachineStarted);
        }
        if stepped.noticed.zeroed {
            shared.tell(&Event::Zeroed);
        }
        self.tell_signals(shared, now);
        self.tell_axes(shared);
        true
    }

    fn arm_where_possible(&mut self, shared: &Shared, now: Moment) {
        if self.stopping {
            return;
        }
        for axis in 0..self.arming.len() {
            let snapshot = Snapshot { now, readings: self.board.seen() };
            let ready = self.compensation.has_usable_model(axis, &snapshot);
            let beyond = self.compensation.beyond_error(axis, &snapshot);
            let name = &shared.profile.axes[axis].settings.name;
            match self.arming[axis].attempt(&shared.profile, axis, &self.outputs, ready, beyond) {
                Attempt::NotYet => {}
                Attempt::From(from, take_over_slope) => {
                    let take_over = Some(from);
                    self.arming[axis] =
                        Arming { armed: true, take_over, take_over_slope, ..Arming::default() };
                    for (output, state) in shared.profile.outputs.iter().zip(&mut self.outputs) {
                        if output.axis.0 == axis && state.standing == Standing::Foreign {
                            state.standing = Standing::Verified;
                        }
                    }
                    shared.tell(&Event::Armed { axis: name.clone(), from });
                }
                Attempt::Refused(why) => {
                    if self.arming[axis].refusal.as_ref() != Some(&why) {
                        shared.tell(&Event::ArmRefused { axis: name.clone(), why: why.clone() });
                        self.arming[axis].refusal = Some(why);
                    }
                }
            }
        }
    }

    /// What an axis decided last stands in its registers.
    pub(super) fn has_arrived(&self, profile: &Profile, axis: usize, dry_run: bool) -> bool {
        let Some(decision) = self.compensation.decision(axis) else { return true };
        let settings = &profile.axes[axis].settings;
        let grain = |output: &Output| match (output.writes, settings.apart) {
            (Writes::Slope, Some(apart)) => apart.count.unwrap_or(Micron::ZERO),
            _ => settings.guard.count.unwrap_or(Micron::ZERO),
        };
        profile.outputs.iter().zip(&self.outputs).all(|(output, state)| {
            output.axis.0 != axis
                || !output.writes.is_scheduled()
                || decision.state == AxisState::Off
                || dry_run
                || (state.standing == Standing::Verified
                    && (output.writes == Writes::Reference
                        || state
                            .cz
                            .is_some_and(|cz| (cz - part(decision, output.writes)).abs() <= grain(output))))
        })
    }

    /// Switches an axis off until a person arms it again.
    pub(super) fn disarm(&mut self, shared: &Shared, axis: AxisId, name: &str, why: &str) {
        let arming = &mut self.arming[axis.0];
        if arming.armed {
            shared.tell(&Event::Disarmed { axis: name.to_owned(), why: why.to_owned() });
        }
        *arming = Arming { latched: true, ..Arming::default() };
    }

    /// An output's register was found to hold this much Cz after it had not been known: the axis goes on from there.
    pub(super) fn found(&mut self, profile: &Profile, id: OutputId, cz: Micron) {
        let axis = profile.output(id).axis.0;
        let writes = profile.output(id).writes;
        let first =
            profile.outputs.iter().position(|output| output.axis.0 == axis && output.writes == writes);
        if !self.arming[axis].armed || first != Some(id.0) {
            return;
        }
        if writes == Writes::Slope {
            self.arming[axis].take_over_slope = Some(cz);
        } else if writes.is_cz() {
            self.arming[axis].take_over = Some(cz);
        }
    }

    fn tell_signals(&mut self, shared: &Shared, now: Moment) {
        for change in self.board.changes(now) {
            match change {
                // The device or the bus has been told already.
                Change::Lost(_, Reason::LinkDown | Reason::Timeout | Reason::BadReply) => {}
                Change::Lost(id, reason) => {
                    let signal = shared.profile.signal(id).name.clone();
                    shared.tell(&Event::SignalBad { signal, reason: reason.to_string() });
                }
                Change::Back(id, since) => {
                    let signal = shared.profile.signal(id).name.clone();
                    shared.tell(&Event::SignalGood { signal, bad_for: now.since(since) });
                }
            }
        }
    }

    fn tell_axes(&mut self, shared: &Shared) {
        for (axis, settings) in shared.profile.axes.iter().enumerate() {
            let Some(decision) = self.compensation.decision(axis) else { continue };
            let name = &settings.settings.name;
            if self.told_states[axis].name() != decision.state.name() {
                shared.tell(&Event::AxisState {
                    axis: name.clone(),
                    from: self.told_states[axis].name(),
                    to: decision.state.name(),
                    why: self.why(shared, axis),
                });
                self.told_states[axis] = decision.state;
            }
            for event in self.levels[axis].events(&settings.settings, decision).into_iter().flatten() {
                shared.tell(&event);
            }
        }
    }

    /// Why an axis is not following its preferred model, in words; empty where it is.
    pub(super) fn why(&self, shared: &Shared, axis: usize) -> String {
        let Some(decision) = self.compensation.decision(axis) else { return String::new() };
        if decision.state == AxisState::Off {
            return self.arming[axis].refusal.clone().unwrap_or_default();
        }
        let permit = self.arming[axis].permit(&shared.profile, axis, &self.outputs, self.stopping);
        if permit == Permit::Stopping {
            return "the gateway is stopping".to_owned();
        }
        let troubled = shared
            .profile
            .outputs
            .iter()
            .zip(&self.outputs)
            .find(|(output, state)| {
                output.axis.0 == axis && !matches!(state.standing, Standing::Verified | Standing::Unknown)
            })
            .map(|(output, state)| format!("output {} is {}", output.name, state.standing.name()));
        if let (Permit::Unverified | Permit::Held, Some(words)) = (permit, troubled) {
            return words;
        }
        let signal = |id: SignalId| {
            let quality =
                self.board.seen().get(id.0).map_or(String::new(), |reading| reading.quality.to_string());
            format!("{}: {quality}", shared.profile.signal(id).name)
        };
        if decision.tripped {
            return "its model asked for more than the error level".to_owned();
        }
        match decision.lacks {
            None => String::new(),
            Some(Unusable::Signal(id)) => signal(id),
            Some(Unusable::Reference(id)) => {
                format!("the reference of {} is not captured yet", shared.profile.signal(id).name)
            }
            Some(Unusable::MachineOff) => "the machine has not been seen running yet".to_owned(),
            Some(Unusable::NotANumber) => "the model's result is not a number".to_owned(),
        }
    }
}
