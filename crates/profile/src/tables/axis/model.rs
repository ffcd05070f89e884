//! `[[axis.*.model]]`: models of an axis.

use std::collections::BTreeMap;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use crate::Profile;
use crate::document::{Section, entries};
use crate::duration::Timespan;
use crate::tables::{KeyContext, optional};
use envelope::OutsideWord;
use expected::RawExpected;
use identified_with::RawIdentifiedWith;
use inputs::{Inputs, ReferenceValue};
use isotherm_core::compensation::model::{Kind, Model};
use isotherm_core::reading::SignalId;
use linear::{RawSlope, RawTerm};
use matrix::{Carries, Component};
use seals::RawSeals;
use uniform_temperature::UniformTemperature;

mod effect;
mod envelope;
mod expected;
mod file;
mod formula;
mod half_models;
mod identified_with;
mod inputs;
mod linear;
mod matrix;
pub mod network;
pub(crate) mod seals;
mod stand_ins;
pub(crate) mod uniform_temperature;

/// All kinds of models. A new kind needs a file next to the others and an entry in this list.
const KINDS: [&KindOfModel; 4] = [&linear::KIND, &formula::KIND, &matrix::KIND, &network::KIND];

/// Kind of model: its keys, its parser and its preview.
struct KindOfModel {
    /// Word for the kind in the key `kind`.
    word: &'static str,
    /// Name with its article in messages: "a matrix".
    one: &'static str,
    /// Keys of this kind, in addition to those of every model.
    keys: &'static [&'static str],
    resolve: fn(&RawModel, &KeyContext<'_>) -> Option<Kind>,
    /// Preview of a model. `None` for a model of another kind.
    preview: fn(&Profile, &Kind) -> Option<Computation>,
    /// Positions at which the preview evaluates the model. `None` for a model without a position, or of another kind.
    places: fn(&Kind) -> Option<Places>,
}

/// Position signal of a model, with the positions at which the preview evaluates the model, mm.
type Places = (SignalId, Vec<f64>);

/// Calculation of a model as text.
#[derive(Default)]
struct Computation {
    /// Formula, for example `Cz = 2.4·(bed − 20) + 0 µm`.
    formula: String,
    /// Effect of one unit of each signal.
    effects: Vec<String>,
}

/// Calculation of Cz from signals.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Model")]
pub(crate) struct RawModel {
    /// Name of the model, shown on the web page and in the log.
    #[schemars(required)]
    pub(super) name: Option<String>,
    /// Kind of calculation.
    #[schemars(required, schema_with = "kinds")]
    kind: Option<String>,
    /// linear: Cz if every rise is zero, µm. Default 0.
    offset: Option<f64>,
    /// linear: list of terms, each a gain times a temperature rise. Cz is their sum.
    terms: Option<Vec<RawTerm>>,
    /// formula: Cz in µm, for example "Kz * (A - (b*t + c))".
    formula: Option<String>,
    /// formula: signals by their names in the formula. matrix: one temperature signal for each block (part of the
    /// machine). network: signals in the order of the network's inputs.
    inputs: Option<Inputs>,
    /// formula: constants by their names in the formula.
    constants: Option<BTreeMap<String, f64>>,
    /// linear: second sum of terms, in µm/mm. It is multiplied by the distance from a reference position.
    slope: Option<RawSlope>,
    /// matrix, network: file with the coefficients.
    file: Option<String>,
    /// File with the range of temperatures on which the model was identified.
    envelope: Option<String>,
    /// Settings of the identification; `isotherm identify` writes them.
    identified_with: Option<RawIdentifiedWith>,
    /// Action outside of the envelope. "agree" follows the model as far as its two halves agree (default). "warn" warns
    /// and follows the model. "hold" keeps Cz. "shrink" follows the model less with increasing distance.
    outside: Option<OutsideWord>,
    /// linear: file with the two halves of the model, which are sums of terms whose mean is the model. `isotherm
    /// identify` writes the file. Without the file, "agree" acts as "warn".
    halves: Option<String>,
    /// Expected error, from runs that the identification did not use. `isotherm identify` writes this key, and the web
    /// page shows the error next to Cz.
    expected: Option<RawExpected>,
    /// File that relates the sensors to each other. With the file, the gateway detects a frozen sensor, and calculates
    /// the reading of a frozen or lost one.
    stand_ins: Option<String>,
    /// SHA-256 of the model's files, by the key that names each file. A changed file is rejected. `isotherm identify`
    /// writes these keys.
    sha256: Option<RawSeals>,
    /// matrix: signal with the position of the axis, mm.
    position: Option<String>,
    /// matrix, network: reference from which rises are measured: a number, "start" or "zero". Default for a network: 0.
    reference: Option<ReferenceValue>,
    /// matrix: direction of the guideway's displacement that moves the axis in the positive direction.
    component: Option<Component>,
    /// matrix: part that the guideway carries. A positive displacement of the tool is a positive error, one of the
    /// workpiece a negative error.
    carries: Option<Carries>,
}

