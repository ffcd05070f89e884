//! The heart: from a snapshot of the machine to one decision per axis. Pure: no I/O, no clock, no allocation in a step.
//!
//! Time is an argument, so the same code runs in the gateway, the demo, the replay and the tests, and a recorded
//! log gives the decisions of the day bit for bit.
//!
//! # Sign
//! Cz is what is *added* to a position. With the displacement error e (actual minus commanded) a model yields `Cz = −e`.
//!
//! # Terms
//! - **raw**: what the model asks for, µm.
//! - **Cz**: what the guard lets through, in whole counts of the register.
//! - **due**: an axis is stepped at its own period, and at once where its permit changes or it has something to take
//!   over; any other snapshot in between changes nothing but edges.

use std::time::Duration;

use crate::quantity::{Micron, Moment};
use crate::reading::{Reading, SignalId};

pub mod model;
pub mod reference;
pub mod settings;

mod guard;
mod state;

pub use guard::Stages;
pub use model::{Extrapolation, Unusable};
pub use state::AxisState;

use guard::{Guard, Pace};
use model::Outside;
use reference::{Machine, Noticed};
use settings::{AxisSettings, MachineSettings, OnFault};

/// The machine at one moment: one reading per signal of the profile, already aged.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'a> {
    /// The moment.
    pub now: Moment,
    /// By [`SignalId`].
    pub readings: &'a [Reading],
}

impl Snapshot<'_> {
    /// The value of a signal, if it may be used.
    pub fn value(&self, id: SignalId) -> Option<f64> {
        self.readings.get(id.0)?.usable()
    }
}

/// What the world outside tells an axis at a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Control {
    /// It may decide and write.
    pub permit: Permit,
    /// What stands in the register, where the axis has to take it over: at arming, and when an output comes back.
    pub take_over: Option<Micron>,
}

/// Whether an axis may decide.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Permit {
    /// Not armed.
    #[default]
    Off,
    /// Armed, and what it wrote last was verified.
    Armed,
    /// Armed, but what it wrote last was not verified.
    Unverified,
    /// Armed, but an interlock keeps what stands in the register: the axis waits, however long that takes.
    Held,
    /// The gateway is stopping: the fault action runs without its waiting time.
    Stopping,
}

impl Permit {
    /// The word for it in a log.
    pub fn name(self) -> &'static str {
        match self {
            Permit::Off => "off",
            Permit::Armed => "armed",
            Permit::Unverified => "unverified",
            Permit::Held => "held",
            Permit::Stopping => "stopping",
        }
    }

    /// The permit with this name.
    pub fn from_name(name: &str) -> Option<Permit> {
        [Permit::Off, Permit::Armed, Permit::Unverified, Permit::Held, Permit::Stopping]
            .into_iter()
            .find(|permit| permit.name() == name)
    }
}

/// What was decided for one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// When.
    pub at: Moment,
    /// The model's Cz, before the guard.
    pub raw: Option<Micron>,
    /// Which model gave it: its place in the profile's list.
    pub model: Option<usize>,
    /// Cz after the guard: what is to be written.
    pub cz: Micron,
    /// What the axis is doing.
    pub state: AxisState,
    /// The stages of the guard that changed the value.
    pub acted: Stages,
    /// What the preferred model lacks.
    pub lacks: Option<Unusable>,
    /// How far the machine is from what the model in use was identified on; `None` inside.
    pub extrapolating: Option<Extrapolation>,
}

/// The model that serves now, and what it asks for.
#[derive(Clone, Copy, Debug)]
struct Chosen {
    place: usize,
    raw: Micron,
    extrapolating: Option<Extrapolation>,
}

impl Chosen {
    /// Outside the region it was identified on, and not to be followed there.
    fn keeps(&self) -> bool {
        self.extrapolating.is_some_and(|outside| outside.outside == Outside::Hold)
    }
}

/// All axes of a machine, and what they remember.
#[derive(Clone, Debug)]
pub struct Compensation {
    settings: MachineSettings,
    machine: Machine,
    axes: Vec<Axis>,
}

#[derive(Clone, Debug)]
struct Axis {
    settings: AxisSettings,
    guard: Guard,
    state: AxisState,
    permit: Permit,
    stepped: Option<Moment>,
    due: Option<Moment>,
    decision: Decision,
}

/// What a call of [`Compensation::step`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stepped {
    /// At least one axis decided, or an edge was seen: a row for the log.
    pub anything: bool,
    /// Machine start and zero.
    pub noticed: Noticed,
}

