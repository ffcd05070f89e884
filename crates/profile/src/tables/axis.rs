//! `[axis.*]`: what is computed, and how far it may go.

use schemars::JsonSchema;
use serde::Deserialize;

use super::At;
use super::label::{self, labelled};
use crate::Profile;
use crate::document::Section;
use crate::duration::{Timespan, shown};
use isotherm_core::compensation::model::{Model, Reference};
use isotherm_core::compensation::settings::{AxisSettings, Datum, GuardSettings, Levels, OnFault};
use isotherm_core::quantity::{Micron, MicronPerSecond};
use model::RawModel;
use model::all_over::AllOver;
use probe::{ProbeInput, RawProbe};

pub(super) mod doubts;
pub(super) mod intercept_slope;
pub(crate) mod model;
pub(crate) mod probe;

/// One compensated axis.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Axis")]
pub(crate) struct RawAxis {
    /// What people call it, in any script: shown beside the name.
    label: Option<String>,
    /// Largest |Cz|, µm.
    #[schemars(required, extend("x-layers" = "less"))]
    limit: Option<f64>,
    /// Largest change of one update, µm.
    #[schemars(required, extend("x-layers" = "less"))]
    pub(super) step: Option<f64>,
    /// Largest speed, µm/s.
    #[schemars(required, extend("x-layers" = "less"))]
    rate: Option<f64>,
    /// A smaller change is not made, µm. Default 0.
    deadband: Option<f64>,
    /// Update period.
    #[schemars(required)]
    pub(super) every: Option<Timespan>,
    /// What happens when no model or no output can be used.
    #[schemars(required, extend("x-layers" = "same"))]
    on_fault: Option<FaultAction>,
    /// Told once when |Cz| passes it, µm; at most `limit`.
    warn: Option<f64>,
    /// A model that asks for more than this is not believed, µm; at least `limit`. The axis takes its fault action and
    /// stays off until it is armed.
    error: Option<f64>,
    /// zero: Cz is measured from what the model asked for at the last zero. Default: from the model's own zero.
    datum: Option<DatumWord>,
    /// A lathe's X: the offset acts on the diameter, Cz is doubled when written. Default false.
    #[schemars(extend("x-layers" = "arrives"))]
    diameter: Option<bool>,
    /// Measured errors correct the models.
    probe: Option<RawProbe>,
    /// Models in order of preference: the first whose signals are all good is used. None yet: `record` and `identify`
    /// find one, and the axis stays off until then.
    pub(super) model: Option<Vec<RawModel>>,
}

/// What happens on a fault.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct FaultAction {
    /// hold: keep the last value; ramp: keep it for `after`, then to zero at `rate`; zero: to zero at once, `step` by `step`.
    #[schemars(required)]
    action: Option<FaultActionWord>,
    /// How long the last value is kept before the ramp; required for it.
    after: Option<Timespan>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum FaultActionWord {
    Hold,
    Ramp,
    Zero,
}

/// What Cz is measured from.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum DatumWord {
    Zero,
}

/// Purpose of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Purpose {
    /// The axis compensates.
    #[default]
    Compensation,
    /// The axis takes a register that is no output's any more back to its base. No profile file has such an axis.
    Release,
}

/// One axis as the profile has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What the pure step needs.
    pub settings: AxisSettings,
    /// What people call it; empty where the profile does not say.
    pub label: String,
    /// A lathe's X: the offset acts on the diameter, Cz is doubled when written.
    pub diameter: bool,
    /// Where its measured error is read; `None`: errors come by command only, if it takes any.
    pub probe_input: Option<ProbeInput>,
    /// Its purpose.
    pub purpose: Purpose,
}

