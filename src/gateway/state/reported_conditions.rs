//! Conditions of the axes that are reported once when they begin, and once when they end. They are the state, the
//! levels, extrapolation, stand-ins (values that replace a sensor), and a model that is worse than no compensation.

use std::time::Duration;

use crate::observe::events::Event;
use isotherm_core::compensation::model::Contribution;
use isotherm_core::compensation::settings::AxisSettings;
use isotherm_core::compensation::{AxisState, Decision, RejectedSensor, Stages};
use isotherm_core::explained::{Cause, Explained};
use isotherm_core::quantity::Moment;
use isotherm_profile::Profile;

use super::{comparison, extrapolation, stand_in};

/// Number of consecutive steps in which the same state has a new cause, after which the new cause is reported.
const CHANGED_AFTER_STEPS: u32 = 2;

/// Conditions of one axis as they were last reported.
#[derive(Clone, Debug, Default)]
pub(in crate::gateway) struct ReportedConditions {
    state: AxisState,
    /// Cause of the present state that was reported as an alarm; `None` if the state is not an alarm.
    cause: Option<Cause<String>>,
    levels: Levels,
    extrapolating: bool,
    /// Whether the model was reported as worse than no compensation.
    worse: bool,
    rejected: Vec<stand_in::ReportedSensor>,
}

/// Levels of one axis (limit, warning level, error level) that were reported as exceeded, and whose end was not
/// reported.
#[derive(Clone, Copy, Debug, Default)]
struct Levels {
    limit: LimitState,
    warned: bool,
    tripped: bool,
}

/// State of an axis with respect to its limit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum LimitState {
    /// The axis is within its limit.
    #[default]
    Within,
    /// The model has requested more than the limit since this moment.
    Reached(Moment),
    /// The model has requested more than the limit for so long that the alarm was reported.
    Lasting,
}

/// Fraction of a level below which the level counts as no longer exceeded. Therefore a value that fluctuates around
/// the level is reported once.
const ENDS_AT: f64 = 0.95;
/// Time for which an axis must be at its limit before an alarm is reported.
const LIMIT_LASTS_AFTER: Duration = Duration::from_secs(5 * 60);
/// Maximum number of signals that the alarm lists with their contributions to Cz.
const SHOWN_CONTRIBUTIONS: usize = 3;

impl Levels {
    /// Adds events about the limit of the axis after a decision. An event reports that the axis has reached
    /// its limit, has been at its limit for [`LIMIT_LASTS_AFTER`], or is clearly within its limit again.
    fn report_limit(
        &mut self,
        (profile, axis): (&Profile, &AxisSettings),
        decision: &Decision,
        contributions: impl FnOnce() -> Vec<Contribution>,
        events: &mut Vec<Event>,
    ) {
        let (name, limit) = (|| axis.name.clone(), axis.guard.limit);
        let at_limit = decision.acted.contains(Stages::LIMIT);
        // The limit applies to the slope too. Without a value of the model, it is not known whether the axis would
        // leave its limit. At zero after a fault action, and off, the axis has left it.
        let slope = decision.slope_target.abs().get();
        let is_over = !at_limit
            && (matches!(decision.state, AxisState::Off | AxisState::Zeroed)
                || decision.raw.is_some_and(|raw| raw.abs().get().max(slope) < ENDS_AT * limit.get()));
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

    /// Adds events about the warning level and the error level of the axis after a decision.
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
        self.levels.warned
    }

