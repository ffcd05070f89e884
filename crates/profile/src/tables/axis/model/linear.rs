//! `kind = "linear"`: gains times temperature rises, added up; a slope grows with the position.

use schemars::JsonSchema;
use serde::Deserialize;

use super::all_over::signed;
use super::effect::{effect, figure, lagged, late, reference};
use super::inputs::{ReferenceValue, lag};
use super::{Computation, KindOfModel, Places, RawModel};
use crate::Profile;
use crate::document::grouped;
use crate::duration::Timespan;
use crate::tables::At;
use isotherm_core::compensation::model::{Input, Kind, Linear, Reference, Slope, Term};
use isotherm_core::quantity::{Micron, MicronPerCelsius, MicronPerMillimetreCelsius, Millimetre};
use isotherm_core::reading::SignalId;

/// 1 mm in µm.
const MICRONS: f64 = 1000.0;

pub(super) const KIND: KindOfModel = KindOfModel {
    word: "linear",
    one: "a linear model",
    keys: &["offset", "terms", "slope"],
    resolve,
    preview,
    places,
};

/// A gain of a term that a machine can have, µm/°C.
const LARGE_GAIN: f64 = 100.0;
/// The same of a slope, µm/mm per °C: ten times what aluminium expands by is 0.24.
const LARGE_SLOPE: f64 = 0.24;

/// One gain times one temperature rise.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Term")]
pub(super) struct RawTerm {
    /// The temperature.
    #[schemars(required)]
    signal: Option<String>,
    /// µm per unit of the signal; in a slope µm/mm per unit. Either this, or `expansion` and `length` (not in a slope).
    gain: Option<f64>,
    /// What the rise is measured from. Write reference = 20.0 (a number in the signal's unit: where the structure had its
    /// cold geometry), "start" (its value at machine start), "zero" (its value at the last zero), or 0.0 (the value itself).
    #[schemars(required)]
    reference: Option<ReferenceValue>,
    /// Time constant C of a first-order lag, 1 − e^(−t/C).
    lag: Option<Timespan>,
    /// Coefficient of linear expansion, 1/K.
    expansion: Option<f64>,
    /// Length that expands, mm.
    length: Option<f64>,
}

/// Terms that grow with the position.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Slope")]
pub(super) struct RawSlope {
    /// The signal with the position of the axis, in mm.
    #[schemars(required)]
    position: Option<String>,
    /// Where the slope adds nothing, mm.
    #[schemars(required)]
    reference: Option<f64>,
    /// The ends of the axis's travel, mm; required where the control is given the slope: they bound its effect.
    travel: Option<[f64; 2]>,
    /// Gains in µm/mm per unit of the signal.
    #[schemars(required)]
    terms: Option<Vec<RawTerm>>,
}

fn resolve(raw: &RawModel, at: &At<'_>) -> Option<Kind> {
    let list = at.key("terms");
    let Some(own) = &raw.terms else {
        let help = "write terms = [ { signal = \"…\", gain = …, reference = … } ]";
        list.missing("`terms` is missing: a linear model adds up terms", help);
        return None;
    };
    if own.is_empty() && raw.slope.is_none() {
        list.wrong("a model without terms follows no temperature", "write at least one term");
    }
    let terms = terms(&list, own, (RawTerm::gain, LARGE_GAIN, "µm/°C"), MicronPerCelsius::new);
    let slope = raw.slope.as_ref().map(|slope| slope.resolve(&at.key("slope")));
    let slope = match slope {
        Some(slope) => Some(slope?),
        None => None,
    };
    let offset = Micron::new(raw.offset.unwrap_or(0.0))?;
    Some(Kind::Linear(Linear { offset, terms: terms?, slope }))
}

