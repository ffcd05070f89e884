//! One axis: its models, the limiters of Cz and slope (guards), and its state. Cz is the compensation value,
//! which is added to the position of the axis. The slope is the part of the compensation that depends on the
//! position. The envelope of a model is the region of inputs on which the model was identified. A stand-in is
//! an estimate that replaces the reading of a rejected sensor.

use std::time::Duration;

use super::datum::Zeroing;
use super::guard::{Guard, Pace};
use super::model::{CLEARLY_INSIDE, Lag, Outside, Reference};
use super::preference::Preference;
use super::probe::Probe;
use super::reference::Machine;
use super::remembered::AxisMemory;
use super::settings::{AxisSettings, Datum, GuardSettings, MachineSettings, OnFault};
use super::{AxisRunning, AxisState, Control, Decision, Permit, Snapshot, Stages, Worse};
use crate::quantity::{Micron, Moment};

mod expected;
mod learn;
mod model_choice;
mod preferred;
mod sensor_watch;

use model_choice::ModelChoice;
pub(super) use sensor_watch::ModelWatch;

#[derive(Clone, Debug)]
pub(super) struct Axis {
    pub(super) settings: AxisSettings,
    /// Whether the axis has models, and none of them reads a signal. The steps of such an axis do not update the state
    /// of the machine.
    pub(super) reads_nothing: bool,
    /// For each model: the lag of each input that may have a lag, in the order of `Model::rises`.
    lags: Vec<Vec<Lag>>,
    /// For each model: the check of its sensors, with the rejected sensors and their stand-ins.
    watched: Vec<ModelWatch>,
    zeroing: Zeroing,
    pub(super) probe: Probe,
    pub(super) preference: Preference,
    guard: Guard,
    slope_guard: Guard,
    state: AxisState,
    permit: Permit,
    /// Whether a model has requested a Cz beyond the error level (setting `error` of the axis) since the axis was
    /// armed.
    tripped: bool,
    /// Whether the axis keeps its value because the model's inputs are outside its envelope.
    kept_outside: bool,
    /// First fallback model that the axis does not use because the inputs are outside the envelope of this model.
    fallback_outside: Option<usize>,
    stepped: Option<Moment>,
    pub(super) due: Option<Moment>,
    pub(super) decision: Decision,
}

/// Cz and slope after the limits of the axis (limit, deadband, step, rate, rounding).
struct GuardResult {
    cz: Micron,
    slope: Micron,
    /// Requested Cz, clamped to the limit.
    target: Micron,
    slope_target: Micron,
    acted: Stages,
}

impl Axis {
    pub(super) fn new(settings: AxisSettings) -> Axis {
        let decision = Decision {
            at: Moment::default(),
            raw: None,
            expected: None,
            expected_touches: 0,
            correction: Micron::ZERO,
            model: None,
            cz: Micron::ZERO,
            slope: Micron::ZERO,
            target: Micron::ZERO,
            slope_target: Micron::ZERO,
            state: AxisState::Off,
            acted: Stages::default(),
            lacks: None,
            stood_in: None,
            tripped: false,
            worse: None,
            extrapolating: None,
            excess: None,
        };
        let lags = settings.models.iter().map(|model| model.rises().map(|_| Lag::default()).collect());
        Axis {
            reads_nothing: !settings.models.is_empty()
                && settings.models.iter().all(|model| model.signals().is_empty()),
            lags: lags.collect(),
            watched: ModelWatch::all(&settings.models),
            zeroing: Zeroing::new(settings.models.len()),
            probe: Probe::new(&settings.models, settings.probe.as_ref()),
            preference: Preference::new(settings.learned.as_ref()),
            settings,
            guard: Guard::default(),
            slope_guard: Guard::default(),
            state: AxisState::Off,
            permit: Permit::Off,
            tripped: false,
            kept_outside: false,
            fallback_outside: None,
            stepped: None,
            due: None,
            decision,
        }
    }

    /// Restores the state of an earlier run. A term that differs from the saved term starts without its saved state.
    pub(super) fn recall(&mut self, remembered: &AxisMemory) {
        self.recall_preference(remembered.preference());
        for (model, lags) in self.settings.models.iter().zip(&mut self.lags) {
            for ((place, input), lag) in model.rises().enumerate().zip(lags) {
                *lag = remembered.lag(&model.name, place, input);
            }
        }
        remembered.recall_watches(&mut self.watched);
        if self.settings.datum == Datum::Zero {
            self.zeroing = remembered.zeroing(self.settings.models.iter().map(|model| model.name.as_str()));
        }
        if let (Some(settings), Some(kept)) = (&self.settings.probe, remembered.probe()) {
            self.probe.recall(kept, settings);
        }
    }

