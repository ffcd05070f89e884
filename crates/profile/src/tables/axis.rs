//! `[axis.*]`: models, limits and fault action of an axis. Cz is the compensation value of the axis, which the gateway
//! calculates from a model and writes to the control.

use schemars::JsonSchema;
use serde::Deserialize;

use super::label::{self, labelled};
use super::signal::Signal;
use super::{KeyContext, optional};
use crate::document::{Section, entries};
use crate::duration::{Timespan, shown};
use isotherm_core::compensation::model::{Model, Reference};
use isotherm_core::compensation::settings::{AxisSettings, Datum, GuardSettings, Levels, OnFault};
use isotherm_core::quantity::{Micron, MicronPerSecond};
use learning::Learning;
use model::RawModel;
use model::uniform_temperature::UniformTemperature;
use probe::{ProbeInput, RawProbe};

pub(super) mod doubts;
pub(super) mod intercept_slope;
pub(super) mod learned_model;
pub(crate) mod learning;
pub(crate) mod model;
pub(crate) mod probe;

/// Axis of the machine, whose thermal error the gateway compensates.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Axis")]
pub(crate) struct RawAxis {
    /// Display name of the axis in any writing system, for example Chinese. It is shown next to the name.
    label: Option<String>,
    /// Largest absolute value of Cz, the compensation of the axis, µm.
    #[schemars(required, extend("x-layers" = "less"))]
    limit: Option<f64>,
    /// Largest change of Cz in one update, µm.
    #[schemars(required, extend("x-layers" = "less"))]
    pub(super) step: Option<f64>,
    /// Largest rate of change of Cz, µm/s.
    #[schemars(required, extend("x-layers" = "less"))]
    rate: Option<f64>,
    /// Smallest change of Cz that is made, µm. Smaller changes are ignored. Default 0.
    deadband: Option<f64>,
    /// Period of the updates of Cz.
    #[schemars(required)]
    pub(super) every: Option<Timespan>,
    /// Action if no model or no output can be used.
    #[schemars(required, extend("x-layers" = "same"))]
    on_fault: Option<FaultAction>,
    /// Absolute value of Cz above which the gateway warns, µm; at most `limit`. The warning is reported when Cz crosses
    /// this level, and not repeated while Cz stays above it.
    warn: Option<f64>,
    /// Absolute value of the model's result above which the axis executes its fault action, µm; at least `limit`. The
    /// axis then stays off until it is armed.
    error: Option<f64>,
    /// Zero point of Cz. With "zero", Cz is the change of the model's value since the last zero command. Default: the
    /// model's own zero point.
    datum: Option<DatumWord>,
    /// Whether the offset is a diameter, as for X of a lathe. Cz is then doubled when written. Default false.
    #[schemars(extend("x-layers" = "arrives"))]
    diameter: Option<bool>,
    /// Correction of the models by measured errors.
    probe: Option<RawProbe>,
    /// Models in order of preference. The first one whose signals are all good is used. Without a model the axis stays
    /// off; `isotherm record` and `isotherm identify` find one.
    pub(super) model: Option<Vec<RawModel>>,
}

/// Fault action of an axis, executed if no model or no output can be used.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct FaultAction {
    /// Fault action. "hold" keeps the last Cz. "ramp" keeps the last Cz for `after`, then moves Cz to zero at `rate`.
    /// "zero" moves Cz to zero at once, in steps of `step`.
    #[schemars(required)]
    action: Option<FaultActionWord>,
    /// Time before the ramp during which the last value is kept. Required for "ramp".
    after: Option<Timespan>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum FaultActionWord {
    Hold,
    Ramp,
    Zero,
}

/// Zero point of Cz.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum DatumWord {
    Zero,
}

/// Purpose of an axis: compensation, or the release of a register.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Purpose {
    /// The axis compensates the error of its machine axis.
    #[default]
    Compensation,
    /// The axis does not compensate. It only removes an earlier Cz from a register that no output uses any longer. A
    /// profile file cannot contain such an axis.
    Release,
}

/// Axis of the profile, after all its keys were checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Settings from which Cz is calculated in each update.
    pub settings: AxisSettings,
    /// Display name. Empty if the profile has none.
    pub label: String,
    /// Whether the offset is a diameter, as for X of a lathe. Cz is then doubled when written.
    pub diameter: bool,
    /// Signals from which measured errors are read. `None` if measured errors come only by command, or not at all.
    pub probe_input: Option<ProbeInput>,
    /// Settings for learning the model from measured errors. `None` if the axis does not learn.
    pub learning: Option<Learning>,
    /// Purpose of the axis: compensation, or the release of a register.
    pub purpose: Purpose,
}