/// Each is looked at, also where one before it is wrong.
fn terms<Gain>(
    list: &At<'_>,
    terms: &[RawTerm],
    (gain, large, per): (impl Fn(&RawTerm, &At<'_>) -> Option<f64>, f64, &str),
    unit: impl Fn(f64) -> Option<Gain>,
) -> Option<Vec<Term<Gain>>> {
    let one = |(index, raw): (usize, &RawTerm)| {
        let at = list.item(index);
        let signal = at.key("signal").signal(raw.signal.as_ref());
        let gain = gain(raw, &at);
        if let Some(gain) = gain.filter(|gain| gain.abs() > large && at.is_temperature(signal)) {
            raw.doubt(&at, gain, per);
        }
        // A missing reference has been reported as every missing key is.
        let lag = lag(&at, raw.lag, true);
        let reference = raw.reference.map(Reference::from);
        Some(Term { input: Input { signal: signal?, reference: reference?, lag: lag? }, gain: unit(gain?)? })
    };
    let terms: Vec<Option<Term<Gain>>> = terms.iter().enumerate().map(one).collect();
    terms.into_iter().collect()
}

impl RawSlope {
    pub(super) fn terms(&self) -> impl Iterator<Item = &RawTerm> {
        self.terms.iter().flatten()
    }

    fn resolve(&self, at: &At<'_>) -> Option<Slope> {
        let position = at.key("position").position(self.position.as_ref());
        let list = at.key("terms");
        if self.terms.as_ref().is_some_and(Vec::is_empty) {
            let help = "write at least one term, or remove `slope`";
            list.wrong("a slope without terms follows no temperature", help);
        }
        let terms = (self.terms.as_ref()).and_then(|own| {
            let gain = (RawTerm::gain_of_slope, LARGE_SLOPE, "µm/mm per °C");
            terms(&list, own, gain, MicronPerMillimetreCelsius::new)
        });
        if let Some([from, to]) = self.travel.filter(|[from, to]| from >= to) {
            let message = format!("a travel from {from} to {to} mm has no length");
            at.key("travel").wrong(message, "write the smaller end first, as [-300.0, 0.0]");
        }
        let travel = self.travel.and_then(|[from, to]| Millimetre::new(from).zip(Millimetre::new(to)));
        let reference = Millimetre::new(self.reference?)?;
        Some(Slope { position: position?, reference, travel, terms: terms? })
    }
}

impl RawTerm {
    pub(super) fn is_at_zero(&self) -> bool {
        self.reference.is_some_and(ReferenceValue::is_zero)
    }

    fn doubt(&self, at: &At<'_>, gain: f64, per: &str) {
        let key = if self.gain.is_some() { "gain" } else { "expansion" };
        let message = format!("{} {per} is more than a machine moves by", signed(gain));
        at.key(key).warn(
            message,
            "`gain` is in µm per unit of the signal; steel: expansion = 11.5e-6, and `length` in mm",
        );
    }

    /// µm/mm per unit of the signal.
    fn gain_of_slope(&self, at: &At<'_>) -> Option<f64> {
        if self.expansion.is_some() || self.length.is_some() {
            let key = if self.expansion.is_some() { "expansion" } else { "length" };
            let help = "write `gain` in µm/mm per unit of the signal";
            at.key(key).wrong_key("a slope has no length that expands", help);
            return None;
        }
        self.gain(at)
    }

    /// µm per unit of the signal.
    fn gain(&self, at: &At<'_>) -> Option<f64> {
        match (self.gain, self.expansion, self.length) {
            (Some(gain), None, None) => return Some(gain),
            (None, Some(expansion), Some(length)) => return Some(expansion * length * MICRONS),
            (Some(_), ..) => {
                let help = "keep `gain` (µm per unit), or `expansion` (1/K) and `length` (mm)";
                at.key("gain").wrong_key("the gain is given twice", help);
            }
            (None, Some(_), None) => {
                let help = "`length` in mm goes with `expansion` in 1/K";
                at.key("length").missing("`length` is missing", help);
            }
            (None, None, Some(_)) => {
                let help = "`expansion` in 1/K goes with `length` in mm";
                at.key("expansion").missing("`expansion` is missing", help);
            }
            (None, None, None) => {
                if !at.key("expansion").is_written() && !at.key("length").is_written() {
                    let help =
                        "write `gain` (µm per unit of the signal), or `expansion` (1/K) and `length` (mm)";
                    at.key("gain").missing("`gain` is missing", help);
                }
            }
        }
        None
    }
}

fn preview(profile: &Profile, kind: &Kind) -> Option<Computation> {
    let Kind::Linear(linear) = kind else { return None };
    Some(Computation { formula: text(profile, linear), effects: effects(profile, linear) })
}

/// The ends of the travel of a slope, and where it adds nothing.
fn places(kind: &Kind) -> Option<Places> {
    let Kind::Linear(Linear { slope: Some(slope), .. }) = kind else { return None };
    let travel = slope.travel.iter().flat_map(|(from, to)| [from.get(), to.get()]);
    Some((slope.position, [slope.reference.get()].into_iter().chain(travel).collect()))
}

/// The sum as it is written on paper.
fn text(profile: &Profile, linear: &Linear) -> String {
    let mut text = format!("Cz = {}", sum_text(profile, &parts(&linear.terms)));
    let sign = if linear.offset < Micron::ZERO { "−" } else { "+" };
    let zero = if linear.terms.is_empty() { "" } else { " " };
    text.push_str(&format!("{zero}{sign} {} µm", figure(linear.offset.get().abs())));
    if let Some(slope) = &linear.slope {
        let position = &profile.signal(slope.position).name;
        text.push_str(&format!(
            " + ({}) µm/mm·({position} − {} mm)",
            sum_text(profile, &parts(&slope.terms)),
            figure(slope.reference.get())
        ));
    }
    text
}

fn sum_text(profile: &Profile, parts: &[(Input, f64)]) -> String {
    let mut text = String::new();
    for (place, (input, gain)) in parts.iter().enumerate() {
        let sign = match (place, *gain < 0.0) {
            (0, false) => "",
            (0, true) => "−",
            (_, false) => " + ",
            (_, true) => " − ",
        };
        let reference = reference(input.reference);
        let name = &profile.signal(input.signal).name;
        text.push_str(&format!("{sign}{}·({name} − {reference})", figure(gain.abs())));
        text.push_str(&lagged(input));
    }
    text
}

fn effects(profile: &Profile, linear: &Linear) -> Vec<String> {
    let mut effects = gains(&linear.terms)
        .into_iter()
        .map(|(input, gain)| effect(profile, input.signal, gain, &late(profile, &input, "")))
        .collect::<Vec<String>>();
    effects.extend(together(profile, &linear.terms, 1.0, ""));
    if let Some(slope) = &linear.slope {
        let position = &profile.signal(slope.position).name;
        let beside = format!(" and {position} stands 100 mm above {} mm", figure(slope.reference.get()));
        for (input, gain) in gains(&slope.terms) {
            let place = late(profile, &input, &beside);
            effects.push(effect(profile, input.signal, gain * 100.0, &place));
        }
        effects.extend(together(profile, &slope.terms, 100.0, &beside));
    }
    effects
}

/// The way a signal moves Cz in the end, where several lags share it: one of them alone may point the other way.
fn together<Gain: Copy + Into<f64>>(
    profile: &Profile,
    terms: &[Term<Gain>],
    times: f64,
    beside: &str,
) -> Vec<String> {
    let own = gains(terms).into_iter().map(|(input, gain)| (input.signal, gain * times));
    let sum = |(signal, own): (SignalId, Vec<f64>)| {
        let place = format!("{beside} for good (its {} terms added up)", own.len());
        (own.len() > 1).then(|| effect(profile, signal, own.iter().sum(), &place))
    };
    grouped(own).into_iter().filter_map(sum).collect()
}

/// Each input with its gain, in the unit of the sum.
fn parts<Gain: Copy + Into<f64>>(terms: &[Term<Gain>]) -> Vec<(Input, f64)> {
    terms.iter().map(|term| (term.input, term.gain.into())).collect()
}

/// The gains of each signal and each lag added up.
fn gains<Gain: Copy + Into<f64>>(terms: &[Term<Gain>]) -> Vec<(Input, f64)> {
    let keyed = parts(terms).into_iter().map(|part| ((part.0.signal, part.0.lag), part));
    let sum = |parts: Vec<(Input, f64)>| (parts[0].0, parts.iter().map(|(_, gain)| gain).sum());
    grouped(keyed).into_iter().map(|(_, parts)| sum(parts)).collect()
}
