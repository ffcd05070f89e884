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

use serde::{Deserialize, Serialize};

use crate::quantity::{Micron, Millimetre, Moment, Shift};
use crate::reading::{Quality, Reading, SignalId};

pub mod model;
pub mod reference;
pub mod settings;

mod axis;
mod datum;
mod guard;
mod instead;
mod probe;
mod remembered;
mod running;
mod stand_in;
mod state;

pub use guard::Stages;
pub use model::{CLEARLY_INSIDE, Extrapolation, Unusable};
pub use probe::{Measured, MeasuredReport, Probe, Probed, Refused, Rejected, Residual, Worse};
pub use remembered::{AxisMemory, Remembered, Stop};
pub use running::AxisRunning;
pub use stand_in::{Distrusted, StoodIn};
pub use state::AxisState;

use axis::Axis;
use instead::Instead;
use model::Model;
use reference::{Machine, Noticed, Reference};
use settings::{AxisSettings, MachineSettings};

/// The machine at one moment: one reading per signal of the profile, already aged.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'a> {
    /// The moment.
    pub now: Moment,
    /// By [`SignalId`].
    pub readings: &'a [Reading],
    /// What is used instead of readings: others stand in for those sensors.
    instead: &'a [Instead],
    /// The lags have gone on to it, all by their own sensors, and no reference has been captured since.
    is_followed: bool,
}

impl<'a> Snapshot<'a> {
    /// These readings at this moment.
    pub fn new(now: Moment, readings: &'a [Reading]) -> Snapshot<'a> {
        Snapshot { now, readings, instead: &[], is_followed: false }
    }

    /// The same after the lags have gone on to it.
    #[must_use]
    pub fn followed(self) -> Snapshot<'a> {
        Snapshot { is_followed: true, ..self }
    }

    /// The value of a signal, if it may be used.
    pub fn value(&self, id: SignalId) -> Option<f64> {
        match self.instead_of(id) {
            Some(instead) => instead.value(),
            None => self.reading(id),
        }
    }

    /// What a sensor reads, believed or not, if that is good.
    #[inline]
    fn reading(&self, id: SignalId) -> Option<f64> {
        self.readings.get(id.0)?.usable()
    }

    /// The same, if it is less than this, above and below zero.
    #[inline]
    fn reading_below(&self, limit: f64, id: SignalId) -> Option<f64> {
        let Reading { value, quality, .. } = self.readings.get(id.0)?;
        (*quality == Quality::Good && value.abs() < limit).then_some(*value)
    }

    /// What is used instead of this sensor.
    #[inline]
    fn instead_of(&self, id: SignalId) -> Option<&'a Instead> {
        self.instead.iter().find(|instead| instead.signal == id)
    }

    /// The value of a signal that is the position of an axis, if it may be used.
    pub fn position(&self, id: SignalId) -> Option<Millimetre> {
        Millimetre::new(self.value(id)?)
    }

    /// Whether any reading may be used.
    pub fn has_usable(&self) -> bool {
        self.readings.iter().any(|reading| reading.usable().is_some())
    }
}

/// What the world outside tells an axis at a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Control {
    /// It may decide and write.
    pub permit: Permit,
    /// What stands in the register, where the axis has to take it over: at arming, and when an output comes back.
    pub take_over: Option<Micron>,
    /// The same for a slope that the control applies itself: what it comes to at the axis's reach.
    pub take_over_slope: Option<Micron>,
    /// What probings have taught is taken back.
    pub forget: bool,
    /// An error that was measured, to learn from.
    pub measured: Option<Measured>,
    /// Cz goes there, within the guard, while the axis would follow its model: its sign is checked with a dial gauge.
    pub sign: Option<Micron>,
    /// A person has disarmed it, and has looked: whatever its sensors read is believed.
    pub trust: bool,
    /// Verified Cz of the register that is farthest behind the last decision: Cz stays within one step of it. `None` if no register
    /// is behind.
    pub behind: Option<Micron>,
    /// Where an axis that keeps its value goes back to: a sensor's settings were changed, and what was decided since its last check is
    /// wrong.
    pub return_to: Option<ReturnTo>,
}

/// Cz, and the effect of the slope, before the settings of a sensor were changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReturnTo {
    /// Cz.
    pub cz: Micron,
    /// Effect of the slope at the axis's reach; zero without a slope.
    pub slope: Micron,
}

impl Control {
    /// There is something to take over.
    pub fn takes_over(&self) -> bool {
        self.take_over.is_some() || self.take_over_slope.is_some()
    }
}

