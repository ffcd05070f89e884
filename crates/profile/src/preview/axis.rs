//! An axis in words: how Cz is computed, which way it moves, how far and how fast.

use std::fmt;
use std::time::Duration;

use serde::Serialize;

use crate::{Axis, Profile};
use isotherm_core::compensation::model::{Formula, Input, Kind, Linear, Model, Reference, Term};
use isotherm_core::compensation::settings::{AxisSettings, Datum, OnFault};
use isotherm_core::quantity::Micron;
use isotherm_core::reading::SignalId;

mod data;
mod probe;

/// One axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisExplained {
    /// Its name.
    pub name: String,
    /// In order of preference.
    pub models: Vec<ModelExplained>,
    /// What a positive Cz means.
    pub sign: String,
    /// How far and how fast Cz may move.
    pub guard: String,
    /// What happens when no model or output can be used.
    pub on_fault: String,
    /// What measured errors may change; where the axis takes any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probe: Option<String>,
}

/// One model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModelExplained {
    /// Its name.
    pub name: String,
    /// `Cz = 2.4·(bed − 0) − 2.4·(wheelhead − 0) + 0 µm`.
    pub formula: String,
    /// What one unit more of each signal does.
    pub effects: Vec<String>,
    /// The region it was identified on, and what happens outside; where the profile names one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub envelope: Option<String>,
}

pub(super) fn explained(profile: &Profile, axis: &Axis) -> AxisExplained {
    let settings = &axis.settings;
    let guard = &settings.guard;
    let every = humantime::format_duration(settings.every);
    let mut words = format!(
        "Cz stays within ±{} µm and changes by at most {} µm every {every} and {} µm/s",
        guard.limit.get(),
        guard.step.get(),
        guard.rate.get()
    );
    if guard.deadband.get() > 0.0 {
        words.push_str(&format!("; a change of up to {} µm is not made", guard.deadband.get()));
    }
    if let Some(count) = guard.count {
        words.push_str(&format!("; it moves in counts of {} µm", count.get()));
    }
    words.push_str(&levels(settings));
    let mut sign =
        "Cz is added to the position: a positive Cz makes the commanded or displayed position larger"
            .to_owned();
    if axis.diameter {
        sign.push_str("; it acts on a diameter, so twice Cz is written");
    }
    if settings.datum == Datum::Zero {
        sign.push_str("; it is measured from its value at the last zero");
    }
    AxisExplained {
        name: settings.name.clone(),
        models: settings.models.iter().map(|model| model_explained(profile, model)).collect(),
        sign,
        guard: words,
        on_fault: fault_action(settings.on_fault, guard.rate.get()),
        probe: settings.probe.as_ref().map(|probe| probe::probe(profile, axis, probe)),
    }
}

fn levels(settings: &AxisSettings) -> String {
    let mut words = String::new();
    if let Some(warn) = settings.levels.warn {
        words.push_str(&format!("; beyond ±{} µm it warns", warn.get()));
    }
    if let Some(error) = settings.levels.error {
        words.push_str(&format!(
            "; a model that asks for more than ±{} µm switches the axis off until it is armed",
            error.get()
        ));
    }
    words
}

fn fault_action(action: OnFault, rate: f64) -> String {
    match action {
        OnFault::Hold => "keeps the last Cz for as long as the fault lasts".to_owned(),
        OnFault::Zero => "takes Cz to zero at once, step by step".to_owned(),
        OnFault::Ramp { after } => {
            let after = humantime::format_duration(after);
            format!("keeps the last Cz for {after}, then takes it to zero at {rate} µm/s")
        }
    }
}

fn model_explained(profile: &Profile, model: &Model) -> ModelExplained {
    let (formula, effects) = match &model.kind {
        Kind::Linear(linear) => (linear_text(profile, linear), linear_effects(profile, linear)),
        Kind::Formula(formula) => {
            let names: Vec<&str> =
                formula.expression.signals().into_iter().map(|id| profile.signal(id).name.as_str()).collect();
            let text = format!("Cz = {} µm, over {}", formula.expression.text(), names.join(", "));
            (text, formula_effects(profile, formula))
        }
        Kind::Matrix(matrix) => data::matrix(profile, matrix),
        Kind::Network(network) => data::network(profile, network),
    };
    let envelope = model.envelope.as_ref().map(|envelope| data::envelope(profile, envelope));
    ModelExplained { name: model.name.clone(), formula, effects, envelope }
}

fn linear_text(profile: &Profile, linear: &Linear) -> String {
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
        if let Some(lag) = input.lag {
            text.push_str(&format!(" lagged by {}", humantime::format_duration(lag)));
        }
    }
    text
}

