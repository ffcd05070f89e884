//! Default limits of temperatures. They depend on whether a model uses the signal.

use std::collections::HashSet;

use super::check::{Check, Tables};
use isotherm_core::compensation::model::{Model, StandIns};
use isotherm_core::reading::SignalId;

/// Sets the default limits of all signals. The axes must be resolved before this call, because their models
/// decide which signals are used.
pub(super) fn set_default_limits(check: &mut Check<'_>) {
    let models = check.axes.valid().flat_map(|axis| &axis.settings.models);
    let used: HashSet<SignalId> = models.flat_map(signals_of).collect();
    let written = &check.raw.signal;
    let Tables { names, resolved } = &mut check.signals;
    for (place, (name, signal)) in names.iter().zip(resolved).enumerate() {
        if let (Some(raw), Some(signal)) = (written.get(name), signal) {
            signal.defaults = raw.defaults(signal, used.contains(&SignalId(place)));
        }
    }
}

/// Returns the signals of a model. They include the signals of its envelope and of its stand-ins (sensors that replace
/// others).
fn signals_of(model: &Model) -> Vec<SignalId> {
    let envelope = model.envelope.iter().flat_map(|envelope| envelope.inputs());
    let predictors = |stand_ins: &StandIns| -> Vec<SignalId> {
        stand_ins.watched().flat_map(|(signal, _)| stand_ins.predictors(signal)).collect()
    };
    let stand_ins = model.stand_ins.iter().flat_map(predictors);
    model.signals().into_iter().chain(envelope.map(|known| known.input.signal)).chain(stand_ins).collect()
}