/// Whether an axis may decide.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
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
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// When.
    pub at: Moment,
    /// The model's Cz with its correction, before the guard.
    pub raw: Option<Micron>,
    /// What is expected to be left of the error where that acts: one standard deviation. `None` where it is not known, and
    /// outside what the model was identified on.
    #[serde(default)]
    pub expected: Option<Micron>,
    /// What probings have added to the model's own Cz.
    #[serde(default)]
    pub correction: Micron,
    /// Which model gave it: its place in the profile's list.
    pub model: Option<usize>,
    /// Cz after the guard: what is to be written.
    pub cz: Micron,
    /// Where the control applies the slope itself: what it comes to at the axis's reach, after the guard; else zero.
    /// Cz is K0 there, the value at the reference position.
    pub slope: Micron,
    /// Target of Cz within the limit: the value that the model, the fault action, the stop or the sign check requests. Equal to Cz
    /// while nothing is requested.
    #[serde(default)]
    pub target: Micron,
    /// Target of the slope.
    #[serde(default)]
    pub slope_target: Micron,
    /// What the axis is doing.
    pub state: AxisState,
    /// The stages of the guard that changed the value.
    pub acted: Stages,
    /// What the preferred model lacks.
    pub lacks: Option<Unusable>,
    /// A sensor of the model in use that others stand in for.
    #[serde(default)]
    pub stood_in: Option<StoodIn>,
    /// A model asked for more than the error level: the axis runs its fault action and waits to be armed again.
    pub tripped: bool,
    /// Touches show that the axis is worse with the model in use than without compensation. While no model can be used, that of the
    /// model used last.
    #[serde(default)]
    pub worse: Option<Worse>,
    /// How far the machine is from what the model in use was identified on; `None` inside.
    pub extrapolating: Option<Extrapolation>,
    /// The same as a number: above 0 outside, negative inside; `None` where the model in use has neither envelope nor
    /// guideway. [`CLEARLY_INSIDE`] says when outside is over.
    pub excess: Option<f64>,
}

/// All axes of a machine, and what they remember.
#[derive(Clone, Debug)]
pub struct Compensation {
    settings: MachineSettings,
    machine: Machine,
    axes: Vec<Axis>,
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
    /// With what is remembered from before ([`Remembered::default`] where that is nothing). The axes are at rest, but for
    /// those whose running state is among it.
    pub fn new(settings: MachineSettings, axes: Vec<AxisSettings>, remembered: Remembered) -> Compensation {
        let mut axes: Vec<Axis> = axes.into_iter().map(Axis::new).collect();
        for axis in &mut axes {
            if let Some(remembered) = remembered.axis(&axis.settings.name) {
                axis.recall(remembered);
            }
            if let Some(running) = remembered.running(&axis.settings.name) {
                axis.go_on(running);
            }
        }
        Compensation { settings, machine: remembered.machine, axes }
    }

    /// Steps each axis that is due at `snapshot.now`, under its control (same order, one each).
    pub fn step(&mut self, snapshot: &Snapshot<'_>, controls: &[Control]) -> Stepped {
        let due = |axis: &Axis, control: &Control| axis.is_due(snapshot.now, control);
        let mut is_any_due = false;
        let reads = |(axis, control): (&Axis, &Control)| {
            let is_due = due(axis, control);
            is_any_due |= is_due;
            is_due && !axis.reads_nothing
        };
        if !self.axes.iter().zip(controls).any(reads)
            && !self.would_notice(|id| snapshot.value(id), || snapshot.has_usable())
        {
            if !is_any_due {
                return Stepped::default();
            }
            // Axes that rest on no reading take notice of nothing, so that a log without them is replayed alike.
            self.follow(snapshot);
            for (axis, control) in
                self.axes.iter_mut().zip(controls).filter(|(axis, control)| due(axis, control))
            {
                axis.step(&snapshot.followed(), &self.machine, *control);
            }
            return Stepped { anything: true, noticed: Noticed::default() };
        }
        for (axis, control) in self.axes.iter_mut().zip(controls) {
            axis.look(snapshot, &self.machine);
            if control.trust {
                axis.trust(&self.machine, snapshot.now);
            }
        }
        self.take_beginnings();
        let is_distrusted = |id| self.axes.iter().any(|axis| axis.distrusts(id));
        let noticed = self.machine.observe_without(&self.settings, snapshot, is_distrusted);
        for axis in &mut self.axes {
            if noticed.started {
                axis.started(&self.settings, snapshot.now);
            }
            axis.follow(snapshot, &self.machine);
            if noticed.zeroed {
                axis.zero(&self.settings, snapshot.now);
            }
        }
        let followed = if self.take_beginnings() { *snapshot } else { snapshot.followed() };
        for (axis, control) in self.axes.iter_mut().zip(controls) {
            if due(axis, control) {
                axis.step(&followed, &self.machine, *control);
            }
        }
        Stepped { anything: true, noticed }
    }

    /// Whether this axis would be stepped now, under this control.
    pub fn is_due(&self, axis: usize, now: Moment, control: &Control) -> bool {
        self.axes.get(axis).is_some_and(|axis| axis.is_due(now, control))
    }

    /// Whether a step would take notice of the machine as a whole now, of what these signals say: that it began to run, or
    /// a command to zero. `any_usable`: there is a reading that may be used.
    pub fn would_notice(
        &self,
        value: impl Fn(SignalId) -> Option<f64>,
        any_usable: impl FnOnce() -> bool,
    ) -> bool {
        self.machine.would_notice(&self.settings, value, any_usable)
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
        let chosen = self.axes.get(axis)?.choose(snapshot, &self.machine).0?;
        Some((chosen.model, chosen.raw))
    }

