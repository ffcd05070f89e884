//! The levels of an axis: told once when Cz passes one, and what becomes of an axis beyond the error level.

use crate::observe::events::Event;
use isotherm_core::compensation::settings::{AxisSettings, OnFault};
use isotherm_core::compensation::{AxisState, Decision, Stages};
use isotherm_profile::AxisId;

use super::arming::Arming;
use super::shared::{Core, Shared};

/// What has been told of one axis and not come to its end.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LevelsTold {
    at_limit: bool,
    warned: bool,
    tripped: bool,
}

/// A warning ends when |Cz| is back below this share of its level: a value that trembles there is one warning.
const ENDS_AT: f64 = 0.95;

impl LevelsTold {
    /// Whether |Cz| lies beyond its warning level.
    pub(super) fn is_warned(&self) -> bool {
        self.warned
    }

    /// Adds what is to be told of this decision.
    pub(super) fn tell(&mut self, axis: &AxisSettings, decision: &Decision, untold: &mut Vec<Event>) {
        let name = || axis.name.clone();
        let at_limit = decision.acted.contains(Stages::LIMIT);
        if let Some(wanted) = decision.raw.filter(|_| at_limit && !self.at_limit) {
            untold.push(Event::AtLimit { axis: name(), wanted, limit: axis.guard.limit });
        }
        self.at_limit = at_limit;
        let size = decision.cz.abs().get().max(decision.slope.abs().get());
        let warned =
            axis.levels.warn.filter(|warn| size > warn.get() * if self.warned { ENDS_AT } else { 1.0 });
        if let Some(warn) = warned.filter(|_| !self.warned) {
            untold.push(Event::Warned { axis: name(), cz: decision.cz, warn });
        }
        self.warned = warned.is_some();
        let error = axis.levels.error.zip(decision.raw).filter(|_| decision.tripped && !self.tripped);
        if let Some((error, wanted)) = error {
            untold.push(Event::BeyondError { axis: name(), wanted, error });
        }
        self.tripped = decision.tripped;
    }
}

impl Core {
    /// An axis beyond its error level is off once its fault action has come to its end, and stays so until it is armed.
    pub(super) fn disarm_tripped(&mut self, shared: &Shared) {
        for (place, axis) in shared.profile.axes.iter().enumerate() {
            let Some(decision) = self.compensation.decision(place) else { continue };
            let ended = match decision.state {
                AxisState::Zeroed => true,
                AxisState::Holding(_) => axis.settings.on_fault == OnFault::Hold,
                _ => false,
            };
            let (is_tripped, asked) =
                (self.arming[place].armed && decision.tripped, self.arming[place].asked);
            if self.arming[place].tripped != is_tripped {
                self.arming[place].tripped = is_tripped;
            }
            let over = is_tripped && ended && !self.stopping;
            if over && self.has_arrived(&shared.profile, place, shared.dry_run) {
                let why =
                    "its model asked for more than the error level; arm it again when the cause is found";
                let told = self.disarm(AxisId(place), &axis.settings.name, why);
                self.untold.extend(told);
                self.arming[place] = Arming { latched: true, asked, ..Arming::default() };
            }
        }
    }
}
