//! Table `probe` of an axis: correction of its models by measured errors, and the source of these errors. A probing is
//! one measurement of the error by the probe of the machine.

use schemars::JsonSchema;
use serde::Deserialize;

use super::learning::{AdoptWord, LearnWord, Learning, LearningKeys};
use super::{Axis, RawAxis, level};
use crate::tables::signal::Signal;
use crate::tables::{KeyContext, optional};
use isotherm_core::candidate::Policy;
use isotherm_core::compensation::settings::{Filter, GainSettings, OnWorse, ProbeSettings};
use isotherm_core::quantity::Micron;
use isotherm_core::reading::SignalId;

/// Measured errors that correct an axis's models.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Probe")]
pub(super) struct RawProbe {
    /// Signal with the measured error, in um or mm: actual minus commanded position, while the compensation acts.
    /// Without this signal, measured errors are only given by command.
    signal: Option<String>,
    /// Signal that shows a new measured error: a flag or a counter. Each change to a value other than 0 is a probing.
    /// Default: each change of the measured error.
    trigger: Option<String>,
    /// Largest correction of a model's Cz, µm; at most the axis's `limit`.
    #[schemars(required)]
    limit: Option<f64>,
    /// Standard deviation of a probing, µm: the repeatability of two probings in a row. Default 0.5.
    repeat: Option<f64>,
    /// Growth of the variance of a model's correction with time, µm²/h. `isotherm identify` calculates it. Default 4.
    q: Option<f64>,
    /// Alternative to `repeat` and `q`: part of each measured residual (remaining error) that is added to the
    /// correction, above 0 and up to 1.
    filter: Option<f64>,
    /// Largest error of the model that a probing may show, µm. A probing that shows a larger error is refused.
    #[schemars(required)]
    max_error: Option<f64>,
    /// Absolute value of a measured residual above which the gateway warns that the model ages, µm; at most
    /// `max_error`.
    warn: Option<f64>,
    /// Adjustment of the gains of linear models to measured errors, by recursive least squares. Default: the gains do
    /// not change.
    gains: Option<RawGains>,
    /// Action while the last probings show that the model is worse than no compensation. "warn": an alarm (default).
    /// "ramp": an alarm, and Cz goes to zero at `rate` until the model is better again.
    worse: Option<WorseWord>,
    /// Learning of a model from the measured errors. With "daily", the gateway learns once a day, and compares the
    /// learned model with the model in use. This key needs a build with the feature `identify`.
    learn: Option<LearnWord>,
    /// Signals that the learned model must not use. Default: the learned model uses every temperature and every speed.
    learn_without: Option<Vec<String>>,
    /// Adoption of a learned model that is better than the model in use. "propose": an operator adopts it (default).
    /// "auto": the gateway adopts it at the next datum: at a zero command, if datum = "zero", or else at a machine start.
    adopt: Option<AdoptWord>,
}

/// Reaction of the gateway while a model is worse than no compensation.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum WorseWord {
    Warn,
    Ramp,
}

/// Settings for the adjustment of gains to measured errors.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "ProbeGains")]
struct RawGains {
    /// Factor by which each probing reduces the weight of all earlier ones, above 0 and up to 1. With 1, no probing
    /// loses weight.
    #[schemars(required)]
    forgetting: Option<f64>,
    /// Largest change of a gain, as a fraction of the gain, above 0 and below 1.
    #[schemars(required)]
    limit: Option<f64>,
}

/// Signals from which the gateway reads the result of a probing cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeInput {
    /// Signal that contains the measured error.
    pub signal: SignalId,
    /// Signal whose change reports a new measured error. `None` if each change of the measured error counts as a new
    /// measured error.
    pub trigger: Option<SignalId>,
    /// Factor that converts a reading of the signal into µm of Cz. The factor includes one half if the axis acts on a
    /// diameter.
    pub micron: f64,
}

