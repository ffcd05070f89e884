//! Reported conditions of the axes. Each state, level, extrapolation, stand-in and worse model is reported once when it
//! begins, and once when it ends.

use std::time::Duration;

use crate::observe::events::Event;
use isotherm_core::compensation::model::Contribution;
use isotherm_core::compensation::settings::AxisSettings;
use isotherm_core::compensation::{AxisState, Decision, RejectedSensor, Stages};
use isotherm_core::explained::{Cause, Explained};
use isotherm_core::quantity::Moment;
use isotherm_profile::Profile;

use super::{comparison, extrapolation, stand_in};

/// Number of consecutive steps with another cause of the same state, before the change is reported.
const CHANGED_AFTER_STEPS: u32 = 2;

#[derive(Clone, Debug, Default)]
pub(in crate::gateway) struct ReportedConditions {
    state: AxisState,
    /// Reported cause of a state that is an alarm.
    cause: Option<Cause<String>>,
    levels: Levels,
    extrapolating: bool,
    /// Whether the model is worse than no compensation.
    worse: bool,
    rejected: Vec<stand_in::ReportedSensor>,
}

/// Levels of one axis that have been reported and have not ended.
#[derive(Clone, Copy, Debug, Default)]
struct Levels {
    limit: LimitState,
    warned: bool,
    tripped: bool,
}

/// Position of an axis at its limit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum LimitState {
    /// The axis is within its limit.
    #[default]
    Within,
    /// The model has requested more than the limit since this moment.
    Reached(Moment),
    /// The model requests more than the limit for so long that an alarm was reported.
    Lasting,
}

/// Fraction of a level below which the value ends a report about the level. A value that fluctuates at the level causes
/// one report.
const ENDS_AT: f64 = 0.95;
/// Time at the limit after which an alarm is reported.
const LIMIT_LASTS_AFTER: Duration = Duration::from_secs(5 * 60);
/// Largest number of contributions in the alarm.
const SHOWN_CONTRIBUTIONS: usize = 3;

impl Levels {
    fn is_warned(&self) -> bool {
        self.warned
    }

    /// Adds the events of this decision about the limit of the axis: one when the model requests more, one when this
    /// lasts, and one when it is over after it has lasted.
    fn report_limit(
        &mut self,
        (profile, axis): (&Profile, &AxisSettings),
        decision: &Decision,
        contributions: impl FnOnce() -> Vec<Contribution>,
        events: &mut Vec<Event>,
    ) {
        let (name, limit) = (|| axis.name.clone(), axis.guard.limit);
        let at_limit = decision.acted.contains(Stages::LIMIT);
        // Without a value of the model, it is not known whether the axis would leave its limit.
        let is_over = !at_limit
            && (matches!(decision.state, AxisState::Off)
                || decision.raw.is_some_and(|raw| raw.abs().get() < ENDS_AT * limit.get()));
        match (self.limit, decision.raw) {
            (LimitState::Within, Some(wanted)) if at_limit => {
                self.limit = LimitState::Reached(decision.at);
                events.push(Event::AtLimit { axis: name(), wanted, limit });
            }
            (LimitState::Reached(since), Some(wanted))
                if at_limit && decision.at.since(since) > LIMIT_LASTS_AFTER =>
            {
                self.limit = LimitState::Lasting;
                let mut largest = contributions();
                largest.truncate(SHOWN_CONTRIBUTIONS);
                let signals = largest.iter().map(|part| profile.signal(part.signal).name.clone()).collect();
                let contributions = largest.iter().map(|part| part.cz).collect();
                events.push(Event::LimitLasts { axis: name(), wanted, limit, signals, contributions });
            }
            (LimitState::Reached(_), _) if is_over => self.limit = LimitState::Within,
            (LimitState::Lasting, _) if is_over => {
                self.limit = LimitState::Within;
                events.push(Event::LimitOver { axis: name() });
            }
            _ => {}
        }
    }

    /// Adds the events of this decision about the levels of the axis.
    fn report(&mut self, axis: &AxisSettings, decision: &Decision, events: &mut Vec<Event>) {
        let name = || axis.name.clone();
        let size = decision.cz.abs().get().max(decision.slope.abs().get());
        let warned =
            axis.levels.warn.filter(|warn| size > warn.get() * if self.warned { ENDS_AT } else { 1.0 });
        if let Some(warn) = warned.filter(|_| !self.warned) {
            events.push(Event::Warned { axis: name(), cz: decision.cz, warn });
        }
        self.warned = warned.is_some();
        let error = axis.levels.error.zip(decision.raw).filter(|_| decision.tripped && !self.tripped);
        if let Some((error, wanted)) = error {
            events.push(Event::BeyondError { axis: name(), wanted, error });
        }
        self.tripped = decision.tripped;
    }
}