fn kinds(_: &mut SchemaGenerator) -> Schema {
    schemars::json_schema!({ "type": "string", "enum": KINDS.map(|kind| kind.word) })
}

impl RawModel {
    /// Resolves a model. `settle` is the averaging time of the machine's references.
    pub(super) fn resolve(&self, at: &KeyContext<'_>, settle: Option<Timespan>) -> Option<Model> {
        let own = KINDS.into_iter().find(|known| Some(known.word) == self.kind.as_deref())?;
        for kind in KINDS {
            for key in kind.keys.iter().filter(|key| !own.keys.contains(key)) {
                // If several kinds have the key, the first one reports it.
                if owners(key).next().is_some_and(|first| first.word == kind.word) {
                    at.not_applicable(&[key], &listed(key), "remove this key, or change `kind`");
                }
            }
        }
        if let Some(identified_with) = &self.identified_with {
            identified_with.doubt(&at.key("identified_with"), settle);
        }
        if let Some(seals) = &self.sha256 {
            seals.check(self, at);
        }
        let kind = (own.resolve)(self, at);
        let model = self.name.clone().zip(kind).map(|(name, kind)| Model::new(name, kind));
        let expected = optional(self.expected.as_ref(), |raw| raw.resolve(&at.key("expected")));
        let place = at.key("stand_ins");
        let stand_ins = optional(self.stand_ins.as_deref(), |name| stand_ins::resolve(self, &place, name));
        let envelope = envelope::resolve(self, at, model.as_ref())?;
        Some(Model { envelope, expected: expected?, stand_ins: stand_ins?, ..model? })
    }

    pub(super) fn may_be_linear(&self) -> bool {
        self.kind.as_deref().is_none_or(|kind| kind == linear::KIND.word)
    }

    /// Returns whether a term has the reference "zero": its rise is measured from the temperature at the last zero
    /// command.
    pub(super) fn has_term_at_zero(&self) -> bool {
        let of_slope = self.slope.iter().flat_map(RawSlope::terms);
        self.terms.iter().flatten().chain(of_slope).any(RawTerm::is_at_zero)
    }

    /// Returns whether an input has the reference "zero": its rise is measured from the value at the last zero command.
    pub(super) fn has_input_at_zero(&self) -> bool {
        self.inputs.as_ref().is_some_and(|inputs| inputs.are_at_zero(self.reference))
    }
}

/// Preview of a model: its calculation, and the range in which the model is valid. `place` is its index in the list of
/// the axis.
pub(super) fn preview(
    profile: &Profile,
    place: usize,
    model: &Model,
    all_over: &[UniformTemperature],
) -> Section {
    let kind = KINDS.into_iter().find_map(|kind| (kind.preview)(profile, &model.kind));
    let Computation { formula, effects } = kind.unwrap_or_default();
    let mut section = Section::default();
    section.line(format!("  {}. {}: {formula}", place + 1, model.name));
    section.lines("     ", &effects);
    entries!(section, name = &model.name, formula, effects);
    uniform_temperature::preview(&mut section, profile, model, all_over);
    let parts = [
        ("envelope", model.envelope.as_ref().map(|envelope| envelope::preview(profile, envelope))),
        ("expected", model.expected.as_ref().map(expected::preview)),
        ("stand_ins", model.stand_ins.as_ref().map(|stand_ins| stand_ins::preview(profile, stand_ins))),
    ];
    for (key, text) in parts.into_iter().filter_map(|(key, text)| Some((key, text?))) {
        section.line(format!("     {text}"));
        section.entry(key, text);
    }
    section
}

fn owners(key: &str) -> impl Iterator<Item = &'static KindOfModel> {
    KINDS.into_iter().filter(move |kind| kind.keys.contains(&key))
}

/// Lists the kinds that have a key: `a formula, a matrix or a network`.
fn listed(key: &str) -> String {
    let owners: Vec<&str> = owners(key).map(|kind| kind.one).collect();
    match owners.as_slice() {
        [before @ .., last] if !before.is_empty() => format!("{} or {last}", before.join(", ")),
        other => other.concat(),
    }
}