impl RawProbe {
    /// Resolves the table `probe`: settings, signals of measured errors, and learning. The signals are `None` if errors
    /// come only by command. The learning is `None` if the axis does not learn. All errors are reported.
    pub(super) fn resolve(
        &self,
        at: &KeyContext<'_>,
        axis: &RawAxis,
    ) -> Option<(ProbeSettings, Option<ProbeInput>, Option<Learning>)> {
        let limit = at.key("limit").positive(self.limit);
        let most = axis.limit.filter(|most| *most > 0.0);
        if let Some((limit, most)) = limit.zip(most).filter(|(limit, most)| limit > most) {
            let message = format!("a correction of {limit} µm is larger than the axis's limit of {most} µm");
            at.key("limit").invalid(
                message,
                "make `limit` smaller: probing corrects the model, but does not replace it",
            );
        }
        let filter = self.filter(at);
        let max_error = at.key("max_error").positive(self.max_error);
        let warn = level(&at.key("warn"), self.warn);
        if let Some((warn, most)) = self.warn.zip(max_error).filter(|(warn, most)| warn > most) {
            let message = format!("`warn` is {warn} µm, which is more than the `max_error` of {most} µm");
            at.key("warn").invalid(message, "a probing beyond `max_error` is refused: make `warn` smaller");
        }
        let gains = optional(self.gains.as_ref(), |gains| gains.resolve(&at.key("gains"), axis));
        let input = self.input(at, axis.diameter.unwrap_or(false));
        let learning = LearningKeys {
            learn: self.learn,
            learn_without: self.learn_without.as_deref(),
            adopt: self.adopt,
            adjusts_gains: self.gains.is_some(),
        };
        let learning = learning.resolve(at);
        let settings = ProbeSettings {
            limit: Micron::new(limit?)?,
            filter: filter?,
            max_error: Micron::new(max_error?)?,
            warn: warn?,
            gains: gains?,
            worse: match self.worse {
                None | Some(WorseWord::Warn) => OnWorse::Warn,
                Some(WorseWord::Ramp) => OnWorse::Ramp,
            },
        };
        Some((settings, input?, learning?))
    }

    /// Resolves which part of each measured residual is added to the correction: a fixed part, or a part calculated
    /// from `repeat` and `q`.
    fn filter(&self, at: &KeyContext<'_>) -> Option<Filter> {
        let own = [("repeat", self.repeat), ("q", self.q)];
        if let Some(filter) = self.filter {
            for (key, _) in own.iter().filter(|(_, number)| number.is_some()) {
                let message = format!(
                    "`{key}` gives each probing its own weight, but `filter` gives all probings the same \
                     weight"
                );
                let help =
                    format!("remove `filter` (recommended: `{key}` is more accurate), or remove `{key}`");
                at.key(key).wrong_key(message, help);
            }
            return share(&at.key("filter"), Some(filter)).map(Filter::Share);
        }
        let [repeat, walk] =
            own.map(|(key, number)| number.map_or(Some(None), |_| at.key(key).positive(number).map(Some)));
        Some(Filter::Weighed {
            repeat: repeat?.unwrap_or(Filter::REPEAT),
            walk: walk?.unwrap_or(Filter::WALK),
        })
    }

    /// Resolves the signals of measured errors. Returns `Some(None)` if measured errors come only by command, and
    /// `None` if a signal has an error.
    fn input(&self, at: &KeyContext<'_>, diameter: bool) -> Option<Option<ProbeInput>> {
        let signal = at.key("signal").signal(self.signal.as_ref());
        let trigger = at.key("trigger").signal(self.trigger.as_ref());
        let Some(name) = &self.signal else {
            if self.trigger.is_some() {
                let help = "write `signal`, the signal with the measured error, or remove `trigger`";
                at.key("signal")
                    .missing("`signal` is missing: a trigger alone gives no measured error", help);
            }
            return Some(None);
        };
        let signal = signal?;
        if self.trigger.is_some() && trigger? == signal {
            let help = "remove `trigger`, so that each change of the error counts as a probing, or write the \
                        name of a flag or counter signal";
            at.key("trigger").invalid("the signal of the measured error cannot be its own trigger", help);
        }
        let of_unit = match at.unit_of(signal)?.0 {
            "um" => 1.0,
            "mm" => 1000.0,
            unit => {
                let help =
                    format!("write unit = \"um\" or \"mm\", and the `scale` for this unit, at signal.{name}");
                return at
                    .key("signal")
                    .reject(format!("signal `{name}` is in {unit}, not in um or mm"), help);
            }
        };
        let of_radius = if diameter { 0.5 } else { 1.0 };
        Some(Some(ProbeInput { signal, trigger, micron: of_radius * of_unit }))
    }
}