impl ReportedConditions {
    pub(in crate::gateway) fn is_warned(&self) -> bool {
        self.levels.is_warned()
    }

    /// Adds the events of this decision. `why` returns why the axis does not follow its preferred model.
    /// `contributions` returns the contributions of the signals to its Cz, the largest first.
    pub(in crate::gateway) fn report(
        &mut self,
        profile: &Profile,
        axis: &AxisSettings,
        decision: &Decision,
        (why, stopping): (impl FnOnce() -> Explained, bool),
        contributions: impl FnOnce() -> Vec<Contribution>,
        events: &mut Vec<Event>,
    ) {
        let (from, to) = (self.state.name(), decision.state.name());
        let is_alarm = !stopping && !matches!(decision.state, AxisState::Off | AxisState::Active);
        if from != to || is_alarm {
            let why = why();
            let is_another = match &mut self.cause {
                Some(cause) if from == to && !why.cause.is_empty() => {
                    cause.is_now(why.cause.clone(), CHANGED_AFTER_STEPS)
                }
                _ => false,
            };
            if from != to {
                self.cause = is_alarm.then(|| Cause::new(why.cause.clone()));
            }
            if from != to || is_another {
                events.push(Event::AxisState { axis: axis.name.clone(), from, to, why, stopping });
            }
            self.state = decision.state;
        }
        self.levels.report_limit((profile, axis), decision, contributions, events);
        self.levels.report(axis, decision, events);
        events.extend(extrapolation::event(profile, &axis.name, decision, &mut self.extrapolating));
        events.extend(comparison::event(axis, decision, &mut self.worse));
    }

    /// Adds the events of the sensors that the axis rejects.
    pub(in crate::gateway) fn report_rejected(
        &mut self,
        profile: &Profile,
        axis: &AxisSettings,
        decision: &Decision,
        rejected: impl Iterator<Item = RejectedSensor>,
        events: &mut Vec<Event>,
    ) {
        let found: Vec<RejectedSensor> = rejected.collect();
        if found.is_empty() && self.rejected.is_empty() {
            return;
        }
        stand_in::report((profile, &axis.name), decision, &found, &mut self.rejected, events);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gateway::store::log::sample;
    use isotherm_core::compensation::{Compensation, Remembered};
    use isotherm_core::quantity::Moment;

    /// Checks an axis on hold: first a sensor is lost, then a line is down. The state is the same, the cause differs.
    #[test]
    fn a_state_is_reported_again_when_its_cause_is_another_one_for_two_steps() {
        let profile = sample::profile();
        let axis = &profile.axes[0].settings;
        let compensation =
            Compensation::new(profile.machine.clone(), vec![axis.clone()], Remembered::default());
        let mut decision = *compensation.decision(0).unwrap();
        let mut reported = ReportedConditions::default();
        let mut step = |state, cause: &str, stopping| {
            decision.state = state;
            let mut events = Vec::new();
            let why = || Explained::new(cause, "mend it");
            reported.report(&profile, axis, &decision, (why, stopping), Vec::new, &mut events);
            let texts = events.iter().map(|event| event.entry(Moment::default()).text);
            texts.collect::<Vec<_>>()
        };
        let holding = AxisState::Holding(Moment::default());
        assert_eq!(step(holding, "bed is lost", false), ["axis z: off → frozen: bed is lost; mend it"]);
        assert_eq!(step(holding, "bed is lost", false), [""; 0]);
        assert_eq!(step(holding, "no connection", false), [""; 0]);
        assert_eq!(step(holding, "bed is lost", false), [""; 0], "it came and went");
        assert_eq!(step(holding, "no connection", false), [""; 0]);
        assert_eq!(step(holding, "no connection", false), ["axis z: still frozen: no connection; mend it"]);
        assert_eq!(step(holding, "", false), [""; 0]);
        assert_eq!(step(holding, "stopping", true), [""; 0]);
        assert_eq!(step(holding, "stopping", true), [""; 0], "an orderly stop is no trouble");
        assert_eq!(step(AxisState::Active, "", false), ["axis z: frozen → compensating"]);
        assert_eq!(step(AxisState::Active, "a", false), [""; 0]);
    }
}