impl Axis {
    /// How Cz is computed, which way it moves, how far and how fast.
    pub(crate) fn preview(&self, profile: &Profile, all_over: &[AllOver]) -> Section {
        let AxisSettings { name, models, guard, levels, .. } = &self.settings;
        let mut section = Section::default();
        section.line("");
        section.line(format!("axis {}", labelled(name, &self.label)));
        if models.is_empty() {
            section.line(
                "  no model yet: `isotherm record` and `isotherm identify` find one; until then it stays off",
            );
        }
        section.entry("name", name);
        section.entry("label", &self.label);
        let models = models.iter().enumerate();
        section.parts("models", models.map(|(place, model)| model::preview(profile, place, model, all_over)));
        let mut sign =
            "Cz is added to the position: a positive Cz makes the commanded or displayed position larger"
                .to_owned();
        if self.diameter {
            sign += "; it acts on a diameter, so twice Cz is written";
        }
        if self.settings.datum == Datum::Zero {
            sign += "; it is measured from its value at the last zero";
        }
        let (limit, step, every, rate) =
            (guard.limit.get(), guard.step.get(), shown(self.settings.every), guard.rate.get());
        let mut bounds = format!(
            "Cz stays within ±{limit} µm and changes by at most {step} µm every {every} and {rate} µm/s"
        );
        if guard.deadband.get() > 0.0 {
            bounds += &format!("; a change of up to {} µm is not made", guard.deadband.get());
        }
        bounds.extend(guard.count.map(|count| format!("; it moves in counts of {} µm", count.get())));
        bounds.extend(levels.warn.map(|warn| format!("; beyond ±{} µm it warns", warn.get())));
        bounds.extend(levels.error.map(|error| {
            format!(
                "; a model that asks for more than ±{} µm switches the axis off until it is armed",
                error.get()
            )
        }));
        let on_fault = match self.settings.on_fault {
            OnFault::Hold => "keeps the last Cz for as long as the fault lasts".to_owned(),
            OnFault::Zero => "takes Cz to zero at once, step by step".to_owned(),
            OnFault::Ramp { after } => {
                format!("keeps the last Cz for {}, then takes it to zero at {rate} µm/s", shown(after))
            }
        };
        for (key, label, text) in
            [("sign", "sign", sign), ("guard", "guard", bounds), ("on_fault", "on a fault", on_fault)]
        {
            section.line(format!("  {label}: {text}"));
            section.entry(key, text);
        }
        if let Some(settings) = &self.settings.probe {
            let probe = probe::preview(profile, self, settings);
            section.line(format!("  probe: {probe}"));
            section.entry("probe", probe);
        }
        section
    }

    /// Whether there is a way to compute its Cz yet; without one it stays off.
    pub fn has_model(&self) -> bool {
        !self.settings.models.is_empty()
    }

    /// Returns whether its Cz is measured from this: its datum, or the reference of an input of its models.
    pub fn counts_from(&self, reference: Reference) -> bool {
        let by_datum = reference == Reference::Zero && self.settings.datum == Datum::Zero;
        by_datum
            || self.settings.models.iter().flat_map(Model::rises).any(|input| input.reference == reference)
    }

    /// Whether some model of it says how wrong it is expected to be.
    pub fn says_how_wrong(&self) -> bool {
        self.settings.models.iter().any(|model| model.expected.is_some())
    }

    /// How much of Cz is written: twice as much where it acts on a diameter.
    pub(super) fn factor(&self) -> f64 {
        if self.diameter { 2.0 } else { 1.0 }
    }
}

impl RawAxis {
    pub(super) fn resolve(&self, at: &At<'_>, name: &str) -> Option<Axis> {
        let guard = self.guard(at);
        let every = at.key("every").period(self.every);
        let on_fault = self.on_fault.as_ref().and_then(|action| action.resolve(&at.key("on_fault")));
        let list = at.key("model");
        let models = self.model.as_deref().unwrap_or_default();
        for (index, model) in models.iter().enumerate() {
            if models[..index].iter().any(|other| other.name.is_some() && other.name == model.name) {
                let help = "the log tells models apart by their names";
                list.item(index).key("name").wrong("another model of this axis has this name", help);
            }
        }
        let levels = self.levels(at);
        let datum = self.datum(&at.key("datum"));
        let probe = match &self.probe {
            Some(probe) => probe.resolve(&at.key("probe"), self).map(Some),
            None => Some(None),
        };
        // Each is looked at, also where one before it is wrong.
        let models: Vec<Option<Model>> =
            models.iter().enumerate().map(|(index, model)| model.resolve(&list.item(index))).collect();
        let (probe, probe_input) = probe?.unzip();
        let settings = AxisSettings {
            name: name.to_owned(),
            models: models.into_iter().collect::<Option<_>>()?,
            guard: guard?,
            every: every?,
            on_fault: on_fault?,
            levels: levels?,
            datum,
            intercept_slope: None,
            probe,
        };
        let label = label::resolve(&at.key("label"), self.label.as_ref());
        let diameter = self.diameter.unwrap_or(false);
        let probe_input = probe_input.flatten();
        Some(Axis { settings, label, diameter, probe_input, purpose: Purpose::Compensation })
    }

