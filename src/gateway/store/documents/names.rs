//! Names instead of indices. The compensation identifies a signal by its index in the profile, and lists its axes. The
//! document contains the names of both, so that a profile may change between two runs.

use serde_json::{Map, Value};

/// Lists with one item for each signal.
const BY_SIGNAL: [&str; 2] = ["start", "zero"];

/// Replaces indices by the names of the signals, and the list of axes by a map with their names.
pub(in crate::gateway) fn by_name(machine: &mut Value, signals: &[String]) {
    for key in BY_SIGNAL {
        let values = machine[key].as_array_mut().map(std::mem::take).unwrap_or_default();
        machine[key] = signals.iter().cloned().zip(values).collect::<Map<_, _>>().into();
    }
    let axes = machine["axes"].as_array_mut().map(std::mem::take).unwrap_or_default();
    let name =
        |place: &Value| signals.get(usize::try_from(place.as_u64()?).ok()?).map(|name| name.as_str().into());
    let named = axes.into_iter().filter_map(|mut axis| {
        replace_signals(&mut axis, name);
        let Value::String(name) = axis.as_object_mut()?.remove("axis")? else { return None };
        Some((name, axis))
    });
    machine["axes"] = named.collect::<Map<_, _>>().into();
}

/// Replaces names by the present indices of the signals. Data that depends on a removed signal is dropped.
pub(in crate::gateway) fn by_place(machine: &mut Value, signals: &[&str]) {
    // A new signal has captured nothing.
    let nothing = serde_json::json!({ "value": null, "gathering": null });
    for key in BY_SIGNAL {
        let values = machine[key].take();
        let value = |name: &&str| values.get(*name).unwrap_or(&nothing).clone();
        machine[key] = signals.iter().map(value).collect();
    }
    let place = |name: &Value| signals.iter().position(|signal| name == signal).map(Value::from);
    let mut axes = machine["axes"].as_object_mut().map(std::mem::take).unwrap_or_default();
    for (name, axis) in &mut axes {
        replace_signals(axis, place);
        axis["axis"] = name.as_str().into();
    }
    machine["axes"] = axes.into_iter().map(|(_, axis)| axis).collect();
}

/// Replaces each signal that an axis refers to: those of its lags, and those that a watched model reads.
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
}