impl Compensation {
    /// Axes at rest, with what the machine remembers from before ([`Machine::default`] where it remembers nothing).
    pub fn new(settings: MachineSettings, axes: Vec<AxisSettings>, machine: Machine) -> Compensation {
        let axes = axes.into_iter().map(Axis::new).collect();
        Compensation { settings, machine, axes }
    }

    /// Steps each axis that is due at `snapshot.now`, under its control (same order, one each).
    pub fn step(&mut self, snapshot: &Snapshot<'_>, controls: &[Control]) -> Stepped {
        let due = |axis: &Axis, control: &Control| axis.is_due(snapshot.now, control);
        if !self.axes.iter().zip(controls).any(|(axis, control)| due(axis, control))
            && !self.machine.would_notice(&self.settings, snapshot)
        {
            return Stepped::default();
        }
        let noticed = self.machine.observe(&self.settings, snapshot);
        for (axis, control) in self.axes.iter_mut().zip(controls) {
            if due(axis, control) {
                axis.step(snapshot, &self.machine, *control);
            }
        }
        Stepped { anything: true, noticed }
    }

    /// The earliest moment at which an axis is due; `None` where there are no axes.
    pub fn next_due(&self) -> Option<Moment> {
        self.axes.iter().map(|axis| axis.due.unwrap_or_default()).min()
    }

    /// The last decision of each axis.
    pub fn decisions(&self) -> impl Iterator<Item = &Decision> {
        self.axes.iter().map(|axis| &axis.decision)
    }

    /// The last decision of one axis.
    pub fn decision(&self, axis: usize) -> Option<&Decision> {
        self.axes.get(axis).map(|axis| &axis.decision)
    }

    /// Whether some model of this axis could be used now.
    pub fn has_usable_model(&self, axis: usize, snapshot: &Snapshot<'_>) -> bool {
        self.model_value(axis, snapshot).is_some()
    }

    /// What the first usable model of this axis would ask for now, with its place in the profile's list.
    pub fn model_value(&self, axis: usize, snapshot: &Snapshot<'_>) -> Option<(usize, Micron)> {
        let (chosen, _) = self.axes.get(axis)?.choose(snapshot, &self.machine);
        chosen.map(|chosen| (chosen.place, chosen.raw))
    }

    /// What is worth keeping over a restart.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Captures the "zero" references from now on.
    pub fn zero(&mut self, now: Moment) {
        self.machine.zero(&self.settings, now);
    }
}

impl Axis {
    fn new(settings: AxisSettings) -> Axis {
        let decision = Decision {
            at: Moment::default(),
            raw: None,
            model: None,
            cz: Micron::ZERO,
            state: AxisState::Off,
            acted: Stages::default(),
            lacks: None,
            extrapolating: None,
        };
        Axis {
            settings,
            guard: Guard::default(),
            state: AxisState::Off,
            permit: Permit::Off,
            stepped: None,
            due: None,
            decision,
        }
    }

    /// At its period; at once where it never ran, where time went back, and where its control says something new.
    fn is_due(&self, now: Moment, control: &Control) -> bool {
        let (Some(due), Some(last)) = (self.due, self.stepped) else { return true };
        now >= due || now < last || control.permit != self.permit || control.take_over.is_some()
    }

    /// The first model whose signals are all good, with its value, and what the preferred one lacks. One that only
    /// waits for a reference or for the machine's start is waited for: lesser models stand in for broken sensors.
    fn choose(&self, snapshot: &Snapshot<'_>, machine: &Machine) -> (Option<Chosen>, Option<Unusable>) {
        let mut lacks = None;
        for (place, model) in self.settings.models.iter().enumerate() {
            match model.wants(snapshot, machine) {
                Ok(wanted) => {
                    let chosen = |raw| Chosen { place, raw, extrapolating: wanted.extrapolating };
                    return (Micron::new(wanted.value).map(chosen), lacks);
                }
                Err(reason @ (Unusable::Reference(_) | Unusable::MachineOff)) => {
                    return (None, lacks.or(Some(reason)));
                }
                Err(reason) => lacks = lacks.or(Some(reason)),
            }
        }
        (None, lacks)
    }