    fn guard(&self, at: &At<'_>) -> Option<GuardSettings> {
        let limit = at.key("limit").positive(self.limit);
        let step = at.key("step").positive(self.step);
        let rate = at.key("rate").positive(self.rate);
        let deadband = self.deadband.unwrap_or(0.0);
        if deadband < 0.0 {
            let help = "write 0, or the smallest change in µm that is worth a write";
            at.key("deadband").wrong(format!("{deadband} is below zero"), help);
        }
        if let Some(limit) = limit {
            if deadband >= limit {
                let message = format!("the deadband of {deadband} µm is as large as the limit of {limit} µm");
                at.key("deadband").wrong(message, "the axis would never move: make it smaller");
            }
            if let Some(step) = step.filter(|step| *step > 2.0 * limit) {
                let message =
                    format!("a step of {step} µm is more than from one limit of {limit} µm to the other");
                at.key("step")
                    .wrong(message, "`step` is the largest change of one update: up to twice `limit`");
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

    /// A reference and a datum that are both taken at zero would subtract the same drift twice.
    fn datum(&self, at: &At<'_>) -> Datum {
        let Some(DatumWord::Zero) = self.datum else { return Datum::Model };
        let models = || self.model.iter().flatten();
        let taken =
            match (models().any(RawModel::has_term_at_zero), models().any(RawModel::has_input_at_zero)) {
                (true, _) => Some(("a term", "terms")),
                (false, true) => Some(("an input", "inputs")),
                (false, false) => None,
            };
        if let Some((one, all)) = taken {
            let help = format!("remove `datum`, or give the {all} a number or \"start\" as their reference");
            at.wrong(format!("{one}'s reference is taken at zero already"), help);
        }
        Datum::Zero
    }

    /// warn ≤ limit ≤ error.
    fn levels(&self, at: &At<'_>) -> Option<Levels> {
        let warn = level(&at.key("warn"), self.warn);
        let error = level(&at.key("error"), self.error);
        if let Some(limit) = self.limit.filter(|limit| *limit > 0.0) {
            if let Some(warn) = self.warn.filter(|warn| *warn > limit) {
                let help = "Cz never gets there: make `warn` smaller, or `limit` larger";
                at.key("warn").wrong(format!("warn at {warn} µm lies beyond the limit of {limit} µm"), help);
            }
            if let Some(error) = self.error.filter(|error| *error > 0.0 && *error < limit) {
                let help = "the limit would never act: make `error` larger, or `limit` smaller";
                let message = format!("error at {error} µm lies within the limit of {limit} µm");
                at.key("error").wrong(message, help);
            }
        }
        Some(Levels { warn: warn?, error: error? })
    }
}

impl FaultAction {
    fn resolve(&self, at: &At<'_>) -> Option<OnFault> {
        let action = self.action?;
        if action != FaultActionWord::Ramp && self.after.is_some() {
            at.key("after").wrong("only a ramp waits", "remove `after`, or write action = \"ramp\"");
        }
        match action {
            FaultActionWord::Hold => Some(OnFault::Hold),
            FaultActionWord::Zero => Some(OnFault::Zero),
            FaultActionWord::Ramp => {
                if self.after.is_none() {
                    let help =
                        "write how long the last value is kept before the ramp, as \"60s\" (\"0s\": at once)";
                    at.key("after").missing("`after` is missing: a ramp begins after a while", help);
                }
                self.after.map(|Timespan(after)| OnFault::Ramp { after })
            }
        }
    }
}

/// A level that may be left out, which is `Some(None)`.
fn level(at: &At<'_>, level: Option<f64>) -> Option<Option<Micron>> {
    match level {
        Some(_) => at.positive(level).map(Micron::new),
        None => Some(None),
    }
}
