//! The models of an axis.

use std::collections::BTreeMap;
use std::time::Duration;

use super::{Check, Signals, Zero, get};
use crate::place::{child, element};
use crate::raw::{Inputs, ModelKind, RawModel, RawSlope, RawTerm, ReferenceValue, ReferenceWord, Span};
use isotherm_core::compensation::model::{Formula, Input, Kind, Linear, Model, Reference, Slope, Term};
use isotherm_core::quantity::{Celsius, Micron, MicronPerCelsius, MicronPerMillimetreCelsius, Millimetre};

/// 1 mm in µm.
const MICRONS: f64 = 1000.0;
/// Longest time constant that is believed: a longer one never shows its effect in a shift.
const LONGEST_LAG: Duration = Duration::from_secs(7 * 24 * 3600);

/// What the terms add up to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sum {
    Offset,
    Slope,
}

impl Check<'_> {
    pub(super) fn model(&mut self, path: &str, raw: &RawModel, signals: &Signals) -> Option<Model> {
        let kind = raw.kind?;
        self.foreign_keys_of_model(path, kind, raw);
        let kind = match kind {
            ModelKind::Linear => self.linear(path, raw, signals).map(Kind::Linear),
            ModelKind::Formula => self.formula_model(path, raw).map(Kind::Formula),
            ModelKind::Matrix => self.matrix(path, raw, signals).map(Kind::Matrix),
            ModelKind::Network => self.network(path, raw).map(Kind::Network),
        };
        let model = raw.name.clone().zip(kind).map(|(name, kind)| Model { name, kind, envelope: None });
        let envelope = self.envelope(path, raw, model.as_ref())?;
        Some(Model { envelope, ..model? })
    }

    fn foreign_keys_of_model(&mut self, path: &str, kind: ModelKind, raw: &RawModel) {
        let (linear, formula) = (kind == ModelKind::Linear, kind == ModelKind::Formula);
        let file = matches!(kind, ModelKind::Matrix | ModelKind::Network);
        let keys = [
            ("offset", raw.offset.is_some(), linear, "a linear model"),
            ("terms", raw.terms.is_some(), linear, "a linear model"),
            ("slope", raw.slope.is_some(), linear, "a linear model"),
            ("formula", raw.formula.is_some(), formula, "a formula"),
            ("constants", raw.constants.is_some(), formula, "a formula"),
            ("inputs", raw.inputs.is_some(), formula || file, "a formula, a matrix or a network"),
            ("file", raw.file.is_some(), file, "a matrix or a network"),
            ("reference", raw.reference.is_some(), file, "a matrix or a network"),
            ("position", raw.position.is_some(), kind == ModelKind::Matrix, "a matrix"),
            ("component", raw.component.is_some(), kind == ModelKind::Matrix, "a matrix"),
            ("carries", raw.carries.is_some(), kind == ModelKind::Matrix, "a matrix"),
        ];
        for (key, there, belongs, owner) in keys {
            if there && !belongs {
                self.wrong_key(
                    &child(path, key),
                    format!("`{key}` belongs to {owner}"),
                    "remove it, or change `kind`",
                );
            }
        }
    }

    fn linear(&mut self, path: &str, raw: &RawModel, signals: &Signals) -> Option<Linear> {
        let list = child(path, "terms");
        let Some(terms) = &raw.terms else {
            let help = "write terms = [ { signal = \"…\", gain = … } ]";
            self.missing(path, "terms", "`terms` is missing: a linear model adds up terms", help);
            return None;
        };
        if terms.is_empty() && raw.slope.is_none() {
            self.wrong(&list, "a model without terms follows no temperature", "write at least one term");
        }
        let terms = self.terms(&list, terms, Sum::Offset, MicronPerCelsius::new);
        let slope = raw.slope.as_ref().map(|slope| self.slope(&child(path, "slope"), slope, signals));
        let slope = match slope {
            Some(slope) => Some(slope?),
            None => None,
        };
        Some(Linear { offset: Micron::new(raw.offset.unwrap_or(0.0))?, terms: terms?, slope })
    }

    fn terms<Gain>(
        &mut self,
        list: &str,
        terms: &[RawTerm],
        sum: Sum,
        gain: impl Fn(f64) -> Option<Gain>,
    ) -> Option<Vec<Term<Gain>>> {
        let terms = terms.iter().enumerate().map(|(index, term)| {
            let (input, number) = self.term(&element(list, index), term, sum)?;
            Some(Term { input, gain: gain(number)? })
        });
        super::complete(terms.collect())
    }

    fn slope(&mut self, path: &str, raw: &RawSlope, signals: &Signals) -> Option<Slope> {
        let position = raw.position.as_ref().and_then(|name| {
            let at = child(path, "position");
            let position = self.signal(&at, name)?;
            self.in_millimetres(&at, name, get(signals, position.0));
            Some(position)
        });
        let list = child(path, "terms");
        if raw.terms.as_ref().is_some_and(Vec::is_empty) {
            let help = "write at least one term, or remove `slope`";
            self.wrong(&list, "a slope without terms follows no temperature", help);
        }
        let terms = raw
            .terms
            .as_ref()
            .and_then(|terms| self.terms(&list, terms, Sum::Slope, MicronPerMillimetreCelsius::new));
        if let Some([from, to]) = raw.travel
            && from >= to
        {
            let message = format!("a travel from {from} to {to} mm has no length");
            self.wrong(&child(path, "travel"), message, "write the smaller end first, as [-300.0, 0.0]");
        }
        let travel = raw.travel.and_then(|[from, to]| Millimetre::new(from).zip(Millimetre::new(to)));
        Some(Slope {
            position: position?,
            reference: Millimetre::new(raw.reference?)?,
            travel,
            terms: terms?,
        })
    }

    /// A term's input, and its gain in the unit of the sum.
    fn term(&mut self, path: &str, raw: &RawTerm, sum: Sum) -> Option<(Input, f64)> {
        let signal = raw.signal.as_ref().and_then(|signal| self.signal(&child(path, "signal"), signal));
        let gain = self.gain(path, raw, sum);
        let lag = raw.lag.as_ref().map(|lag| self.lag(path, lag, raw.reference.is_some()));
        let reference = raw.reference.map_or(Some(Reference::Fixed(Celsius::ZERO)), reference);
        let lag = match lag {
            Some(lag) => Some(lag?),
            None => None,
        };
        Some((Input { signal: signal?, reference: reference?, lag }, gain?))
    }

    /// The lag of a term or an input, which must have a reference.
    pub(super) fn lag(&mut self, path: &str, raw: &Span, has_reference: bool) -> Option<Duration> {
        if !has_reference {
            let help =
                "write \"start\", \"zero\", or the temperature at which the structure had its cold geometry";
            let message = "`reference` is missing: what lags begins at rest on it";
            self.missing(path, "reference", message, help);
        }
        let lag = self.span(&child(path, "lag"), Some(raw), Zero::Refused)?;
        if lag > LONGEST_LAG {
            let message = format!("{} is longer than a week", super::shown(lag));
            let help =
                "a structure that slow does not move in a shift: leave the term out, or check the unit";
            self.wrong(&child(path, "lag"), message, help);
        }
        Some(lag)
    }

    fn gain(&mut self, path: &str, raw: &RawTerm, sum: Sum) -> Option<f64> {
        if sum == Sum::Slope && (raw.expansion.is_some() || raw.length.is_some()) {
            let key = if raw.expansion.is_some() { "expansion" } else { "length" };
            let help = "write `gain` in µm/mm per unit of the signal";
            self.wrong_key(&child(path, key), "a slope has no length that expands", help);
            return None;
        }
        match (raw.gain, raw.expansion, raw.length) {
            (Some(gain), None, None) => Some(gain),
            (None, Some(expansion), Some(length)) => Some(expansion * length * MICRONS),
            (Some(_), ..) => {
                let help = "keep `gain` (µm per unit), or `expansion` (1/K) and `length` (mm)";
                self.wrong_key(&child(path, "gain"), "the gain is given twice", help);
                None
            }
            (None, Some(_), None) => {
                self.missing(
                    path,
                    "length",
                    "`length` is missing",
                    "`length` in mm goes with `expansion` in 1/K",
                );
                None
            }
            (None, None, Some(_)) => {
                self.missing(
                    path,
                    "expansion",
                    "`expansion` is missing",
                    "`expansion` in 1/K goes with `length` in mm",
                );
                None
            }
            (None, None, None) => {
                let help = "write `gain` (µm per unit of the signal), or `expansion` (1/K) and `length` (mm)";
                if !self.places.contains(&child(path, "expansion"))
                    && !self.places.contains(&child(path, "length"))
                {
                    self.missing(path, "gain", "`gain` is missing", help);
                }
                None
            }
        }
    }

    fn formula_model(&mut self, path: &str, raw: &RawModel) -> Option<Formula> {
        let none = BTreeMap::new();
        let inputs = match &raw.inputs {
            Some(Inputs::ByName(inputs)) => inputs,
            Some(Inputs::InOrder(_)) => {
                let help = "write inputs = { A = \"bed\" }: a formula knows its signals by name";
                self.wrong(&child(path, "inputs"), "a list of signals has no names", help);
                return None;
            }
            None => &none,
        };
        let dropped = |key: &str, there: bool| !there && self.places.contains(&child(path, key));
        if dropped("inputs", raw.inputs.is_some()) || dropped("constants", raw.constants.is_some()) {
            return None;
        }
        let Some(text) = &raw.formula else {
            let help =
                "write formula = \"K * (A - 20)\", with inputs = { A = \"bed\" } and constants = { K = 2.4 }";
            self.missing(path, "formula", "`formula` is missing", help);
            return None;
        };
        self.formula(path, text, inputs, raw.constants.as_ref().unwrap_or(&BTreeMap::new()))
    }
}

pub(super) fn reference(raw: ReferenceValue) -> Option<Reference> {
    Some(match raw {
        ReferenceValue::Number(number) => Reference::Fixed(Celsius::new(number)?),
        ReferenceValue::Word(ReferenceWord::Start) => Reference::Start,
        ReferenceValue::Word(ReferenceWord::Zero) => Reference::Zero,
    })
}
