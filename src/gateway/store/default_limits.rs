//! Default limits of temperature signals in the last run. A default limit that applies for the first time is reported
//! once, for example after an upgrade of isotherm or a change of the profile.

use std::collections::BTreeMap;

use crate::observe::events::Event;
use isotherm_profile::{DefaultLimits, Profile, Unit};

/// Default limits of the signals to which such limits apply, by signal name.
pub(in crate::gateway) type KnownLimits = BTreeMap<String, DefaultLimits>;

/// Returns the default limits that apply to the temperature signals of this profile. The gateway saves them for the
/// next run.
pub(in crate::gateway) fn of(profile: &Profile) -> KnownLimits {
    let with_limits = profile.signals.iter().filter(|signal| !signal.defaults.is_empty());
    with_limits.map(|signal| (signal.name.clone(), signal.defaults)).collect()
}

/// Returns events about default limits that did not apply in the last run. All signals with the same limits share one
/// event. `known` contains the limits of the last run.
pub(in crate::gateway) fn new_since(known: &KnownLimits, profile: &Profile) -> Vec<Event> {
    let mut groups: Vec<((Unit, DefaultLimits), Vec<String>)> = Vec::new();
    for signal in &profile.signals {
        let (name, limits) = (&signal.name, signal.defaults);
        if limits.is_empty() || known.get(name) == Some(&limits) {
            continue;
        }
        let key = (signal.unit, limits);
        match groups.iter_mut().find(|(group, _)| *group == key) {
            Some((_, names)) => names.push(name.clone()),
            None => groups.push((key, vec![name.clone()])),
        }
    }
    let event = |((unit, limits), signals): ((Unit, DefaultLimits), Vec<String>)| Event::DefaultLimits {
        signals,
        limits: limits.conditions(unit),
    };
    groups.into_iter().map(event).collect()
}

#[cfg(test)]
mod tests;