    /// Adds the events after a decision of the axis. `why` returns why the axis does not follow its preferred model.
    /// `contributions` returns the contributions of the signals to Cz, with the largest contribution first.
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
        events.extend(extrapolation::event(profile, axis, decision, &mut self.extrapolating));
        events.extend(comparison::event(axis, decision, &mut self.worse));
    }

    /// Adds events about the sensors that the axis rejects.
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
    use isotherm_core::reading::SignalId;

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

    /// Axis with its limit. The test sets what the model requests, second by second.
    struct Limited {
        profile: Profile,
        decision: Decision,
        reported: ReportedConditions,
        contributions: Vec<Contribution>,
    }

    impl Limited {
        fn new() -> Limited {
            let profile = sample::profile();
            let axis = profile.axes[0].settings.clone();
            let compensation = Compensation::new(profile.machine.clone(), vec![axis], Remembered::default());
            let decision = Decision { state: AxisState::Active, ..*compensation.decision(0).unwrap() };
            let part = |place, cz| Contribution { signal: SignalId(place), cz: sample::of(cz) };
            let contributions = vec![part(0, 65.0), part(1, -6.0), part(2, 2.0), part(3, 0.5)];
            let mut limited =
                Limited { profile, decision, reported: ReportedConditions::default(), contributions };
            limited.at(0, Some(0.0));
            limited
        }

        /// Returns the kinds of the events at this second. `times` is the requested Cz as a multiple of the limit.
        fn at(&mut self, second: u64, times: Option<f64>) -> Vec<String> {
            self.events(second, times).into_iter().map(|(kind, _)| kind).collect()
        }

        fn events(&mut self, second: u64, times: Option<f64>) -> Vec<(String, String)> {
            let axis = &self.profile.axes[0].settings;
            self.decision.at = Moment::default().after(Duration::from_secs(second));
            self.decision.raw = times.map(|times| sample::of(times * axis.guard.limit.get()));
            let is_steep = self.decision.slope_target >= axis.guard.limit;
            let is_beyond = is_steep || times.is_some_and(|times| times.abs() > 1.0);
            self.decision.acted = if is_beyond { Stages::LIMIT } else { Stages::default() };
            let (mut events, parts) = (Vec::new(), self.contributions.clone());
            let why = (|| Explained::from("a cause"), false);
            self.reported.report(&self.profile, axis, &self.decision, why, || parts, &mut events);
            let entries = events.iter().map(|event| event.entry(Moment::default()));
            let of_limit = entries.filter(|entry| entry.kind.contains("limit"));
            of_limit.map(|entry| (entry.kind.to_string(), entry.text)).collect()
        }
    }

    #[test]
    fn an_axis_at_its_limit_for_more_than_five_minutes_is_an_alarm_that_names_the_signals() {
        let mut limited = Limited::new();
        assert_eq!(limited.at(10, Some(1.5)), ["at-limit"]);
        assert!(
            (11..=310).all(|second| limited.at(second, Some(1.5)).is_empty()),
            "five minutes are allowed"
        );
        let events = limited.events(311, Some(1.5));
        let [(kind, text)] = events.as_slice() else { panic!("{events:?}") };
        assert_eq!(kind, "limit-lasts");
        let names: Vec<&str> = limited.profile.signals.iter().map(|signal| signal.name.as_str()).collect();
        let parts = format!(
            "largest contributions: {} 65.0 µm, {} -6.0 µm, {} 2.0 µm;",
            names[0], names[1], names[2]
        );
        assert!(text.contains(&parts) && !text.contains("0.5 µm"), "{text}");
        assert!((312..900).all(|second| limited.at(second, Some(1.5)).is_empty()), "it is reported once");
        assert_eq!(limited.at(900, Some(0.5)), ["limit-over"]);
        assert_eq!(limited.at(901, Some(1.5)), ["at-limit"], "the time begins again");
        assert_eq!(limited.at(1000, Some(1.5)), [""; 0]);
    }

    /// A value that fluctuates at the limit, or is missing for a moment, does not restart the time until the
    /// alarm.
    #[test]
    fn only_a_value_clearly_within_the_limit_ends_the_time() {
        let mut limited = Limited::new();
        assert_eq!(limited.at(10, Some(-1.01)), ["at-limit"]);
        for second in 11..=310 {
            let times = [Some(-1.01), Some(-0.99), None][usize::try_from(second % 3).unwrap()];
            assert_eq!(limited.at(second, times), [""; 0], "second {second}");
        }
        assert_eq!(limited.at(320, Some(-1.01)), ["limit-lasts"]);
        assert_eq!(limited.at(321, None), [""; 0]);
        assert_eq!(limited.at(322, Some(-0.96)), [""; 0]);
        limited.decision.state = AxisState::Off;
        assert_eq!(limited.at(323, None), ["limit-over"]);
    }

    /// The alarm of an axis ends when its fault action has reached zero, even if the model has no value for
    /// months.
    #[test]
    fn a_fault_action_that_has_reached_zero_ends_the_alarm() {
        let mut limited = Limited::new();
        assert_eq!(limited.at(10, Some(1.5)), ["at-limit"]);
        assert_eq!(limited.at(311, Some(1.5)), ["limit-lasts"]);
        limited.decision.state = AxisState::Ramping;
        assert_eq!(limited.at(312, None), [""; 0]);
        limited.decision.state = AxisState::Zeroed;
        assert_eq!(limited.at(400, None), ["limit-over"]);
    }
    #[test]
    fn a_slope_that_fluctuates_at_the_limit_is_reported_once() {
        let mut limited = Limited::new();
        let limit = limited.profile.axes[0].settings.guard.limit.get();
        let mut step = |second, slope: f64| {
            limited.decision.slope_target = sample::of(slope * limit);
            limited.at(second, Some(0.5))
        };
        assert_eq!(step(10, 1.0), ["at-limit"]);
        for second in 11..=310 {
            let slope = if second % 2 == 0 { 1.0 } else { 0.99 };
            assert_eq!(step(second, slope), [""; 0], "second {second}");
        }
        assert_eq!(step(320, 1.0), ["limit-lasts"]);
        assert_eq!(step(321, 0.99), [""; 0]);
        assert_eq!(step(322, 0.9), ["limit-over"]);
    }
}
