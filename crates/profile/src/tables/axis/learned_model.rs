//! Learned model of an axis: its position among the models of the axis, and its terms.

use std::time::Duration;

use super::Axis;
use super::learning::{LEARNED, Learning};
use crate::digest::sha256;
use crate::tables::Check;
use crate::tables::signal::Signal;
use isotherm_core::candidate::LAG_MINUTES;
use isotherm_core::compensation::model::{Input, Kind, Linear, Model, Reference, Term};
use isotherm_core::compensation::settings::LearnedSlot;
use isotherm_core::quantity::{Celsius, Micron, MicronPerCelsius};
use isotherm_core::reading::SignalId;

/// Adds the learned model to each axis with the key `learn`. The gains of this model are zero until the axis
/// has learned. Reports an error if an axis has no signal from which a model can be learned. The signals must
/// be resolved before this call.
pub(in crate::tables) fn add_slots(check: &mut Check<'_>) {
    let is_learning = |axis: &&Axis| axis.learning.is_some();
    if !check.axes.valid().any(|axis| is_learning(&axis)) {
        return;
    }
    for axis in check.axes.valid().filter(is_learning) {
        let of_axis = check.at("axis").key(&axis.settings.name);
        let at = of_axis.key("probe").key("learn");
        if let Some(place) = axis.settings.models.iter().position(|model| model.name == LEARNED) {
            let help = "write another name: the model that the gateway learns has this name";
            let name = of_axis.key("model").item(place).key("name");
            name.invalid(format!("the name `{LEARNED}` is in use"), help);
        }
        let has_slope = |model: &Model| matches!(&model.kind, Kind::Linear(Linear { slope: Some(_), .. }));
        if axis.settings.models.iter().any(has_slope) {
            let help = "remove `learn`, or the slope of the model";
            at.invalid("a model of this axis has a slope, but a learned model cannot have a slope", help);
        }
    }
    let signals: Vec<Option<Signal>> = check.signals.resolved.clone();
    let mut unable = Vec::new();
    for axis in check.axes.resolved.iter_mut().flatten() {
        let Some(learning) = &axis.learning else { continue };
        let own = &axis.settings.models;
        let reference = temperature_reference(own);
        let with_all = Learning { without: Vec::new(), ..learning.clone() };
        let terms = terms(&signals, learning, reference);
        if terms.is_empty() {
            let leaves_none = !self::terms(&signals, &with_all, reference).is_empty();
            unable.push((axis.settings.name.clone(), leaves_none));
        }
        terms.iter().for_each(|term| check.report.at("axis").uses(term.input.signal));
        let slot = LearnedSlot { model: own.len(), own: fingerprint(&signals, own) };
        let kind = Kind::Linear(Linear { offset: Micron::ZERO, terms, slope: None });
        let expected = own.first().and_then(|model| model.expected);
        axis.settings.models.push(Model { expected, ..Model::new(LEARNED.to_owned(), kind) });
        axis.settings.learned = Some(slot);
    }
    for (name, leaves_none) in unable {
        let of_axis = check.at("axis").key(&name);
        let probe = of_axis.key("probe");
        if leaves_none {
            let help = "remove a sensor from `learn_without`, so that the learned model has an input";
            let message = "`learn_without` names every sensor from which a model could be learned";
            probe.key("learn_without").invalid(message, help);
        } else {
            let help = "add a [signal.…] with unit = \"degC\" for each sensor";
            let message = "the profile has no temperature from which a model could be learned";
            probe.key("learn").invalid(message, help);
        }
    }
}

/// Returns the reference of the temperatures in a learned model. The reference is "zero" if a model in `own`, the
/// models of the profile, uses it. Otherwise it is the machine start.
fn temperature_reference(own: &[Model]) -> Reference {
    let is_zeroed = own.iter().flat_map(Model::references).any(|reference| reference == Reference::Zero);
    if is_zeroed { Reference::Zero } else { Reference::Start }
}

/// Returns the terms of a learned model, with gains of zero. Each temperature has one term for each number in
/// `LAG_MINUTES`; 0 means no lag. Each speed has two terms for each number above 0: one for its value, one for its
/// square.
fn terms(signals: &[Option<Signal>], learning: &Learning, reference: Reference) -> Vec<Term> {
    let lags = LAG_MINUTES.map(|minutes| (minutes > 0).then(|| Duration::from_secs(60 * minutes)));
    let mut terms = Vec::new();
    for (place, signal) in signals.iter().enumerate() {
        let id = SignalId(place);
        let Some(unit) = signal.as_ref().map(|signal| signal.unit.0) else { continue };
        if learning.without.contains(&id) {
            continue;
        }
        let mut add = |input: Input| terms.push(Term { input, gain: MicronPerCelsius::default() });
        match unit {
            "degC" | "K" => lags.iter().for_each(|lag| add(Input::of(id, reference, *lag))),
            "rpm" => lags.iter().filter(|lag| lag.is_some()).for_each(|lag| {
                let plain = Input::of(id, Reference::Fixed(Celsius::ZERO), *lag);
                add(plain);
                add(Input { squared: true, ..plain });
            }),
            _ => {}
        }
    }
    terms
}

/// Returns a hash that identifies the models of an axis. It does not depend on the order of the signals in the profile.
fn fingerprint(signals: &[Option<Signal>], own: &[Model]) -> String {
    let name = |signal: SignalId| {
        let signal = signals.get(signal.0).and_then(Option::as_ref);
        signal.map_or("", |signal| signal.name.as_str())
    };
    let mut text = String::new();
    for model in own {
        match &model.kind {
            Kind::Linear(Linear { offset, terms, slope: None }) => {
                text += &format!("{} {offset:?}\n", model.name);
                for Term { input, gain } in terms {
                    let Input { signal, reference, squared, .. } = input;
                    let lag = input.time_constant();
                    text += &format!("{} {reference:?} {lag:?} {squared} {gain:?}\n", name(*signal));
                }
            }
            kind => text += &format!("{} {kind:?}\n", model.name),
        }
    }
    sha256(text.as_bytes())
}
