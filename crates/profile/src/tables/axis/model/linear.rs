//! `kind = "linear"`: a sum of gains times temperature rises. A slope is multiplied by the position.

use super::effect::{effect_of, figure, lagged, late, reference as written, signed};
use super::inputs::lag;
use super::kind::{Computation, KindOfModel, Places};
use super::raw::{LINEAR, RawModel, RawSlope, RawTerm};
use crate::document::grouped;
use crate::tables::signal::Signal;
use crate::tables::{KeyContext, optional};
use isotherm_core::compensation::model::{Input, Kind, Linear, Reference, Slope, Term};
use isotherm_core::quantity::{Micron, MicronPerCelsius, MicronPerMillimetreCelsius, Millimetre};

/// Number of µm in one mm, for the thermal expansion of a length in mm.
const MICRONS: f64 = 1000.0;

pub(super) const KIND: KindOfModel = KindOfModel {
    word: LINEAR,
    one: "a linear model",
    keys: &["offset", "terms", "slope"],
    resolve,
    preview,
    places,
};

/// Largest number of terms that the preview lists.
const READABLE: usize = 12;
/// Largest plausible gain of a term, µm/°C.
const LARGE_GAIN: f64 = 100.0;
/// Largest plausible gain of a slope, µm/mm per °C: ten times the expansion of aluminium.
const LARGE_SLOPE: f64 = 0.24;

fn resolve(raw: &RawModel, at: &KeyContext<'_>) -> Option<Kind> {
    let list = at.key("terms");
    let help = "write terms = [ { signal = \"…\", gain = …, reference = … } ]";
    list.missing("`terms` is missing: a linear model adds up terms", help);
    let own = raw.terms.as_ref()?;
    if own.is_empty() && raw.slope.is_none() {
        list.invalid("a model without terms follows no temperature", "write at least one term");
    }
    let terms = terms(&list, own, (RawTerm::gain, LARGE_GAIN, "µm/°C"), MicronPerCelsius::new);
    let slope = optional(raw.slope.as_ref(), |slope| slope.resolve(&at.key("slope")))?;
    let offset = Micron::new(raw.offset.unwrap_or(0.0))?;
    Some(Kind::Linear(Linear { offset, terms: terms?, slope }))
}

