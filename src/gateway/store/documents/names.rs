//! Conversion between indices and names of signals and axes in the saved state. The compensation identifies signals
//! and axes by their indices in the profile. The state document contains their names, so that a profile may change
//! between two runs.

use std::collections::HashMap;

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use serde_json::{Map, Value};

use isotherm_core::compensation::Remembered;
use isotherm_core::compensation::reference::Capture;

/// Keys of the lists in the saved state that have one item for each signal.
const BY_SIGNAL: [&str; 2] = ["start", "zero"];

/// JSON pointers to the terms of learned models in the state of an axis.
const LEARNED_TERMS: [&str; 3] = [
    "/preference/preferred/learned/terms",
    "/preference/before/learned/terms",
    "/preference/waiting/to/learned/terms",
];

/// Form of the saved compensation state with the names of signals and axes in place of their indices. Long lists (one
/// item for each signal) are written without a copy, because a machine may have thousands of signals.
#[derive(Debug)]
pub(in crate::gateway) struct NamedMachine<'n> {
    rest: Value,
    /// Captured references of all signals: one list for each key in [`BY_SIGNAL`].
    references: [Vec<Capture>; 2],
    signals: Vec<&'n str>,
}

/// Pairs of names and values for JSON: the names of the signals, and a list with one value for each signal.
struct ByName<'n, T>(&'n [&'n str], &'n [T]);

impl<'n> NamedMachine<'n> {
    /// Converts a state to the form with names. `signals` contains the names in the order of the indices.
    pub(in crate::gateway) fn of(
        mut remembered: Remembered,
        signals: Vec<&'n str>,
    ) -> serde_json::Result<NamedMachine<'n>> {
        let references = remembered.machine.take_references();
        let mut rest = serde_json::to_value(&remembered)?;
        by_name(&mut rest, &signals);
        Ok(NamedMachine { rest, references, signals })
    }
}

impl Serialize for NamedMachine<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_map(None)?;
        let rest = self.rest.as_object().into_iter().flatten();
        for (key, value) in rest.filter(|(key, _)| !BY_SIGNAL.contains(&key.as_str())) {
            fields.serialize_entry(key, value)?;
        }
        for (key, references) in BY_SIGNAL.iter().zip(&self.references) {
            fields.serialize_entry(key, &ByName(&self.signals, references))?;
        }
        fields.end()
    }
}

impl<T: Serialize> Serialize for ByName<'_, T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().zip(self.1))
    }
}

/// Replaces the indices of signals by signal names. Replaces the list of axes by a map whose keys are the axis names.
pub(in crate::gateway) fn by_name(machine: &mut Value, signals: &[impl AsRef<str>]) {
    for key in BY_SIGNAL {
        let values = machine[key].as_array_mut().map(std::mem::take).unwrap_or_default();
        let names = signals.iter().map(|name| name.as_ref().to_owned());
        machine[key] = names.zip(values).collect::<Map<_, _>>().into();
    }
    let axes = machine["axes"].as_array_mut().map(std::mem::take).unwrap_or_default();
    let name =
        |place: &Value| signals.get(usize::try_from(place.as_u64()?).ok()?).map(|name| name.as_ref().into());
    let named = axes.into_iter().filter_map(|mut axis| {
        replace_signals(&mut axis, name);
        let Value::String(name) = axis.as_object_mut()?.remove("axis")? else { return None };
        Some((name, axis))
    });
    machine["axes"] = named.collect::<Map<_, _>>().into();
}

/// Replaces the names of signals by their present indices. Removes the data of signals that no longer exist.
pub(in crate::gateway) fn by_place(machine: &mut Value, signals: &[&str]) {
    // A new signal has captured nothing.
    let nothing = serde_json::json!({ "value": null, "gathering": null });
    for key in BY_SIGNAL {
        let values = machine[key].take();
        let value = |name: &&str| values.get(*name).unwrap_or(&nothing).clone();
        machine[key] = signals.iter().map(value).collect();
    }
    let places: HashMap<&str, usize> = signals.iter().copied().zip(0..).collect();
    let place = |name: &Value| places.get(name.as_str()?).copied().map(Value::from);
    let mut axes = machine["axes"].as_object_mut().map(std::mem::take).unwrap_or_default();
    for (name, axis) in &mut axes {
        replace_signals(axis, place);
        axis["axis"] = name.as_str().into();
    }
    machine["axes"] = axes.into_iter().map(|(_, axis)| axis).collect();
}

/// Replaces each signal in the state of an axis by the result of `by`: in its lags, in models with stand-ins, and in
/// learned models. Removes a lag or a stand-in if `by` returns `None`.
fn replace_signals(axis: &mut Value, by: impl Fn(&Value) -> Option<Value>) {
    let replace = |signal: &mut Value| by(signal).map(|other| *signal = other).is_some();
    if let Some(lags) = axis["lags"].as_array_mut() {
        lags.retain_mut(|lag| replace(&mut lag["signal"]));
    }
    if let Some(watches) = axis.get_mut("watches").and_then(Value::as_array_mut) {
        watches.retain_mut(|watch| {
            let terms = watch["terms"].as_array_mut().into_iter().flatten();
            terms.into_iter().all(|term| replace(&mut term[0]))
        });
    }
    // A learned model without one of its inputs cannot be used, and must be reported.
    let unknown = || Value::from(u32::MAX);
    for terms in LEARNED_TERMS {
        let terms = axis.pointer_mut(terms).and_then(Value::as_array_mut).into_iter().flatten();
        terms.for_each(|term| term["signal"] = by(&term["signal"]).unwrap_or_else(unknown));
    }
}