fn linear_effects(profile: &Profile, linear: &Linear) -> Vec<String> {
    let mut effects = gains(&linear.terms)
        .into_iter()
        .map(|(input, gain)| effect(profile, input.signal, gain, &late(profile, input.signal, input.lag, "")))
        .collect::<Vec<String>>();
    effects.extend(together(profile, &linear.terms, 1.0, ""));
    if let Some(slope) = &linear.slope {
        let position = &profile.signal(slope.position).name;
        let beside = format!(" and {position} stands 100 mm above {} mm", figure(slope.reference.get()));
        for (input, gain) in gains(&slope.terms) {
            let place = late(profile, input.signal, input.lag, &beside);
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
    let gains = gains(terms);
    let mut signals: Vec<SignalId> = Vec::new();
    for (input, _) in &gains {
        if !signals.contains(&input.signal) {
            signals.push(input.signal);
        }
    }
    let sum = |signal: SignalId| {
        let own: Vec<f64> =
            gains.iter().filter(|(input, _)| input.signal == signal).map(|(_, gain)| gain * times).collect();
        let place = format!("{beside} for good (its {} terms added up)", own.len());
        (own.len() > 1).then(|| effect(profile, signal, own.iter().sum(), &place))
    };
    signals.into_iter().filter_map(sum).collect()
}

/// Each input with its gain, in the unit of the sum.
fn parts<Gain: Copy + Into<f64>>(terms: &[Term<Gain>]) -> Vec<(Input, f64)> {
    terms.iter().map(|term| (term.input, term.gain.into())).collect()
}

/// The gains of each signal and each lag added up.
fn gains<Gain: Copy + Into<f64>>(terms: &[Term<Gain>]) -> Vec<(Input, f64)> {
    let mut gains: Vec<(Input, f64)> = Vec::new();
    for (input, own) in parts(terms) {
        match gains.iter_mut().find(|(known, _)| (known.signal, known.lag) == (input.signal, input.lag)) {
            Some((_, gain)) => *gain += own,
            None => gains.push((input, own)),
        }
    }
    gains
}

fn late(profile: &Profile, signal: SignalId, lag: Option<Duration>, beside: &str) -> String {
    let signal = &profile.signal(signal).name;
    match lag {
        Some(lag) => {
            let lag = humantime::format_duration(lag);
            format!("{beside} (63 % of it {lag} after {signal} has risen)")
        }
        None => beside.to_owned(),
    }
}

/// A formula may bend: its effect is told at one point, the machine just started and every signal in the middle of its
/// range.
fn formula_effects(profile: &Profile, formula: &Formula) -> Vec<String> {
    let middle = |id: SignalId| middle(profile, id);
    let at = |raised: Option<SignalId>| {
        let value = |id: SignalId| Some(middle(id) + if raised == Some(id) { 1.0 } else { 0.0 });
        formula.expression.evaluate(&value, Some(0.0)).ok().filter(|cz| cz.is_finite())
    };
    let change = |id: SignalId| match (at(None), at(Some(id))) {
        (Some(before), Some(after)) => {
            let place = format!(" (from {} at t = 0)", figure(middle(id)));
            effect(profile, id, after - before, &place)
        }
        _ => format!(
            "at {} = {} and t = 0 the formula has no value",
            profile.signal(id).name,
            figure(middle(id))
        ),
    };
    formula.expression.signals().into_iter().map(change).collect()
}

fn reference(reference: Reference) -> String {
    match reference {
        Reference::Fixed(number) => figure(number.get()),
        Reference::Start => "its value at machine start".to_owned(),
        Reference::Zero => "its value at zero".to_owned(),
    }
}

/// Where the effect of a signal is told: in the middle of its range.
fn middle(profile: &Profile, id: SignalId) -> f64 {
    match profile.signal(id).range {
        Some((low, high)) => f64::midpoint(low, high),
        None => 20.0,
    }
}

fn effect(profile: &Profile, id: SignalId, change: f64, place: &str) -> String {
    let signal = profile.signal(id);
    let unit = signal.unit.to_string();
    let space = if unit.is_empty() { "" } else { " " };
    let sign = if change < 0.0 { "−" } else { "+" };
    format!(
        "when {} rises by 1{space}{unit}{place}, Cz changes by {sign}{} µm",
        signal.name,
        figure(change.abs())
    )
}

/// Without the last digits, which come from binary fractions.
fn figure(number: f64) -> String {
    format!("{:.9}", number).trim_end_matches('0').trim_end_matches('.').to_owned()
}

impl fmt::Display for AxisExplained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "axis {}", self.name)?;
        if self.models.is_empty() {
            writeln!(
                f,
                "  no model yet: `isotherm record` and `isotherm identify` find one; until then it cannot run"
            )?;
        }
        for (place, model) in self.models.iter().enumerate() {
            writeln!(f, "  {}. {}: {}", place + 1, model.name, model.formula)?;
            for effect in &model.effects {
                writeln!(f, "     {effect}")?;
            }
            if let Some(envelope) = &model.envelope {
                writeln!(f, "     {envelope}")?;
            }
        }
        writeln!(f, "  sign: {}", self.sign)?;
        writeln!(f, "  guard: {}", self.guard)?;
        writeln!(f, "  on a fault: {}", self.on_fault)?;
        match &self.probe {
            Some(probe) => writeln!(f, "  probe: {probe}"),
            None => Ok(()),
        }
    }
}