    /// Returns the state that must be saved for a restart of the gateway; `None` if nothing must be saved.
    pub(super) fn remembered(&self) -> Option<AxisMemory> {
        let kept = AxisMemory::of(&self.settings, &self.lags, &self.watched, &self.zeroing, &self.probe);
        match self.preference.is_worth_saving() {
            true => Some(AxisMemory::with_preference(kept, &self.settings.name, &self.preference)),
            false => kept,
        }
    }

    /// Restores the running state of the axis, to continue in the middle of a run.
    pub(super) fn go_on(&mut self, running: &AxisRunning) {
        (self.guard, self.slope_guard) = (running.guard, running.slope_guard);
        (self.state, self.permit, self.tripped) = (running.state, running.permit, running.tripped);
        (self.kept_outside, self.fallback_outside) = (running.kept_outside, running.fallback_outside);
        (self.stepped, self.due, self.decision) = (running.stepped, running.due, running.decision);
    }

    /// Returns the running state of the axis, with which another run can continue.
    pub(super) fn running(&self) -> AxisRunning {
        AxisRunning {
            axis: self.settings.name.clone(),
            guard: self.guard,
            slope_guard: self.slope_guard,
            state: self.state,
            permit: self.permit,
            tripped: self.tripped,
            kept_outside: self.kept_outside,
            fallback_outside: self.fallback_outside,
            stepped: self.stepped,
            due: self.due,
            decision: self.decision,
        }
    }

    /// Starts to capture the datum (zero point of Cz) of the axis, and the references of its models that a zero command
    /// sets.
    pub(super) fn zero(&mut self, machine: &MachineSettings, now: Moment) {
        if self.settings.datum == Datum::Zero {
            self.zeroing.begin(now.after(machine.settle));
        }
        self.renew(Reference::Zero, now.after(machine.settle));
    }

    /// Handles a machine start: the models' machine-start references are captured again, and the checks of the sensors
    /// are reset.
    pub(super) fn started(&mut self, machine: &MachineSettings, now: Moment) {
        self.renew(Reference::Start, now.after(machine.settle));
        self.restart_watches(now);
    }

    /// Returns whether the axis must compute a decision now: its period is over, it never ran, time went
    /// back, or its control has a new demand.
    pub(super) fn is_due(&self, now: Moment, control: &Control) -> bool {
        let (Some(due), Some(last)) = (self.due, self.stepped) else { return true };
        let is_new = control.permit != self.permit || control.trust;
        now >= due || now < last || is_new || control.takes_over() || control.teaches()
    }

    pub(super) fn step(&mut self, snapshot: &Snapshot<'_>, machine: &Machine, control: Control) {
        let now = snapshot.now;
        let dt = self.stepped.map_or(self.settings.every, |last| now.since(last));
        let mut at_datum = false;
        if self.zeroing.is_open() {
            let mut zeroing = std::mem::take(&mut self.zeroing);
            zeroing.gather(now, |place| {
                // If the profile has no model for the axis, the datum of the learned model is captured before its
                // adoption too.
                let is_used = self.is_ranked(place) || self.preferred().is_none();
                let evaluated = is_used.then(|| self.evaluate(place, snapshot, machine).ok());
                evaluated.flatten().map(|found| found.outputs)
            });
            self.zeroing = zeroing;
            at_datum = !self.zeroing.is_open();
        }
        if self.settings.probe.is_some() {
            at_datum |= self.be_taught(snapshot, machine, control);
            self.change_preferred((snapshot, machine), at_datum, control.permit);
        }
        let (chosen, lacks, fallback_outside) = self.choose(snapshot, machine);
        self.fallback_outside = fallback_outside;
        if let Some(found) = control.take_over {
            self.guard.take_over(found, &self.settings.guard);
        }
        // An axis without `intercept_slope` has no slope to take over.
        if let Some(found) = control.take_over_slope.filter(|_| self.settings.intercept_slope.is_some()) {
            self.slope_guard.take_over(found, &self.slope_settings());
        }
        self.note_error_level(chosen, control.permit);
        let worse = self.worse(chosen);
        let is_left =
            control.permit == Permit::Armed && worse.is_some() && self.settings.leaves_what_is_worse();
        let followed = chosen.filter(|_| !self.tripped && !is_left);
        let keeps =
            control.permit == Permit::Armed && followed.is_some_and(|chosen| self.keeps_outside(&chosen));
        self.state = match is_left {
            true => self.returns_to_zero(),
            false => self.next_state(now, followed, control.permit, keeps),
        };
        self.kept_outside = keeps;
        let ramp = if is_left { Pace::Ramp } else { self.ramp_pace() };
        let GuardResult { cz, slope, target, slope_target, acted } =
            self.guarded(followed, &control, (dt, ramp));
        if self.state == AxisState::Ramping && cz == Micron::ZERO && slope == Micron::ZERO {
            self.state = AxisState::Zeroed;
        }
        let expected = chosen.and_then(|chosen| self.expected(&chosen, now, machine));
        self.decision = Decision {
            at: now,
            raw: chosen.map(|chosen| chosen.raw),
            expected: expected.map(|(expected, _)| expected),
            expected_touches: expected.map_or(0, |(_, touches)| touches),
            correction: chosen.map_or(Micron::ZERO, |chosen| chosen.correction),
            model: chosen.map(|chosen| chosen.model),
            cz,
            slope,
            target,
            slope_target,
            state: self.state,
            acted,
            lacks,
            stood_in: chosen.and_then(|chosen| chosen.stood_in),
            tripped: self.tripped,
            worse,
            extrapolating: chosen.and_then(|chosen| chosen.coverage?.extrapolating),
            excess: chosen.and_then(|chosen| chosen.coverage).map(|coverage| coverage.excess),
        };
        self.due = Some(self.next_due(now, control.sign.is_some()));
        self.permit = control.permit;
        self.stepped = Some(now);
    }