    /// Those whose readings say what this signal of this model of an axis would read, where others stand in for it.
    pub fn predictors(
        &self,
        axis: usize,
        model: usize,
        signal: SignalId,
    ) -> Option<impl Iterator<Item = SignalId>> {
        self.axes.get(axis)?.predictors(model, signal)
    }

    /// The sensors that an axis does not believe, each once.
    pub fn distrusted(&self, axis: usize) -> impl Iterator<Item = Distrusted> {
        self.axes.get(axis).into_iter().flat_map(Axis::distrusted)
    }

    /// What the model asks for now, where that lies beyond the axis's error level.
    pub fn beyond_error(&self, axis: usize, snapshot: &Snapshot<'_>) -> Option<Micron> {
        let axis = self.axes.get(axis)?;
        let chosen = axis.choose(snapshot, &self.machine).0?;
        axis.is_beyond_error(&chosen).then_some(chosen.raw)
    }

    /// What probings have taught an axis; `None` where it takes none.
    pub fn probe(&self, axis: usize) -> Option<&Probe> {
        self.axes.get(axis).filter(|axis| axis.settings.probe.is_some()).map(|axis| &axis.probe)
    }

    /// Whether this axis would learn from a measured error now; it is not changed.
    ///
    /// # Errors
    /// What it came to, with why not.
    pub fn would_learn(
        &self,
        axis: usize,
        snapshot: &Snapshot<'_>,
        measured: Measured,
    ) -> Result<(), Probed> {
        let Some(axis) = self.axes.get(axis) else { return Ok(()) };
        let probed = axis.judge(snapshot, &self.machine, measured);
        if probed.refused.is_some() { Err(probed) } else { Ok(()) }
    }

    /// Whether a report that arrives `now` is of a measurement of this axis that may count: none that was taken, and none of
    /// before its datum. `shift` brings counted time to the wall clock.
    ///
    /// # Errors
    /// Why it is rejected.
    pub fn check_report(
        &mut self,
        axis: usize,
        report: &MeasuredReport,
        (now, shift): (Moment, Shift),
    ) -> Result<(), Rejected> {
        let Some(axis) = self.axes.get_mut(axis) else { return Ok(()) };
        let datum = axis.datum(now, &self.machine, self.settings.settle);
        axis.probe.reports.check(report, (now, shift), datum)
    }

    /// Remembers a report whose error is learned from or waits for another one: it does not count again.
    pub fn take_report(&mut self, axis: usize, report: MeasuredReport, now: Moment) {
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.probe.reports.take(report, now);
        }
    }

    /// The lags go on to a snapshot at which no axis decided. A gateway records no such row; a log from elsewhere has
    /// rows between two updates, and what it says there is not to be lost.
    pub fn follow(&mut self, snapshot: &Snapshot<'_>) {
        for axis in &mut self.axes {
            axis.look(snapshot, &self.machine);
            axis.follow(snapshot, &self.machine);
        }
        self.take_beginnings();
    }

    /// Where sensors are believed again that nobody could read at the machine's start, that is known now. Whether there are
    /// any.
    fn take_beginnings(&mut self) -> bool {
        let mut any = false;
        for axis in &mut self.axes {
            axis.take_beginnings(|signal, beginning| {
                self.machine.begins(signal, beginning);
                any = true;
            });
        }
        any
    }

    /// The time since machine start and references.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// What is worth keeping over a restart.
    pub fn remembered(&self) -> Remembered {
        let axes = self.axes.iter().filter_map(Axis::remembered).collect();
        Remembered { machine: self.machine.clone(), axes, running: Vec::new() }
    }

    /// The same with where each axis stands now: whoever begins from it decides as this goes on.
    pub fn running(&self) -> Remembered {
        Remembered { running: self.axes.iter().map(Axis::running).collect(), ..self.remembered() }
    }

    /// Captures the "zero" references and takes the datum from now on.
    pub fn zero(&mut self, now: Moment) {
        self.machine.zero(&self.settings, now);
        for axis in &mut self.axes {
            axis.zero(&self.settings, now);
        }
    }

    /// The same for one axis; nothing, and `false`, where another axis counts from the "zero" of the same signal.
    pub fn zero_axis(&mut self, place: usize, now: Moment) -> bool {
        let from_zero = |axis: &Axis| -> Vec<SignalId> {
            let rises = axis.settings.models.iter().flat_map(Model::rises);
            rises.filter(|input| input.reference == Reference::Zero).map(|input| input.signal).collect()
        };
        let Some(signals) = self.axes.get(place).map(from_zero) else { return false };
        let mut others = self.axes.iter().enumerate().filter(|(other, _)| *other != place);
        if others.any(|(_, axis)| from_zero(axis).iter().any(|signal| signals.contains(signal))) {
            return false;
        }
        self.machine.zero_of(&signals, &self.settings, now);
        self.axes[place].zero(&self.settings, now);
        true
    }
}

#[cfg(test)]
mod tests;