/// Resolves all terms. A term with an error does not prevent the check of the next terms.
fn terms<Gain>(
    list: &KeyContext<'_>,
    terms: &[RawTerm],
    (gain, large, per): (impl Fn(&RawTerm, &KeyContext<'_>) -> Option<f64>, f64, &str),
    unit: impl Fn(f64) -> Option<Gain>,
) -> Option<Vec<Term<Gain>>> {
    let one = |(index, raw): (usize, &RawTerm)| {
        let at = list.item(index);
        let signal = at.key("signal").signal(raw.signal.as_ref());
        let gain = gain(raw, &at);
        let squared = raw.is_squared(&at);
        if let Some(gain) = gain.filter(|gain| gain.abs() > large && at.is_temperature(signal)) {
            raw.doubt(&at, gain, per);
        }
        // A missing reference has been reported, like every missing key.
        let lag = lag(&at, raw.lag, true);
        let reference = raw.reference.map(Reference::from);
        let input = Input { squared: squared?, ..Input::of(signal?, reference?, lag?) };
        Some(Term { input, gain: unit(gain?)? })
    };
    let terms: Vec<Option<Term<Gain>>> = terms.iter().enumerate().map(one).collect();
    terms.into_iter().collect()
}

impl RawSlope {
    fn resolve(&self, at: &KeyContext<'_>) -> Option<Slope> {
        let position = at.key("position").position(self.position.as_ref());
        let list = at.key("terms");
        if self.terms.as_ref().is_some_and(Vec::is_empty) {
            let help = "write at least one term, or remove `slope`";
            list.invalid("a slope without terms follows no temperature", help);
        }
        let terms = (self.terms.as_ref()).and_then(|own| {
            let gain = (RawTerm::gain_of_slope, LARGE_SLOPE, "µm/mm per °C");
            terms(&list, own, gain, MicronPerMillimetreCelsius::new)
        });
        if let Some([from, to]) = self.travel.filter(|[from, to]| from >= to) {
            let message = format!("the travel from {from} to {to} mm does not have a positive length");
            at.key("travel").invalid(message, "write the smaller end first, as [-300.0, 0.0]");
        }
        let travel = self.travel.and_then(|[from, to]| Millimetre::new(from).zip(Millimetre::new(to)));
        let reference = Millimetre::new(self.reference?)?;
        Some(Slope { position: position?, reference, travel, terms: terms? })
    }
}

impl RawTerm {
    fn is_squared(&self, at: &KeyContext<'_>) -> Option<bool> {
        match self.power {
            None | Some(1) => Some(false),
            Some(2) => Some(true),
            Some(other) => {
                let help = "write power = 2 for the square of the value, or remove `power`";
                at.key("power").reject(format!("a term cannot have the power {other}"), help)
            }
        }
    }

    fn doubt(&self, at: &KeyContext<'_>, gain: f64, per: &str) {
        let key = if self.gain.is_some() { "gain" } else { "expansion" };
        let message = format!("a gain of {} {per} is implausible for a machine", signed(gain));
        at.key(key).warn(
            message,
            "`gain` is in µm per unit of the signal; for steel, write expansion = 11.5e-6 and `length` in mm",
        );
    }

    /// Returns the gain of a slope, µm/mm per unit of the signal.
    fn gain_of_slope(&self, at: &KeyContext<'_>) -> Option<f64> {
        if self.expansion.is_some() || self.length.is_some() {
            let key = if self.expansion.is_some() { "expansion" } else { "length" };
            let help = "write `gain` in µm/mm per unit of the signal";
            at.key(key).wrong_key("`expansion` and `length` are not allowed in a slope", help);
            return None;
        }
        self.gain(at)
    }

    /// Returns the gain, µm per unit of the signal.
    fn gain(&self, at: &KeyContext<'_>) -> Option<f64> {
        match (self.gain, self.expansion, self.length) {
            (Some(gain), None, None) => return Some(gain),
            (None, Some(expansion), Some(length)) => return Some(expansion * length * MICRONS),
            (Some(_), ..) => {
                let help = "keep `gain` (µm per unit), or `expansion` (1/K) and `length` (mm)";
                at.key("gain").wrong_key("the gain is given twice", help);
            }
            (None, Some(_), None) => {
                let help = "write `length` in mm: `expansion` needs it";
                at.key("length").missing("`length` is missing", help);
            }
            (None, None, Some(_)) => {
                let help = "write `expansion` in 1/K: `length` needs it";
                at.key("expansion").missing("`expansion` is missing", help);
            }
            (None, None, None) => {
                if at.key("expansion").is_left_out() && at.key("length").is_left_out() {
                    let help =
                        "write `gain` (µm per unit of the signal), or `expansion` (1/K) and `length` (mm)";
                    at.key("gain").missing("`gain` is missing", help);
                }
            }
        }
        None
    }
}

fn preview(signals: &[Signal], kind: &Kind) -> Option<Computation> {
    let Kind::Linear(linear) = kind else { return None };
    Some(Computation { formula: text(signals, linear), effects: effects(signals, linear) })
}

/// Returns the reference position of a slope (position at which it has no effect), and the ends of its travel, in mm.
/// `None` if the model has no slope.
fn places(kind: &Kind) -> Option<Places> {
    let Kind::Linear(Linear { slope: Some(slope), .. }) = kind else { return None };
    let travel = slope.travel.iter().flat_map(|(from, to)| [from.get(), to.get()]);
    Some((slope.position, [slope.reference.get()].into_iter().chain(travel).collect()))
}

/// Formats the sum as a formula, for example `Cz = 2.4·(bed − 20) + 0 µm`.
fn text(signals: &[Signal], linear: &Linear) -> String {
    let mut text = match linear.terms.len() {
        many if many > READABLE => format!("Cz = the sum of {many} terms"),
        _ => format!("Cz = {}", sum_text(signals, &parts(&linear.terms))),
    };
    let sign = if linear.offset < Micron::ZERO { "−" } else { "+" };
    let zero = if linear.terms.is_empty() { "" } else { " " };
    text.push_str(&format!("{zero}{sign} {} µm", figure(linear.offset.get().abs())));
    if let Some(slope) = &linear.slope {
        let position = &signals[slope.position.0].name;
        text.push_str(&format!(
            " + ({}) µm/mm·({position} − {} mm)",
            sum_text(signals, &parts(&slope.terms)),
            figure(slope.reference.get())
        ));
    }
    text
}

fn sum_text(signals: &[Signal], parts: &[(Input, f64)]) -> String {
    let mut text = String::new();
    for (place, (input, gain)) in parts.iter().enumerate() {
        let sign = match (place, *gain < 0.0) {
            (0, false) => "",
            (0, true) => "−",
            (_, false) => " + ",
            (_, true) => " − ",
        };
        let name = &signals[input.signal.0].name;
        let rise = match (input.squared, input.reference) {
            (false, reference) => format!("({name} − {})", written(reference)),
            (true, Reference::Fixed(number)) => format!("({name}² − {})", figure(number.get().powi(2))),
            (true, captured) => format!("({name}² − the square of {})", written(captured)),
        };
        text.push_str(&format!("{sign}{}·{rise}", figure(gain.abs())));
        text.push_str(&lagged(input));
    }
    text
}

fn effects(signals: &[Signal], linear: &Linear) -> Vec<String> {
    let is_readable = linear.terms.len() <= READABLE;
    let each = gains(&linear.terms).into_iter().filter(|_| is_readable);
    let mut effects: Vec<String> =
        each.map(|(input, gain)| effect_of(signals, &input, gain, &late(signals, &input, ""))).collect();
    match is_readable {
        true => effects.extend(together(signals, &linear.terms, 1.0, "")),
        false => effects.extend(at_once_and_at_rest(signals, &linear.terms)),
    }
    if let Some(slope) = &linear.slope {
        let position = &signals[slope.position.0].name;
        let beside = format!(" and {position} is 100 mm above {} mm", figure(slope.reference.get()));
        for (input, gain) in gains(&slope.terms) {
            let place = late(signals, &input, &beside);
            effects.push(effect_of(signals, &input, gain * 100.0, &place));
        }
        effects.extend(together(signals, &slope.terms, 100.0, &beside));
    }
    effects
}

/// Describes each signal of a sum that has many terms: its effect on Cz at once, and in the steady state.
fn at_once_and_at_rest(signals: &[Signal], terms: &[Term]) -> Vec<String> {
    let own = gains(terms).into_iter().map(|(input, gain)| ((input.signal, input.squared), (input, gain)));
    let sum = |own: Vec<(Input, f64)>| {
        let at_once: f64 = own.iter().filter(|(input, _)| input.lag.is_none()).map(|(_, gain)| gain).sum();
        let at_rest: f64 = own.iter().map(|(_, gain)| gain).sum();
        let (input, signal) = (own[0].0, &signals[own[0].0.signal.0]);
        if input.squared || signal.unit.0 == "rpm" {
            return effect_of(signals, &input, at_rest, " permanently");
        }
        let [at_once, at_rest] = [at_once, at_rest].map(signed);
        let (name, unit) = (&signal.name, signal.unit);
        format!("{name}: {at_once} µm/{unit} at once, {at_rest} µm/{unit} in the steady state")
    };
    grouped(own).into_iter().map(|(_, own)| sum(own)).collect()
}

/// Describes the steady-state effect of each signal that has several terms with different lags. The terms must be added
/// up, because a single term may have the opposite sign.
fn together<Gain: Copy + Into<f64>>(
    signals: &[Signal],
    terms: &[Term<Gain>],
    times: f64,
    beside: &str,
) -> Vec<String> {
    let all = gains(terms).into_iter();
    let own = all.map(|(input, gain)| ((input.signal, input.squared), (input, gain * times)));
    let sum = |own: Vec<(Input, f64)>| {
        let place = format!("{beside} permanently (its {} terms added up)", own.len());
        let all = own.iter().map(|(_, change)| change).sum();
        (own.len() > 1).then(|| effect_of(signals, &own[0].0, all, &place))
    };
    grouped(own).into_iter().filter_map(|(_, own)| sum(own)).collect()
}

/// Returns the input and the gain of each term.
fn parts<Gain: Copy + Into<f64>>(terms: &[Term<Gain>]) -> Vec<(Input, f64)> {
    terms.iter().map(|term| (term.input, term.gain.into())).collect()
}

/// Adds up the gains of terms with the same signal, power and lag. Returns each such input once, with its total gain.
fn gains<Gain: Copy + Into<f64>>(terms: &[Term<Gain>]) -> Vec<(Input, f64)> {
    let keyed =
        parts(terms).into_iter().map(|part| ((part.0.signal, part.0.squared, part.0.time_constant()), part));
    let sum = |parts: Vec<(Input, f64)>| (parts[0].0, parts.iter().map(|(_, gain)| gain).sum());
    grouped(keyed).into_iter().map(|(_, parts)| sum(parts)).collect()
}