    /// Updates `tripped`. A model that requests more than the error level is not used before an operator arms the axis
    /// again.
    fn note_error_level(&mut self, chosen: Option<ModelChoice>, permit: Permit) {
        let beyond = chosen.is_some_and(|chosen| self.is_beyond_error(&chosen));
        self.tripped = permit != Permit::Off && (self.tripped || beyond);
    }

    pub(super) fn is_beyond_error(&self, chosen: &ModelChoice) -> bool {
        let error = self.settings.levels.error;
        error.is_some_and(|error| chosen.raw.abs() > error || chosen.slope.abs() > error)
    }

    /// Returns the comparison between the model in use and no compensation if the model is worse than no compensation;
    /// else `None`. While no model can be used, returns the comparison of the last decision.
    fn worse(&self, chosen: Option<ModelChoice>) -> Option<Worse> {
        match chosen {
            _ if self.settings.probe.is_none() => None,
            Some(chosen) => self.probe.worse(chosen.model),
            None => self.decision.worse,
        }
    }

    /// Returns the pace at which Cz goes to zero: the largest steps if `on_fault` is `zero`, else the rate of the axis.
    fn ramp_pace(&self) -> Pace {
        match self.settings.on_fault {
            OnFault::Zero => Pace::Steps,
            OnFault::Hold | OnFault::Ramp { .. } => Pace::Ramp,
        }
    }

    /// Returns the state of an axis whose Cz must go to zero: `Zeroed` if the axis is at zero, else `Ramping`.
    fn returns_to_zero(&self) -> AxisState {
        if self.is_at_zero() { AxisState::Zeroed } else { AxisState::Ramping }
    }

    /// Moves Cz and slope towards the requested values, within the limits of the axis. Returns the new values, the
    /// targets, and the limits that changed either value. `dt`: time since the last step. `ramp`: pace at which Cz goes
    /// to zero.
    fn guarded(
        &mut self,
        followed: Option<ModelChoice>,
        control: &Control,
        (dt, ramp): (Duration, Pace),
    ) -> GuardResult {
        // An axis whose output failed returns, too. The value that could not be written was decided from wrong
        // readings.
        let returns =
            control.return_to.filter(|_| matches!(control.permit, Permit::Armed | Permit::Unverified));
        let (wanted, pace) = match (self.state, followed) {
            (AxisState::Active | AxisState::Degraded, Some(chosen)) => {
                (Some((control.sign.unwrap_or(chosen.raw), chosen.slope)), Pace::Follow)
            }
            // An axis without models is armed only for a check of its sign, and then returns to zero.
            (AxisState::Active, None) => {
                (Some((control.sign.unwrap_or(Micron::ZERO), Micron::ZERO)), Pace::Follow)
            }
            (AxisState::Ramping, _) => (Some((Micron::ZERO, Micron::ZERO)), ramp),
            (AxisState::Holding(_), None) => (returns.map(|to| (to.cz, to.slope)), Pace::Follow),
            _ => (None, Pace::Follow),
        };
        let guard = &self.settings.guard;
        let Some((target, slope_target)) = wanted else {
            let (cz, slope) = (self.guard.value(), self.slope_guard.value());
            return GuardResult { cz, slope, target: cz, slope_target: slope, acted: Stages::default() };
        };
        let (mut cz, acted) = self.guard.advance(target, dt, pace, guard);
        if let Some(behind) = control.behind {
            cz = self.guard.stay_near(behind, guard);
        }
        let target = target.clamp_to(guard.limit);
        if self.settings.intercept_slope.is_none() {
            return GuardResult { cz, slope: Micron::ZERO, target, slope_target: Micron::ZERO, acted };
        }
        let settings = self.slope_settings();
        let (slope, also) = self.slope_guard.advance(slope_target, dt, pace, &settings);
        GuardResult {
            cz,
            slope,
            target,
            slope_target: slope_target.clamp_to(settings.limit),
            acted: acted.and(also),
        }
    }

