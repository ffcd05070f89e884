//! Compensation, the first pure step of the gateway: it computes one decision for each axis from a snapshot of the
//! machine.
//!
//! The step has no input or output, reads no clock, and allocates no memory. Time is an argument. Therefore gateway,
//! demo, replay and tests run the same code, and a replay of a log gives the original decisions bit for bit.
//!
//! # Sign
//! Cz is *added* to a position. The displacement error e is actual minus commanded position. A model yields `Cz = −e`.
//!
//! # Terms
//! - **raw**: value that the model requests, µm.
//! - **Cz**: value after the limits of the axis (the guard: limit, deadband, step, rate), in whole counts of the
//!   register.
//! - **due**: an axis is due when it must compute a decision. This is the case after each period of the axis,
//!   and at once after a new demand, such as another permit or the takeover of a register value. Any other
//!   snapshot is only used to detect a machine start or a zero command.

use crate::quantity::{Micron, Moment, Shift};
use crate::reading::SignalId;

pub mod model;
pub mod reference;
pub mod settings;

mod axis;
mod control;
mod datum;
mod decision;
mod guard;
mod preference;
mod probe;
mod remembered;
mod running;
mod snapshot;
mod stand_in;
mod state;
mod substitution;

pub use control::{Control, Permit, ReturnTo};
pub use decision::Decision;
pub use guard::Stages;
pub use model::{CLEARLY_INSIDE, Extrapolation, Unusable};
pub use preference::{Change, LearnedModel, LearnedTerm, Preference, Preferred, Unfit, When};
pub use probe::{ErrorScale, Measured, MeasuredReport, Probe, Probed, Refused, Rejected, Residual, Worse};
pub use remembered::{AxisMemory, Remembered, Stop};
pub use running::AxisRunning;
pub use snapshot::Snapshot;
pub use stand_in::{RejectedSensor, SubstitutedSensor};
pub use state::AxisState;

use axis::Axis;
use model::{Contribution, Model};
use reference::{Machine, MachineChange, Reference};
use settings::{AxisSettings, MachineSettings};

/// Compensation of a machine: the state of all its axes, and of the machine itself.
#[derive(Clone, Debug)]
pub struct Compensation {
    settings: MachineSettings,
    machine: Machine,
    axes: Vec<Axis>,
}

/// Result of [`Compensation::step`]: whether an axis decided, and which events of the machine were detected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StepResult {
    /// Whether an axis decided, the machine's `on` or `zero` signal changed, or a machine start was detected.
    /// If so, the log gets a row.
    pub anything: bool,
    /// Events of the machine that were detected: a machine start, a zero command.
    pub noticed: MachineChange,
}

impl Compensation {
    /// Creates the state of all axes. `remembered` is the saved state of an earlier run, or
    /// [`Remembered::default`] if there is none. An axis is off, unless `remembered` contains its running
    /// state.
    pub fn new(settings: MachineSettings, axes: Vec<AxisSettings>, remembered: Remembered) -> Compensation {
        let mut axes: Vec<Axis> = axes.into_iter().map(Axis::new).collect();
        let (known, running) = (remembered.by_axis(), remembered.running_by_axis());
        for axis in &mut axes {
            if let Some(remembered) = known.get(axis.settings.name.as_str()) {
                axis.recall(remembered);
            }
            if let Some(running) = running.get(axis.settings.name.as_str()) {
                axis.go_on(running);
            }
        }
        Compensation { settings, machine: remembered.machine, axes }
    }

