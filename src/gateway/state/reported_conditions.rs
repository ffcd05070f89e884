//! Reported conditions of the axes. Each state, level, extrapolation, stand-in and worse model is reported once when it
//! begins, and once when it ends.

use crate::observe::events::Event;
use isotherm_core::compensation::settings::AxisSettings;
use isotherm_core::compensation::{AxisState, Decision, RejectedSensor, Stages};
use isotherm_core::explained::{Cause, Explained};
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
    at_limit: bool,
    warned: bool,
    tripped: bool,
}

/// Fraction of the warning level below which |Cz| ends a warning. A value that fluctuates at the level causes one
/// warning.
const ENDS_AT: f64 = 0.95;

impl Levels {
    fn is_warned(&self) -> bool {
        self.warned
    }

    /// Adds the events of this decision.
    fn report(&mut self, axis: &AxisSettings, decision: &Decision, events: &mut Vec<Event>) {
        let name = || axis.name.clone();
        let at_limit = decision.acted.contains(Stages::LIMIT);
        if let Some(wanted) = decision.raw.filter(|_| at_limit && !self.at_limit) {
            events.push(Event::AtLimit { axis: name(), wanted, limit: axis.guard.limit });
        }
        self.at_limit = at_limit;
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
    pub(in crate::gateway) fn report(
        &mut self,
        profile: &Profile,
        axis: &AxisSettings,
        decision: &Decision,
        (why, stopping): (impl FnOnce() -> Explained, bool),
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
            reported.report(&profile, axis, &decision, (why, stopping), &mut events);
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
