//! Formats models for the preview: their temperature rises, and the effect on Cz if a signal changes by one unit.

use std::time::Duration;

use crate::document;
use crate::duration::shown;
use crate::tables::signal::Signal;
use isotherm_core::compensation::model::{Input, Reference};
use isotherm_core::quantity::Celsius;
use isotherm_core::reading::SignalId;

/// Describes the change of Cz if a signal rises by one unit. `place` is appended to the condition of the sentence, for
/// example ` at y = 200 mm`.
pub(super) fn effect(signals: &[Signal], id: SignalId, change: f64, place: &str) -> String {
    let signal = &signals[id.0];
    let unit = signal.unit.to_string();
    let space = if unit.is_empty() { "" } else { " " };
    let sign = if change < 0.0 { "−" } else { "+" };
    let (name, change) = (&signal.name, figure(change.abs()));
    format!("when {name} rises by 1{space}{unit}{place}, Cz changes by {sign}{change} µm")
}

/// Describes the change of Cz if an input rises by one unit. For a squared input, describes the change over the whole
/// range of the signal.
pub(super) fn effect_of(signals: &[Signal], input: &Input, change: f64, place: &str) -> String {
    if !input.squared {
        return effect(signals, input.signal, change, place);
    }
    let signal = &signals[input.signal.0];
    let top = signal.range.map_or(1000.0, |(low, high)| high.max(-low));
    let (name, unit, sign) = (&signal.name, signal.unit, if change < 0.0 { "−" } else { "+" });
    let (change, top) = (figure((change * top * top).abs()), figure(top));
    format!("when {name} goes from 0 to {top} {unit}{place}, its square changes Cz by {sign}{change} µm")
}

/// Appends the lag of an input to the condition `place` of a sentence. Without a lag, returns `place` unchanged.
pub(super) fn late(signals: &[Signal], input: &Input, place: &str) -> String {
    let signal = &signals[input.signal.0].name;
    let behind = |lag: Duration| {
        format!("{place} (63 % of the effect is reached {} after {signal} has risen)", shown(lag))
    };
    input.time_constant().map_or_else(|| place.to_owned(), behind)
}

/// Returns the signal value at which the effect of the signal is calculated. This is the middle of the signal's range,
/// or 20 without a range.
pub(super) fn middle(signals: &[Signal], id: SignalId) -> f64 {
    signals[id.0].range.map_or(20.0, |(low, high)| f64::midpoint(low, high))
}

/// Describes the reference from which a rise is measured: a number, or words such as `its value at machine start`.
pub(super) fn reference(reference: Reference) -> String {
    match reference {
        Reference::Fixed(number) => figure(number.get()),
        Reference::Start => "its value at machine start".to_owned(),
        Reference::Zero => "its value at the last capture of \"zero\"".to_owned(),
    }
}

/// Formats the rises of several inputs above their references, each with its lag.
pub(super) fn rises(signals: &[Signal], inputs: &[Input]) -> String {
    inputs.iter().map(|input| rise(signals, input)).collect::<Vec<_>>().join(", ")
}

/// Formats the rise of an input above its reference, with its lag: `(bed − 20)`, or `bed` if the reference is 0.
pub(super) fn rise(signals: &[Signal], input: &Input) -> String {
    let name = &signals[input.signal.0].name;
    let rise = match input.reference {
        Reference::Fixed(Celsius::ZERO) => name.clone(),
        other => format!("({name} − {})", reference(other)),
    };
    format!("{rise}{}", lagged(input))
}

/// Formats the lag of an input: ` lagged by 30m`.
pub(super) fn lagged(input: &Input) -> String {
    input.time_constant().map_or_else(String::new, |lag| format!(" lagged by {}", shown(lag)))
}

/// Formats a number of a model with at most three decimals. A number below 1 has four significant digits. More digits
/// are not useful: a thousandth is a nanometre of Cz, or a micrometre of a position.
pub(super) fn figure(number: f64) -> String {
    if number.abs() >= 1.0 {
        return document::figure(number, 3);
    }
    let rounded = format!("{number:.3e}").parse().unwrap_or(number);
    document::figure(rounded, 12)
}

/// Formats µm with a sign and at most three decimals.
pub(in crate::tables::axis) fn signed(cz: f64) -> String {
    let rounded = (cz * 1000.0).round() / 1000.0;
    let sign = if rounded < 0.0 { "−" } else { "+" };
    if rounded.abs() > 0.0 { format!("{sign}{}", figure(rounded.abs())) } else { "0".to_owned() }
}