    /// Computes a new decision for each axis that is due at `snapshot.now`. `controls` contains one control for each
    /// axis, in the same order.
    pub fn step(&mut self, snapshot: &Snapshot<'_>, controls: &[Control]) -> StepResult {
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
                return StepResult::default();
            }
            // Axes that read no signal do not update the machine, so that a log without readings is replayed alike.
            self.follow(snapshot);
            for (axis, control) in
                self.axes.iter_mut().zip(controls).filter(|(axis, control)| due(axis, control))
            {
                axis.step(&snapshot.followed(), &self.machine, *control);
            }
            return StepResult { anything: true, noticed: MachineChange::default() };
        }
        for (axis, control) in self.axes.iter_mut().zip(controls) {
            axis.check(snapshot, &self.machine);
            if control.trust {
                axis.trust(&self.machine, snapshot.now);
            }
        }
        self.take_beginnings();
        let is_distrusted = |id| self.axes.iter().any(|axis| axis.rejects(id));
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
        StepResult { anything: true, noticed }
    }

    /// Returns whether a step at `now` would compute a decision for this axis with this control.
    pub fn is_due(&self, axis: usize, now: Moment, control: &Control) -> bool {
        self.axes.get(axis).is_some_and(|axis| axis.is_due(now, control))
    }

    /// Returns whether a step would now detect a change of the machine's `on` or `zero` signal, or, without
    /// an `on` signal, the first good reading. `value` returns the value of a signal. `any_usable` returns
    /// whether any reading may be used.
    pub fn would_notice(
        &self,
        value: impl Fn(SignalId) -> Option<f64>,
        any_usable: impl FnOnce() -> bool,
    ) -> bool {
        self.machine.would_notice(&self.settings, value, any_usable)
    }

    /// Returns the earliest time at which an axis is due; `None` if there are no axes.
    pub fn next_due(&self) -> Option<Moment> {
        self.axes.iter().map(|axis| axis.due.unwrap_or_default()).min()
    }

    /// Returns the last decision of each axis.
    pub fn decisions(&self) -> impl Iterator<Item = &Decision> {
        self.axes.iter().map(|axis| &axis.decision)
    }

    /// Returns the last decision of one axis; `None` if there is no such axis.
    pub fn decision(&self, axis: usize) -> Option<&Decision> {
        self.axes.get(axis).map(|axis| &axis.decision)
    }

    /// Returns whether at least one model of this axis can be used now.
    pub fn has_usable_model(&self, axis: usize, snapshot: &Snapshot<'_>) -> bool {
        self.model_value(axis, snapshot).is_some()
    }

    /// Returns the index of the first usable model of this axis, and the Cz that it requests now. `None` if no model
    /// can be used.
    pub fn model_value(&self, axis: usize, snapshot: &Snapshot<'_>) -> Option<(usize, Micron)> {
        let chosen = self.axes.get(axis)?.choose(snapshot, &self.machine).0?;
        Some((chosen.model, chosen.raw))
    }

    /// Returns the contributions of the signals to the Cz of the model that an axis uses, the largest first. Returns an
    /// empty list if the axis uses no model.
    pub fn contributions(&self, axis: usize, snapshot: &Snapshot<'_>) -> Vec<Contribution> {
        let axis = self.axes.get(axis);
        let found = axis.and_then(|axis| axis.model(axis.decision.model?, snapshot, &self.machine));
        found.map(|(model, inputs)| model.contributions(&inputs)).unwrap_or_default()
    }

    /// Returns the sensors from which the stand-in of this signal is estimated, for this model of an axis. A
    /// stand-in replaces the reading of a frozen or lost sensor. `None` if the signal has no stand-in.
    pub fn predictors(
        &self,
        axis: usize,
        model: usize,
        signal: SignalId,
    ) -> Option<impl Iterator<Item = SignalId>> {
        self.axes.get(axis)?.predictors(model, signal)
    }

    /// Returns the suspected, frozen and lost sensors of an axis, without duplicates.
    pub fn rejected(&self, axis: usize) -> impl Iterator<Item = RejectedSensor> {
        self.axes.get(axis).into_iter().flat_map(Axis::rejected)
    }

    /// Returns the Cz that the first usable model of an axis requests now, if it is beyond the axis's error level; else
    /// `None`.
    pub fn beyond_error(&self, axis: usize, snapshot: &Snapshot<'_>) -> Option<Micron> {
        let axis = self.axes.get(axis)?;
        let chosen = axis.choose(snapshot, &self.machine).0?;
        axis.is_beyond_error(&chosen).then_some(chosen.raw)
    }

    /// Returns the results of the probings of an axis; `None` if the profile has no probing for the axis.
    pub fn probe(&self, axis: usize) -> Option<&Probe> {
        self.axes.get(axis).filter(|axis| axis.settings.probe.is_some()).map(|axis| &axis.probe)
    }

    /// Returns the preferred model of an axis; `None` if the axis does not learn.
    pub fn preference(&self, axis: usize) -> Option<&Preference> {
        self.axes.get(axis).filter(|axis| axis.settings.learned.is_some()).map(|axis| &axis.preference)
    }

    /// Requests a change of the preferred model of an axis. The request replaces a change that waits to take
    /// effect. `None` cancels the waiting change. The axis decides again at the next call of
    /// [`Compensation::step`].
    ///
    /// # Errors
    /// Returns why the change is rejected.
    pub fn prefer(&mut self, axis: usize, change: Option<Change>) -> Result<(), Unfit> {
        self.axes.get_mut(axis).ok_or(Unfit::NoSlot)?.prefer(change)
    }

    /// Withdraws the waiting change of the preferred model at an operator's request. The preference of the axis then
    /// records that the operator has withdrawn this model. The axis decides again at the next call of
    /// [`Compensation::step`].
    pub fn withdraw(&mut self, axis: usize) {
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.withdraw();
        }
    }

    /// Checks whether the axis would now correct its models with this measured error. The axis does not change.
    ///
    /// # Errors
    /// Returns the result that the probing would have, with the reason for the refusal.
    pub fn would_learn(
        &self,
        axis: usize,
        snapshot: &Snapshot<'_>,
        measured: Measured,
    ) -> Result<(), Probed> {
        let Some(axis) = self.axes.get(axis) else { return Ok(()) };
        let probed = axis.assess(snapshot, &self.machine, measured);
        if probed.refused.is_some() { Err(probed) } else { Ok(()) }
    }

    /// Checks whether a report that arrives at `now` may count as a measurement of this axis. A report is rejected if
    /// it was used before, or was measured before the datum (last zero point of Cz) of the axis. `shift` converts a
    /// [`Moment`] to wall-clock time.
    ///
    /// # Errors
    /// Returns why the report is rejected.
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

    /// Remembers a report that the axis has used, or that waits for another report. A repetition of the report is then
    /// rejected.
    pub fn take_report(&mut self, axis: usize, report: MeasuredReport, now: Moment) {
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.probe.reports.take(report, now);
        }
    }

    /// Updates the lags of the models with a snapshot at which no axis decides. A log of the gateway contains
    /// no such snapshot. A log of another program contains snapshots between two decisions, and the lags must
    /// include their readings.
    pub fn follow(&mut self, snapshot: &Snapshot<'_>) {
        for axis in &mut self.axes {
            axis.check(snapshot, &self.machine);
            axis.follow(snapshot, &self.machine);
        }
        self.take_beginnings();
    }

    /// Sets the machine-start references of sensors that are accepted again and could not be read at the machine start.
    /// The reference values are estimates. Returns whether at least one reference was set.
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

    /// Returns the state of the machine: the time since its start, and the references.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Returns the state that must be saved for a restart of the gateway.
    pub fn remembered(&self) -> Remembered {
        let axes = self.axes.iter().filter_map(Axis::remembered).collect();
        Remembered { machine: self.machine.clone(), axes, running: Vec::new() }
    }

    /// Returns the state that must be saved for a restart of the gateway, with the running state of each axis. A
    /// compensation that is created from this state makes the same decisions.
    pub fn running(&self) -> Remembered {
        Remembered { running: self.axes.iter().map(Axis::running).collect(), ..self.remembered() }
    }

    /// Starts to capture the "zero" references of all signals, and the datum (zero point of Cz) of each axis.
    pub fn zero(&mut self, now: Moment) {
        self.machine.zero(&self.settings, now);
        for axis in &mut self.axes {
            axis.zero(&self.settings, now);
        }
    }

    /// Starts to capture the "zero" references and the datum (zero point of Cz) of one axis. Returns `false`, and does
    /// nothing, if another axis uses the "zero" reference of the same signal.
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