impl Axis {
    /// Returns the preview of the axis: calculation, direction, limits and rate of Cz.
    pub(crate) fn preview(&self, signals: &[Signal], all_over: &mut [UniformTemperature]) -> Section {
        let AxisSettings { name, guard, levels, .. } = &self.settings;
        let models = self.settings.own_models();
        let mut section = Section::default();
        section.line("");
        section.line(format!("axis {}", labelled(name, &self.label)));
        if models.is_empty() && self.learning.is_some() {
            section.line(
                "  no model yet: the axis stays off until a model is learned from its measured errors and adopted",
            );
        } else if models.is_empty() {
            section.line(
                "  no model yet: `isotherm record` and `isotherm identify` find one; until then the axis \
                 stays off",
            );
        }
        entries!(section, name, label = &self.label);
        let models = models.iter().enumerate();
        section.parts("models", models.map(|(place, model)| model::preview(signals, place, model, all_over)));
        let mut sign =
            "Cz is added to the position: a positive Cz makes the commanded or displayed position larger"
                .to_owned();
        if self.diameter {
            sign += "; the position is a diameter, so twice Cz is written";
        }
        if self.settings.datum == Datum::Zero {
            sign += "; Cz is the change of the model's value since the last zero command";
        }
        let (limit, step, every, rate) =
            (guard.limit.get(), guard.step.get(), shown(self.settings.every), guard.rate.get());
        let mut bounds = format!(
            "Cz stays within ±{limit} µm and changes by at most {step} µm every {every} and {rate} µm/s"
        );
        if guard.deadband.get() > 0.0 {
            bounds += &format!("; changes of up to {} µm are ignored", guard.deadband.get());
        }
        bounds.extend(
            guard
                .count
                .map(|count| format!("; Cz changes in steps of {} µm, the size of one count", count.get())),
        );
        bounds.extend(levels.warn.map(|warn| format!("; beyond ±{} µm the gateway warns", warn.get())));
        bounds.extend(levels.error.map(|error| {
            format!("; a model value beyond ±{} µm switches the axis off until it is armed", error.get())
        }));
        let on_fault = match self.settings.on_fault {
            OnFault::Hold => "keeps the last Cz for as long as the fault lasts".to_owned(),
            OnFault::Zero => "moves Cz to zero at once, in steps".to_owned(),
            OnFault::Ramp { after } => {
                format!("keeps the last Cz for {}, then moves Cz to zero at {rate} µm/s", shown(after))
            }
        };
        for (key, label, text) in
            [("sign", "sign", sign), ("guard", "guard", bounds), ("on_fault", "on a fault", on_fault)]
        {
            section.line(format!("  {label}: {text}"));
            section.entry(key, text);
        }
        if let Some(settings) = &self.settings.probe {
            let probe = probe::preview(signals, self, settings);
            section.line(format!("  probe: {probe}"));
            section.entry("probe", probe);
        }
        section
    }

    /// Returns whether the axis has a model. An axis without a model stays off.
    pub fn has_model(&self) -> bool {
        !self.settings.models.is_empty()
    }

    /// Returns whether Cz depends on a value that was captured for this reference ("start" or "zero"). This is the case
    /// if a model or the datum (zero point of Cz) of the axis uses the reference.
    pub fn counts_from(&self, reference: Reference) -> bool {
        let by_datum = reference == Reference::Zero && self.settings.datum == Datum::Zero;
        by_datum
            || self.settings.models.iter().flat_map(Model::rises).any(|input| input.reference == reference)
    }

    /// Returns whether a model of the axis has the key `expected`, which states its probable error.
    pub fn says_how_wrong(&self) -> bool {
        self.settings.models.iter().any(|model| model.expected.is_some())
    }

    /// Returns the factor of Cz in the written value: 2 for a diameter, otherwise 1.
    pub(super) fn factor(&self) -> f64 {
        if self.diameter { 2.0 } else { 1.0 }
    }
}