impl RawGains {
    fn resolve(&self, at: &KeyContext<'_>, axis: &RawAxis) -> Option<GainSettings> {
        let models = axis.model.as_deref().unwrap_or_default();
        if !models.is_empty() && !models.iter().any(|model| model.may_be_linear()) {
            let help = "remove `gains`: only the gains of linear models can be adjusted";
            at.wrong_key("no model of this axis is linear", help);
        }
        let limit = at.key("limit").positive(self.limit);
        if let Some(limit) = limit.filter(|limit| *limit >= 1.0) {
            let help = "write a number below 1, as 0.2: a gain never changes its sign";
            at.key("limit").invalid(format!("with {limit} a gain could become zero"), help);
        }
        let forgetting = share(&at.key("forgetting"), self.forgetting);
        Some(GainSettings { forgetting: forgetting?, limit: limit? })
    }
}

/// Describes the source of measured errors, their sign, and their limits, for the preview.
pub(super) fn preview(signals: &[Signal], axis: &Axis, settings: &ProbeSettings) -> String {
    let name = |id: SignalId| signals[id.0].name.as_str();
    let from = match &axis.probe_input {
        Some(input) => match input.trigger {
            Some(trigger) => {
                format!("{}, each time {} changes to a non-zero value", name(input.signal), name(trigger))
            }
            None => format!("{}, each time the value changes", name(input.signal)),
        },
        None => "commands".to_owned(),
    };
    let diameter = if axis.diameter { ", on the diameter" } else { "" };
    let share = match settings.filter {
        Filter::Share(share) => format!("{share} of the error"),
        Filter::Weighed { repeat, walk } => format!(
            "a part of the error (±{repeat} µm per probing, and a variance of the correction that grows by {walk} µm² \
             per hour)"
        ),
    };
    let mut text = format!(
        "measured errors (actual minus commanded{diameter}, with Cz active) come from {from}. A positive \
         error lowers the model's Cz by {share}, in total by at most {} µm. A measured error is refused if \
         it shows a model error of more than {} µm",
        settings.limit.get(),
        settings.max_error.get()
    );
    if let Some(warn) = settings.warn {
        text.push_str(&format!("; beyond ±{} µm the gateway warns", warn.get()));
    }
    if let Some(gains) = settings.gains {
        let percent = 100.0 * gains.limit;
        text.push_str(&format!("; the gains of linear models are adjusted by up to ±{percent:.3} % each"));
    }
    if settings.worse == OnWorse::Ramp {
        text.push_str("; while probings show that a model is worse than no compensation, Cz goes to zero");
    }
    if axis.says_how_wrong() {
        text.push_str("; the last 24 measured errors scale the expected error");
    }
    match &axis.learning {
        None => text.push_str("; `isotherm learn` learns a model from these errors"),
        Some(learning) => {
            text.push_str("; once a day, the gateway learns a model from these errors");
            if !learning.without.is_empty() {
                let names: Vec<&str> = learning.without.iter().map(|id| name(*id)).collect();
                text.push_str(&format!(" without {}", names.join(", ")));
            }
            text.push_str(match learning.adopt {
                Policy::Propose => {
                    ". If the learned model is better than the model in use, an operator may adopt it"
                }
                Policy::Auto => {
                    ". If the learned model is better than the model in use, the gateway adopts it at the \
                     next datum"
                }
            });
            text.push_str("; the adoption of a model does not change Cz");
        }
    }
    text
}

/// Returns the number if it is above 0 and at most 1. Otherwise reports an error and returns `None`.
fn share(at: &KeyContext<'_>, number: Option<f64>) -> Option<f64> {
    let number = number?;
    if number > 0.0 && number <= 1.0 {
        return Some(number);
    }
    at.reject(format!("{number} is outside of the allowed range"), "write a number above 0 and up to 1")
}
