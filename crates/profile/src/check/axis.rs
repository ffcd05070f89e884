//! Axes and their models.

use super::{Check, Signals, Zero};
use crate::Axis;
use crate::place::{child, element};
use crate::raw::{
    DatumWord, FaultAction, FaultActionWord, InputValue, Inputs, RawAxis, RawModel, ReferenceValue,
    ReferenceWord,
};
use isotherm_core::compensation::model::Model;
use isotherm_core::compensation::settings::{AxisSettings, Datum, GuardSettings, Levels, OnFault};
use isotherm_core::quantity::{Micron, MicronPerSecond};

impl Check<'_> {
    pub(super) fn axes(&mut self, signals: &Signals) -> Vec<Option<Axis>> {
        let raw = self.raw;
        let each = self.axes.each();
        each.into_iter()
            .map(|(_, name, path)| self.axis(&path, &name, raw.axis.get(&name)?, signals))
            .collect()
    }

    fn axis(&mut self, path: &str, name: &str, raw: &RawAxis, signals: &Signals) -> Option<Axis> {
        let guard = self.guard(path, raw);
        let every = self.span(&child(path, "every"), raw.every.as_ref(), Zero::Refused);
        let on_fault =
            raw.on_fault.as_ref().and_then(|action| self.on_fault(&child(path, "on_fault"), action));
        let list = child(path, "model");
        let models = raw.model.as_deref().unwrap_or_default();
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
        let levels = self.levels(path, raw);
        let datum = self.datum(path, raw);
        let probe = self.probe(path, raw, signals);
        let models: Vec<Option<Model>> = models
            .iter()
            .enumerate()
            .map(|(index, model)| self.model(&element(&list, index), model, signals))
            .collect();
        let (probe, probe_input) = probe?.map_or((None, None), |(settings, input)| (Some(settings), input));
        let settings = AxisSettings {
            name: name.to_owned(),
            models: super::complete(models)?,
            guard: guard?,
            every: every?,
            on_fault: on_fault?,
            levels: levels?,
            datum,
            intercept_slope: None,
            probe,
        };
        Some(Axis { settings, diameter: raw.diameter.unwrap_or(false), probe_input })
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
            rate: MicronPerSecond::new(rate?)?,
            deadband: Micron::new(deadband)?,
            count: None,
        })
    }

    /// warn ≤ limit ≤ error.
    fn levels(&mut self, path: &str, raw: &RawAxis) -> Option<Levels> {
        let level = |check: &mut Self, key: &str, level: Option<f64>| match level {
            Some(_) => check.positive(&child(path, key), level).map(Micron::new),
            None => Some(None),
        };
        let warn = level(self, "warn", raw.warn);
        let error = level(self, "error", raw.error);
        let limit = raw.limit.filter(|limit| *limit > 0.0);
        if let (Some(limit), Some(warn)) = (limit, raw.warn)
            && warn > limit
        {
            let message = format!("warn at {warn} µm lies beyond the limit of {limit} µm");
            let help = "Cz never gets there: make `warn` smaller, or `limit` larger";
            self.wrong(&child(path, "warn"), message, help);
        }
        if let (Some(limit), Some(error)) = (limit, raw.error.filter(|error| *error > 0.0))
            && error < limit
        {
            let message = format!("error at {error} µm lies within the limit of {limit} µm");
            let help = "the limit would never act: make `error` larger, or `limit` smaller";
            self.wrong(&child(path, "error"), message, help);
        }
        Some(Levels { warn: warn?, error: error? })
    }

    /// A reference and a datum that are both taken at zero would subtract the same drift twice.
    fn datum(&mut self, path: &str, raw: &RawAxis) -> Datum {
        if raw.datum != Some(DatumWord::Zero) {
            return Datum::Model;
        }
        let models = raw.model.iter().flatten();
        let slopes = models.clone().filter_map(|model| model.slope.as_ref()?.terms.as_ref());
        let mut terms = models.clone().filter_map(|model| model.terms.as_ref()).chain(slopes).flatten();
        let at_zero = |reference| matches!(reference, Some(ReferenceValue::Word(ReferenceWord::Zero)));
        let input_at_zero = |input: &InputValue| match input {
            InputValue::Name(_) => false,
            InputValue::Table(input) => at_zero(input.reference),
        };
        let file_at_zero = |model: &RawModel| match &model.inputs {
            Some(Inputs::InOrder(inputs)) => at_zero(model.reference) || inputs.iter().any(input_at_zero),
            _ => false,
        };
        if terms.any(|term| at_zero(term.reference)) {
            let help = "remove `datum`, or give the terms a number or \"start\" as their reference";
            self.wrong(&child(path, "datum"), "a term's reference is taken at zero already", help);
        } else if models.clone().any(file_at_zero) {
            let help = "remove `datum`, or give the inputs a number or \"start\" as their reference";
            self.wrong(&child(path, "datum"), "an input's reference is taken at zero already", help);
        }
        Datum::Zero
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
}