    /// Returns the limits for changes of the slope. They equal the limits of Cz, except for the size of a count of the
    /// slope's register.
    fn slope_settings(&self) -> GuardSettings {
        GuardSettings {
            count: self.settings.intercept_slope.and_then(|line| line.count),
            ..self.settings.guard
        }
    }

    /// Returns the time of the axis's next step. This is the next tick of the period or, if earlier, the end
    /// of the time for which the axis keeps its Cz after a fault. `is_checked`: the operator checks the sign.
    fn next_due(&self, now: Moment, is_checked: bool) -> Moment {
        // The operator waits at the machine: the axis moves as fast as it may.
        let period = if is_checked { self.settings.ramp_period() } else { self.period() };
        let tick = match self.due {
            // The axis was stepped before its time, or time went back.
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

    /// Returns whether the axis must keep its value because the inputs of this model are outside its envelope. This
    /// state lasts until the inputs are clearly inside.
    fn keeps_outside(&self, chosen: &ModelChoice) -> bool {
        let envelope = self.settings.models.get(chosen.model).and_then(|model| model.envelope.as_ref());
        let Some(coverage) =
            chosen.coverage.filter(|_| envelope.is_some_and(|e| e.outside() == Outside::Hold))
        else {
            return false;
        };
        let begins = coverage.extrapolating.is_some_and(|found| found.outside == Outside::Hold);
        begins || (self.kept_outside && coverage.extrapolating.is_none() && coverage.excess >= CLEARLY_INSIDE)
    }

    fn next_state(
        &self,
        now: Moment,
        followed: Option<ModelChoice>,
        permit: Permit,
        outside: bool,
    ) -> AxisState {
        let keeps = permit == Permit::Held || outside;
        match (permit, followed) {
            (Permit::Off, _) => AxisState::Off,
            // The axis never took over the register value, so it has nothing to return.
            (Permit::Stopping, _) if self.state == AxisState::Off => AxisState::Off,
            _ if keeps => match self.state {
                AxisState::Holding(since) => AxisState::Holding(since),
                _ => AxisState::Holding(now),
            },
            (Permit::Armed, Some(chosen))
                if chosen.stood_in.is_none() && self.preferred() == Some(chosen.model) =>
            {
                AxisState::Active
            }
            (Permit::Armed, Some(_)) => AxisState::Degraded,
            (Permit::Armed, None) if self.settings.models.is_empty() => AxisState::Active,
            // The Cz of a sign check goes to zero now. After the next start it would stay, because the axis is off.
            (Permit::Stopping, None) if self.settings.models.is_empty() => self.returns_to_zero(),
            (Permit::Armed | Permit::Unverified | Permit::Held, _) => self.fault_action(now, false),
            (Permit::Stopping, _) => self.fault_action(now, true),
        }
    }

    fn fault_action(&self, now: Moment, at_once: bool) -> AxisState {
        let since = match self.state {
            AxisState::Ramping | AxisState::Zeroed => return self.returns_to_zero(),
            // A value kept outside an envelope was not a fault: the fault begins now.
            AxisState::Holding(_) if self.kept_outside => now,
            // If time went back, the hold begins now, so that its end is not delayed.
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

    fn is_at_zero(&self) -> bool {
        self.guard.value() == Micron::ZERO && self.slope_guard.value() == Micron::ZERO
    }

    fn period(&self) -> Duration {
        if self.state == AxisState::Ramping { self.settings.ramp_period() } else { self.settings.every }
    }
}