    fn step(&mut self, snapshot: &Snapshot<'_>, machine: &Machine, control: Control) {
        let now = snapshot.now;
        let dt = self.stepped.map_or(self.settings.every, |last| now.since(last));
        let (chosen, lacks) = self.choose(snapshot, machine);
        if let Some(found) = control.take_over {
            self.guard.take_over(found, &self.settings.guard);
        }
        self.state = self.next_state(now, chosen.as_ref(), control.permit);
        let (target, pace) = match (self.state, chosen, self.settings.on_fault) {
            (AxisState::Active | AxisState::Degraded, Some(chosen), _) => (Some(chosen.raw), Pace::Follow),
            (AxisState::Ramping, _, OnFault::Zero) => (Some(Micron::ZERO), Pace::Steps),
            (AxisState::Ramping, _, _) => (Some(Micron::ZERO), Pace::Ramp),
            _ => (None, Pace::Follow),
        };
        let (cz, acted) = match target {
            Some(target) => self.guard.advance(target, dt, pace, &self.settings.guard),
            None => (self.guard.value(), Stages::default()),
        };
        if self.state == AxisState::Ramping && cz == Micron::ZERO {
            self.state = AxisState::Zeroed;
        }
        self.decision = Decision {
            at: now,
            raw: chosen.map(|chosen| chosen.raw),
            model: chosen.map(|chosen| chosen.place),
            cz,
            state: self.state,
            acted,
            lacks,
            extrapolating: chosen.and_then(|chosen| chosen.extrapolating),
        };
        self.due = Some(self.next_due(now));
        self.permit = control.permit;
        self.stepped = Some(now);
    }

    /// The next tick of the period, or the end of a hold that comes before it.
    fn next_due(&self, now: Moment) -> Moment {
        let period = self.period();
        let tick = match self.due {
            // It acted before its time, or time went back.
            Some(due) if due > now => due.min(now.after(period)),
            Some(due) => now.next_tick(due, period),
            None => now.after(period),
        };
        match (self.state, self.settings.on_fault) {
            (AxisState::Holding(since), OnFault::Ramp { after }) if since.after(after) > now => {
                tick.min(since.after(after))
            }
            _ => tick,
        }
    }

    fn next_state(&self, now: Moment, chosen: Option<&Chosen>, permit: Permit) -> AxisState {
        let keeps = permit == Permit::Held || (permit == Permit::Armed && chosen.is_some_and(Chosen::keeps));
        match (permit, chosen.map(|chosen| chosen.place)) {
            (Permit::Off, _) => AxisState::Off,
            // It never took over what stands in the register, so there is nothing of its own to bring back.
            (Permit::Stopping, _) if self.state == AxisState::Off => AxisState::Off,
            _ if keeps => match self.state {
                AxisState::Holding(since) => AxisState::Holding(since),
                _ => AxisState::Holding(now),
            },
            (Permit::Armed, Some(0)) => AxisState::Active,
            (Permit::Armed, Some(_)) => AxisState::Degraded,
            (Permit::Armed | Permit::Unverified | Permit::Held, _) => self.fault_action(now, false),
            (Permit::Stopping, _) => self.fault_action(now, true),
        }
    }

    fn fault_action(&self, now: Moment, at_once: bool) -> AxisState {
        let since = match self.state {
            AxisState::Ramping | AxisState::Zeroed if self.guard.value() == Micron::ZERO => {
                return AxisState::Zeroed;
            }
            AxisState::Ramping | AxisState::Zeroed => return AxisState::Ramping,
            // What was kept outside an envelope was no fault: the fault begins now.
            AxisState::Holding(_) if self.kept_outside() => now,
            // Where time went back, the hold does not wait for the moment at which it began to come again.
            AxisState::Holding(since) => since.min(now),
            AxisState::Off | AxisState::Active | AxisState::Degraded => now,
        };
        let leaves = match self.settings.on_fault {
            OnFault::Hold => false,
            OnFault::Ramp { after } => at_once || now.since(since) >= after,
            OnFault::Zero => true,
        };
        if leaves { AxisState::Ramping } else { AxisState::Holding(since) }
    }

    /// The last decision kept the value because the model's inputs lay outside its envelope.
    fn kept_outside(&self) -> bool {
        self.permit == Permit::Armed
            && self.decision.extrapolating.is_some_and(|outside| outside.outside == Outside::Hold)
    }

    /// An axis going to zero updates as often as its rate needs it to, however slow its normal period.
    fn period(&self) -> Duration {
        let guard = &self.settings.guard;
        if self.state != AxisState::Ramping {
            return self.settings.every;
        }
        let one_step = Duration::try_from_secs_f64(guard.step.get() / guard.rate).unwrap_or(Duration::MAX);
        self.settings.every.min(one_step.max(SHORTEST_PERIOD))
    }
}

/// A ramp in the tiniest steps updates no oftener than this: a fieldbus could not follow.
const SHORTEST_PERIOD: Duration = Duration::from_millis(100);

#[cfg(test)]
mod tests;
