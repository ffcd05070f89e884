//! State of a machine that is saved for the next start. It contains the time since machine start, references, lags,
//! datums (zero points of Cz), results of probing, last verified Cz, and last good values.
//!
//! The [store](super::documents) saves the state. If the saved state is rejected, the gateway starts without a saved
//! state, and an operator must arm the axes.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::default_limits::{self, KnownLimits};
use super::documents::{NamedMachine, by_place};
use super::places::{Places, renamed};
use crate::gateway::state::sign::SignMemory;
use crate::gateway::state::signal_table::LastGood;
use isotherm_core::compensation::Remembered;
use isotherm_core::compensation::settings::AxisSettings;
use isotherm_core::place::MovedPlace;
use isotherm_core::quantity::{Moment, Shift, Shifted};
use isotherm_core::reading::SignalId;
use isotherm_profile::Profile;

/// State of a machine at one time, which is saved for the next start.
#[derive(Debug)]
pub(in crate::gateway) struct Memory {
    at: Moment,
    /// Profile with the names of the signals, in the order of their indices in `remembered`.
    profile: Arc<Profile>,
    remembered: Remembered,
    verified_um: BTreeMap<String, f64>,
    rest: UnchangedParts,
}

/// Parts of the state that are saved without conversion.
#[derive(Debug)]
pub(super) struct UnchangedParts {
    /// Results of the sign checks, by axis.
    pub(in crate::gateway) signs: BTreeMap<String, SignMemory>,
    pub(in crate::gateway) places: Arc<Places>,
    /// Last good values of signals with a limit of the rate of change.
    pub(in crate::gateway) values: BTreeMap<String, LastGood>,
}

/// State in the form that is written to the document. The structure has the same fields as [`SavedState`], but
/// borrows their values.
#[derive(Debug, Serialize)]
pub(super) struct StateToSave<'m> {
    at: Moment,
    machine: NamedMachine<'m>,
    verified_um: &'m BTreeMap<String, f64>,
    #[serde(skip_serializing_if = "is_empty")]
    signs: &'m BTreeMap<String, SignMemory>,
    places: &'m Places,
    #[serde(skip_serializing_if = "is_empty")]
    values: &'m BTreeMap<String, LastGood>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    limits: KnownLimits,
}

fn is_empty<K, V>(map: &&BTreeMap<K, V>) -> bool {
    map.is_empty()
}

/// State in the form that is read from the state document.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedState {
    at: Moment,
    /// State of the compensation, in which signals are identified by their names.
    machine: Value,
    /// Last Cz of each output, µm: the last verified Cz, or for a corrected position the Cz in the last written
    /// position. Only outputs that write Cz are contained.
    verified_um: BTreeMap<String, f64>,
    /// Results of the sign checks, by axis.
    #[serde(default)]
    signs: BTreeMap<String, SignMemory>,
    /// Addresses of signals and registers of outputs. Empty in a document of layout 5.
    #[serde(default)]
    places: Places,
    /// Last good values of signals with a limit of the rate of change.
    #[serde(default)]
    values: BTreeMap<String, LastGood>,
    /// Default limits of signals that have already been reported. Empty if the version that saved the state had no
    /// default limits.
    #[serde(default)]
    limits: KnownLimits,
}

