//! What has been reported of the axes: each state, level, extrapolation and stand-in once when it begins, and once when it ends.

use crate::observe::events::Event;
use isotherm_core::compensation::settings::AxisSettings;
use isotherm_core::compensation::{AxisState, Decision, Distrusted, Stages};
use isotherm_profile::Profile;

use super::{extrapolation, stand_in};

#[derive(Clone, Debug, Default)]
pub(super) struct Reported {
    state: AxisState,
    levels: Levels,
    extrapolating: bool,
    distrusted: Vec<stand_in::Reported>,
}

/// Which levels of one axis have been reported and not come to their end.
#[derive(Clone, Copy, Debug, Default)]
struct Levels {
    at_limit: bool,
    warned: bool,
    tripped: bool,
}

/// A warning ends when |Cz| is back below this share of its level: a value that trembles there is one warning.
const ENDS_AT: f64 = 0.95;

impl Levels {
    fn is_warned(&self) -> bool {
        self.warned
    }

    /// Adds what is to be reported of this decision.
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

impl Reported {
    pub(super) fn is_warned(&self) -> bool {
        self.levels.is_warned()
    }

    /// Adds what is to be reported of this decision; `why` says why the axis does not follow its preferred model.
    pub(super) fn report(
        &mut self,
        profile: &Profile,
        axis: &AxisSettings,
        decision: &Decision,
        (why, stopping): (impl FnOnce() -> String, bool),
        events: &mut Vec<Event>,
    ) {
        if self.state.name() != decision.state.name() {
            events.push(Event::AxisState {
                axis: axis.name.clone(),
                from: self.state.name(),
                to: decision.state.name(),
                why: why(),
                stopping,
            });
            self.state = decision.state;
        }
        self.levels.report(axis, decision, events);
        events.extend(extrapolation::event(profile, &axis.name, decision, &mut self.extrapolating));
    }

    /// Adds what is to be reported of the sensors that the axis does not believe.
    pub(super) fn report_distrusted(
        &mut self,
        profile: &Profile,
        axis: &AxisSettings,
        decision: &Decision,
        distrusted: impl Iterator<Item = Distrusted>,
        events: &mut Vec<Event>,
    ) {
        let found: Vec<Distrusted> = distrusted.collect();
        if found.is_empty() && self.distrusted.is_empty() {
            return;
        }
        stand_in::report((profile, &axis.name), decision, &found, &mut self.distrusted, events);
    }
}