impl RawAxis {
    /// Resolves the table of an axis with its models. `settle` is the averaging time of references, from the table
    /// `[machine]`.
    pub(super) fn resolve(&self, settle: Option<Timespan>, at: &KeyContext<'_>, name: &str) -> Option<Axis> {
        let guard = self.guard(at);
        let every = at.key("every").period(self.every);
        let on_fault = self.on_fault.as_ref().and_then(|action| action.resolve(&at.key("on_fault")));
        let list = at.key("model");
        let models = self.model.as_deref().unwrap_or_default();
        for (index, model) in models.iter().enumerate() {
            if models[..index].iter().any(|other| other.name.is_some() && other.name == model.name) {
                let help = "write another name: the log distinguishes models by their names";
                list.item(index).key("name").invalid("another model of this axis has this name", help);
            }
        }
        let levels = self.levels(at);
        let datum = self.datum(&at.key("datum"));
        let probe = optional(self.probe.as_ref(), |probe| probe.resolve(&at.key("probe"), self));
        // All models are checked, even after one with an error.
        let models = models.iter().enumerate().map(|(index, model)| model.resolve(&list.item(index), settle));
        let models: Vec<Option<Model>> = models.collect();
        let (probe, probe_input, learning) = match probe? {
            None => (None, None, None),
            Some((probe, input, learning)) => (Some(probe), input, learning),
        };
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
            learned: None,
        };
        let label = label::resolve(&at.key("label"), self.label.as_ref());
        let diameter = self.diameter.unwrap_or(false);
        Some(Axis { settings, label, diameter, probe_input, learning, purpose: Purpose::Compensation })
    }

    fn guard(&self, at: &KeyContext<'_>) -> Option<GuardSettings> {
        let limit = at.key("limit").positive(self.limit);
        let step = at.key("step").positive(self.step);
        let rate = at.key("rate").positive(self.rate);
        let deadband = self.deadband.unwrap_or(0.0);
        if deadband < 0.0 {
            let help = "write 0, or the smallest change in µm that is worth a write";
            at.key("deadband").invalid(format!("{deadband} is below zero"), help);
        }
        if let Some(limit) = limit {
            if deadband >= limit {
                let message = format!("the deadband of {deadband} µm is as large as the limit of {limit} µm");
                at.key("deadband").invalid(message, "Cz would never change: make `deadband` smaller");
            }
            if let Some(step) = step.filter(|step| *step > 2.0 * limit) {
                let message =
                    format!("a step of {step} µm is more than the whole range from −{limit} to +{limit} µm");
                at.key("step")
                    .invalid(message, "`step` is the largest change of one update: up to twice `limit`");
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

    /// Resolves the datum (zero point of Cz). Reports an error if both `datum` and an input of a model have the
    /// reference "zero", because the same drift would be subtracted twice.
    fn datum(&self, at: &KeyContext<'_>) -> Datum {
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
            at.invalid(format!("{one} already has the reference \"zero\""), help);
        }
        Datum::Zero
    }

    /// Checks and resolves the levels `warn`, `limit` and `error` of Cz, which must satisfy warn ≤ limit ≤ error.
    fn levels(&self, at: &KeyContext<'_>) -> Option<Levels> {
        let warn = level(&at.key("warn"), self.warn);
        let error = level(&at.key("error"), self.error);
        if let Some(limit) = self.limit.filter(|limit| *limit > 0.0) {
            if let Some(warn) = self.warn.filter(|warn| *warn > limit) {
                let help = "Cz never reaches this level: make `warn` smaller, or `limit` larger";
                at.key("warn").invalid(
                    format!("`warn` is {warn} µm, which is more than the limit of {limit} µm"),
                    help,
                );
            }
            if let Some(error) = self.error.filter(|error| *error > 0.0 && *error < limit) {
                let help = "the limit would never be reached: make `error` larger, or `limit` smaller";
                let message = format!("`error` is {error} µm, which is less than the limit of {limit} µm");
                at.key("error").invalid(message, help);
            }
        }
        Some(Levels { warn: warn?, error: error? })
    }
}

impl FaultAction {
    fn resolve(&self, at: &KeyContext<'_>) -> Option<OnFault> {
        let action = self.action?;
        if action != FaultActionWord::Ramp && self.after.is_some() {
            at.key("after").invalid(
                "`after` is allowed only with action = \"ramp\"",
                "remove `after`, or write action = \"ramp\"",
            );
        }
        match action {
            FaultActionWord::Hold => Some(OnFault::Hold),
            FaultActionWord::Zero => Some(OnFault::Zero),
            FaultActionWord::Ramp => {
                let help =
                    "write how long the last value is kept before the ramp, as \"60s\" (\"0s\": at once)";
                at.key("after").missing("`after` is missing: a ramp needs the time before it begins", help);
                self.after.map(|Timespan(after)| OnFault::Ramp { after })
            }
        }
    }
}

/// Resolves an optional level of Cz. Returns `Some(None)` if the profile does not state the level, and `None` if the
/// level is invalid.
fn level(at: &KeyContext<'_>, level: Option<f64>) -> Option<Option<Micron>> {
    match level {
        Some(_) => at.positive(level).map(Micron::new),
        None => Some(None),
    }
}