/// Saved state that a run reads at its start.
#[derive(Debug, Default)]
pub(in crate::gateway) struct RestoredMemory {
    /// State of the compensation. Its times are time stamps of the previous run.
    pub(in crate::gateway) remembered: Remembered,
    /// Time at which the state was saved.
    pub(in crate::gateway) at: Option<Moment>,
    /// Last Cz of each output, µm: the last verified Cz, or for a corrected position the Cz in the last written
    /// position. Only outputs that write Cz are contained.
    pub(in crate::gateway) verified_um: BTreeMap<String, f64>,
    /// Results of the sign checks, by axis.
    pub(in crate::gateway) signs: BTreeMap<String, SignMemory>,
    /// Addresses of signals and registers of outputs in the previous run.
    pub(in crate::gateway) places: Places,
    /// Outputs that were renamed but have the same register as before: old name and new name. The other fields
    /// contain the new names.
    pub(in crate::gateway) renamed: BTreeMap<String, String>,
    /// Signals whose address has changed since their reference was captured. The references of these signals are
    /// discarded.
    pub(in crate::gateway) moved: BTreeMap<String, MovedPlace>,
    /// Last good values of signals with a limit of the rate of change, with their age at the start. Empty if the duration
    /// of the stop is not known.
    pub(in crate::gateway) values: BTreeMap<String, LastGood>,
    /// Default limits of signals that the previous run has reported.
    pub(in crate::gateway) limits: KnownLimits,
}

impl Memory {
    pub(super) fn new(
        profile: Arc<Profile>,
        at: Moment,
        remembered: Remembered,
        verified_um: BTreeMap<String, f64>,
        rest: UnchangedParts,
    ) -> Memory {
        Memory { at, profile, remembered, verified_um, rest }
    }

    /// Converts all monotonic times to time stamps of the computer's clock.
    pub(in crate::gateway) fn stamped(self, shift: Shift) -> Memory {
        let remembered = self.remembered.counted_until(self.at).shifted(shift);
        Memory { at: self.at.shifted(shift), remembered, ..self }
    }

    /// Converts the state to the form in which it is written to the document.
    pub(super) fn saved(&mut self) -> serde_json::Result<StateToSave<'_>> {
        let remembered = std::mem::take(&mut self.remembered);
        let signals = self.profile.signals.iter().map(|signal| signal.name.as_str()).collect();
        let UnchangedParts { signs, places, values } = &self.rest;
        Ok(StateToSave {
            at: self.at,
            machine: NamedMachine::of(remembered, signals)?,
            verified_um: &self.verified_um,
            signs,
            places,
            values,
            limits: default_limits::of(&self.profile),
        })
    }

    /// Parses a saved state, for the signals of this profile. If `state` is `None`, returns an empty state.
    ///
    /// # Errors
    /// The content is not the state of a machine. The error is a part of a sentence.
    pub(in crate::gateway) fn recall(
        state: Option<Value>,
        profile: &Profile,
    ) -> Result<RestoredMemory, String> {
        let Some(state) = state else { return Ok(RestoredMemory::default()) };
        let read = serde_json::from_value(state).and_then(|mut state: SavedState| {
            let signals: Vec<&str> = profile.signals.iter().map(|signal| signal.name.as_str()).collect();
            by_place(&mut state.machine, &signals);
            let mut remembered: Remembered = serde_json::from_value(state.machine)?;
            let SavedState { at, verified_um, signs, places, mut values, mut limits, .. } = state;
            let now = Places::of(profile);
            let (places, names) = places.under_names_of(&now);
            let mut moved = places.moved_signals(&now);
            let verified_um = renamed(verified_um, &names);
            let axes: Vec<AxisSettings> = profile.axes.iter().map(|axis| axis.settings.clone()).collect();
            values.retain(|name, _| !moved.contains_key(name));
            let new_names = places.new_names_of_signals(&now);
            (values, limits) = (renamed(values, &new_names), renamed(limits, &new_names));
            let ids = profile.signals.iter().zip(0..).filter(|(signal, _)| moved.contains_key(&signal.name));
            let ids: BTreeSet<SignalId> = ids.map(|(_, place)| SignalId(place)).collect();
            let forgotten = remembered.forget(&ids, &axes).into_iter();
            let forgotten: BTreeSet<&String> = forgotten.map(|id| &profile.signal(id).name).collect();
            moved.retain(|name, _| forgotten.contains(name));
            Ok(RestoredMemory {
                remembered,
                at: Some(at),
                verified_um,
                signs,
                places,
                renamed: names,
                moved,
                values,
                limits,
            })
        });
        read.map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests;
