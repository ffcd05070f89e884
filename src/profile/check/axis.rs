//! Axes and their models.

use std::collections::BTreeMap;

use super::{Check, Zero};
use crate::compensation::model::{Formula, Kind, Linear, Model, Reference, Term};
use crate::compensation::settings::{AxisSettings, GuardSettings, OnFault};
use crate::profile::Axis;
use crate::profile::place::{child, element};
use crate::profile::raw::{
    FaultAction, FaultActionWord, Inputs, ModelKind, RawAxis, RawModel, RawTerm, ReferenceValue,
    ReferenceWord,
};
use crate::quantity::Micron;

/// 1 mm in µm.
const MICRONS: f64 = 1000.0;

impl Check<'_> {
    pub(super) fn axes(&mut self) -> Vec<Option<Axis>> {
        let raw = self.raw;
        let each = self.axes.each();
        each.into_iter().map(|(_, name, path)| self.axis(&path, &name, raw.axis.get(&name)?)).collect()
    }

    fn axis(&mut self, path: &str, name: &str, raw: &RawAxis) -> Option<Axis> {
        let guard = self.guard(path, raw);
        let every = self.span(&child(path, "every"), raw.every.as_ref(), Zero::Refused);
        let on_fault =
            raw.on_fault.as_ref().and_then(|action| self.on_fault(&child(path, "on_fault"), action));
        let list = child(path, "model");
        let models = raw.model.as_deref().unwrap_or_default();
        if raw.model.is_some() && models.is_empty() {
            self.wrong(&list, "an axis needs at least one model", "write a [[axis.…model]] block");
        }
        for (index, model) in models.iter().enumerate() {
            let twin = models[..index].iter().any(|other| other.name.is_some() && other.name == model.name);
            if twin {
                let help = "the log tells models apart by their names";
                self.wrong(
                    &child(&element(&list, index), "name"),
                    "another model of this axis has this name",
                    help,
                );
            }
        }
        let models: Vec<Option<Model>> = models
            .iter()
            .enumerate()
            .map(|(index, model)| self.model(&element(&list, index), model))
            .collect();
        let settings = AxisSettings {
            name: name.to_owned(),
            models: super::complete(models)?,
            guard: guard?,
            every: every?,
            on_fault: on_fault?,
        };
        Some(Axis { settings, diameter: raw.diameter.unwrap_or(false) })
    }

    fn guard(&mut self, path: &str, raw: &RawAxis) -> Option<GuardSettings> {
        let limit = self.positive(&child(path, "limit"), raw.limit);
        let step = self.positive(&child(path, "step"), raw.step);
        let rate = self.positive(&child(path, "rate"), raw.rate);
        let deadband = raw.deadband.unwrap_or(0.0);
        if deadband < 0.0 {
            let help = "write 0, or the smallest change in µm that is worth a write";
            self.wrong(&child(path, "deadband"), format!("{deadband} is below zero"), help);
        }
        if let Some(limit) = limit {
            if deadband >= limit {
                let message = format!("the deadband of {deadband} µm is as large as the limit of {limit} µm");
                self.wrong(&child(path, "deadband"), message, "the axis would never move: make it smaller");
            }
            if let Some(step) = step.filter(|step| *step > limit) {
                let message = format!("a step of {step} µm is larger than the limit of {limit} µm");
                self.wrong(
                    &child(path, "step"),
                    message,
                    "`step` is the largest change of one update: up to `limit`",
                );
            }
        }
        Some(GuardSettings {
            limit: Micron::new(limit?)?,
            step: Micron::new(step?)?,
            rate: rate?,
            deadband: Micron::new(deadband)?,
            count: None,
        })
    }

    fn on_fault(&mut self, path: &str, raw: &FaultAction) -> Option<OnFault> {
        let after = self.span(&child(path, "after"), raw.after.as_ref(), Zero::Allowed);
        let action = raw.action?;
        if action != FaultActionWord::Ramp && raw.after.is_some() {
            let message = "only a ramp waits";
            self.wrong(&child(path, "after"), message, "remove `after`, or write action = \"ramp\"");
        }
        match action {
            FaultActionWord::Hold => Some(OnFault::Hold),
            FaultActionWord::Zero => Some(OnFault::Zero),
            FaultActionWord::Ramp => {
                if raw.after.is_none() {
                    let help =
                        "write how long the last value is kept before the ramp, as \"60s\" (\"0s\": at once)";
                    self.missing(path, "after", "`after` is missing: a ramp begins after a while", help);
                }
                after.map(|after| OnFault::Ramp { after })
            }
        }
    }

    fn model(&mut self, path: &str, raw: &RawModel) -> Option<Model> {
        let fixed = [("slope", raw.slope.is_some(), "terms that grow with the position (slope)")];
        for (key, there, what) in fixed {
            if there {
                self.not_built(&child(path, key), what, None);
            }
        }
        let kind = raw.kind?;
        self.foreign_keys_of_model(path, kind, raw);
        let kind = match kind {
            ModelKind::Linear => self.linear(path, raw).map(Kind::Linear),
            ModelKind::Formula => self.formula_model(path, raw).map(Kind::Formula),
            ModelKind::Matrix => self.matrix(path, raw).map(Kind::Matrix),
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

    fn linear(&mut self, path: &str, raw: &RawModel) -> Option<Linear> {
        let list = child(path, "terms");
        let Some(terms) = &raw.terms else {
            let help = "write terms = [ { signal = \"…\", gain = … } ]";
            self.missing(path, "terms", "`terms` is missing: a linear model adds up terms", help);
            return None;
        };
        if terms.is_empty() {
            self.wrong(&list, "a model without terms follows no temperature", "write at least one term");
        }
        let terms =
            terms.iter().enumerate().map(|(index, term)| self.term(&element(&list, index), term)).collect();
        Some(Linear { offset: raw.offset.unwrap_or(0.0), terms: super::complete(terms)? })
    }

    fn term(&mut self, path: &str, raw: &RawTerm) -> Option<Term> {
        let signal = raw.signal.as_ref().and_then(|signal| self.signal(&child(path, "signal"), signal));
        if raw.lag.is_some() {
            self.not_built(&child(path, "lag"), "a term that lags behind its temperature (lag)", None);
        }
        let gain = self.gain(path, raw);
        let reference = raw.reference.map_or(Reference::Fixed(0.0), reference);
        Some(Term { signal: signal?, gain: gain?, reference })
    }

    fn gain(&mut self, path: &str, raw: &RawTerm) -> Option<f64> {
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

pub(super) fn reference(raw: ReferenceValue) -> Reference {
    match raw {
        ReferenceValue::Number(number) => Reference::Fixed(number),
        ReferenceValue::Word(ReferenceWord::Start) => Reference::Start,
        ReferenceValue::Word(ReferenceWord::Zero) => Reference::Zero,
    }
}
