//! State of a machine over a restart: time since machine start, references, lags, datums, what probings taught, the Cz that was
//! verified last, and the last good values.
//!
//! The [store](super::store) keeps it. If it does not accept a state, the gateway starts without one, and a person arms.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::board::LastGood;
use super::places::{Places, renamed};
use super::sign::SignMemory;
use super::store::{by_name, by_place};
use isotherm_core::compensation::Remembered;
use isotherm_core::compensation::settings::AxisSettings;
use isotherm_core::place::Moved;
use isotherm_core::quantity::{Moment, Shift, Shifted};
use isotherm_core::reading::SignalId;
use isotherm_profile::Profile;

/// State at one moment.
#[derive(Debug)]
pub(super) struct Memory {
    at: Moment,
    /// Names of the signals, by their places in what is remembered.
    signals: Vec<String>,
    remembered: Remembered,
    verified_um: BTreeMap<String, f64>,
    rest: Rest,
}

/// Parts of the state that are saved without a change.
#[derive(Debug)]
pub(super) struct Rest {
    /// By axis: what is known of its sign.
    pub(super) signs: BTreeMap<String, SignMemory>,
    pub(super) places: Arc<Places>,
    /// Last good values of signals with a `max_rate`.
    pub(super) values: BTreeMap<String, LastGood>,
}

/// State as the document has it.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SavedState {
    at: Moment,
    /// What the compensation remembers, by name.
    machine: Value,
    /// Cz as last verified in each offset output and as last written in each corrected position, µm.
    verified_um: BTreeMap<String, f64>,
    /// By axis: what is known of its sign.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    signs: BTreeMap<String, SignMemory>,
    /// Places of signals and outputs. None in a document of layout 5.
    #[serde(default)]
    places: Places,
    /// Last good values of signals with a `max_rate`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    values: BTreeMap<String, LastGood>,
}

/// State that a run finds.
#[derive(Debug, Default)]
pub(super) struct Recalled {
    /// Its moments are stamps, as the clock of that run had them.
    pub(super) remembered: Remembered,
    /// When it was kept.
    pub(super) at: Option<Moment>,
    /// Cz as last verified in each offset output and as last written in each corrected position, µm.
    pub(super) verified_um: BTreeMap<String, f64>,
    /// By axis: what is known of its sign.
    pub(super) signs: BTreeMap<String, SignMemory>,
    /// Places that signals and outputs had.
    pub(super) places: Places,
    /// Outputs that have another name at the same place, each with the new one. What is remembered has the new ones.
    pub(super) renamed: BTreeMap<String, String>,
    /// Signals that have another place now, if something was captured from them. It is forgotten.
    pub(super) moved: BTreeMap<String, Moved>,
    /// Last good values of signals with a `max_rate`, with their age at the start. None if that is not known.
    pub(super) values: BTreeMap<String, LastGood>,
}

impl Memory {
    pub(super) fn new(
        profile: &Profile,
        at: Moment,
        remembered: Remembered,
        verified_um: BTreeMap<String, f64>,
        rest: Rest,
    ) -> Memory {
        let signals = profile.signals.iter().map(|signal| signal.name.clone()).collect();
        Memory { at, signals, remembered, verified_um, rest }
    }

    /// The same as the computer's clock has it.
    pub(super) fn stamped(self, shift: Shift) -> Memory {
        let remembered = self.remembered.counted_until(self.at).shifted(shift);
        Memory { at: self.at.shifted(shift), remembered, ..self }
    }

    /// What is saved of it.
    pub(super) fn saved(self) -> serde_json::Result<SavedState> {
        let mut machine = serde_json::to_value(&self.remembered)?;
        by_name(&mut machine, &self.signals);
        let Rest { signs, places, values } = self.rest;
        let places = Arc::unwrap_or_clone(places);
        Ok(SavedState { at: self.at, machine, verified_um: self.verified_um, signs, places, values })
    }

    /// Reads what was saved, for the signals of this profile.
    ///
    /// # Errors
    /// A clause: it says nothing about a machine.
    pub(super) fn recall(state: Option<Value>, profile: &Profile) -> Result<Recalled, String> {
        let Some(state) = state else { return Ok(Recalled::default()) };
        let read = serde_json::from_value(state).and_then(|mut state: SavedState| {
            let signals: Vec<&str> = profile.signals.iter().map(|signal| signal.name.as_str()).collect();
            by_place(&mut state.machine, &signals);
            let mut remembered: Remembered = serde_json::from_value(state.machine)?;
            let SavedState { at, verified_um, signs, places, mut values, .. } = state;
            let now = Places::of(profile);
            let places = places.named_as(&now);
            let mut moved = places.moved_signals(&now);
            let names = places.new_names(&now);
            let (places, verified_um) = (places.renamed(&names), renamed(verified_um, &names));
            let axes: Vec<AxisSettings> = profile.axes.iter().map(|axis| axis.settings.clone()).collect();
            values.retain(|name, _| !moved.contains_key(name));
            values = renamed(values, &places.new_names_of_signals(&now));
            moved.retain(|name, _| {
                let place = signals.iter().position(|signal| *signal == name.as_str());
                place.is_some_and(|place| remembered.forget(SignalId(place), &axes))
            });
            Ok(Recalled {
                remembered,
                at: Some(at),
                verified_um,
                signs,
                places,
                renamed: names,
                moved,
                values,
            })
        });
        read.map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests;
