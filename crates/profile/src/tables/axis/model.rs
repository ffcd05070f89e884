//! `[[axis.*.model]]`: one way to compute Cz.

use std::collections::BTreeMap;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use crate::Profile;
use crate::document::Section;
use crate::tables::At;
use all_over::AllOver;
use envelope::OutsideWord;
use expected::RawExpected;
use identified_with::RawIdentifiedWith;
use inputs::{Inputs, ReferenceValue};
use isotherm_core::compensation::model::{Kind, Model};
use isotherm_core::reading::SignalId;
use linear::{RawSlope, RawTerm};
use matrix::{Carries, Component};
use seals::RawSeals;

pub(crate) mod all_over;
mod effect;
mod envelope;
mod expected;
mod file;
mod formula;
mod halves;
mod identified_with;
mod inputs;
mod linear;
mod matrix;
pub mod network;
pub(crate) mod seals;
mod stand_ins;

/// Every kind of model. A new one is a file beside the others and a line here.
const KINDS: [&KindOfModel; 4] = [&linear::KIND, &formula::KIND, &matrix::KIND, &network::KIND];

/// A kind of model, as a profile knows it.
struct KindOfModel {
    /// The word in `kind`.
    word: &'static str,
    /// As a message names one: "a matrix".
    one: &'static str,
    /// The keys that belong to it, beside those of every model.
    keys: &'static [&'static str],
    resolve: fn(&RawModel, &At<'_>) -> Option<Kind>,
    /// `None` for a model of another kind.
    preview: fn(&Profile, &Kind) -> Option<Computation>,
    /// `None` for a model that knows no position, or of another kind.
    places: fn(&Kind) -> Option<Places>,
}

/// The signal of the position that a model depends on, and where the axis may be, mm.
type Places = (SignalId, Vec<f64>);

/// What a model computes, in words.
#[derive(Default)]
struct Computation {
    /// `Cz = 2.4·(bed − 20) + 0 µm`.
    formula: String,
    /// What one unit more of each signal does.
    effects: Vec<String>,
}

/// One way to compute Cz.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Model")]
pub(crate) struct RawModel {
    /// For people: the page and the log say which model is used.
    #[schemars(required)]
    pub(super) name: Option<String>,
    /// How it computes.
    #[schemars(required, schema_with = "kinds")]
    kind: Option<String>,
    /// linear: Cz where every rise is zero, µm. Default 0.
    offset: Option<f64>,
    /// linear: gains times temperature rises, added up.
    terms: Option<Vec<RawTerm>>,
    /// formula: Cz in µm, as "Kz * (A - (b*t + c))".
    formula: Option<String>,
    /// formula: names and the signals they stand for; matrix: one signal per block; network: the signals in its order.
    inputs: Option<Inputs>,
    /// formula: names and their numbers.
    constants: Option<BTreeMap<String, f64>>,
    /// linear: a second sum of terms that grows with the distance from a reference position, µm/mm.
    slope: Option<RawSlope>,
    /// matrix, network: the file with the coefficients.
    file: Option<String>,
    /// A file with the temperatures the model was identified on.
    envelope: Option<String>,
    /// How it was identified; `isotherm identify` writes it.
    identified_with: Option<RawIdentifiedWith>,
    /// What the axis does outside its envelope: agree: follow the model as far as its halves agree (default); warn: follow it;
    /// hold: keep Cz; shrink: follow it less and less.
    outside: Option<OutsideWord>,
    /// linear: a file with the two sums whose mean the model is; `isotherm identify` writes it. Without it `agree` is `warn`.
    halves: Option<String>,
    /// How wrong it was on runs that it had not seen; `isotherm identify` writes it, and the page shows it beside Cz.
    expected: Option<RawExpected>,
    /// A file with what the sensors say of each other: finds one that is frozen, and stands in for one that is frozen or lost.
    stand_ins: Option<String>,
    /// The SHA-256 of its files, by the key that names each: one that was changed is refused; `isotherm identify` writes it.
    sha256: Option<RawSeals>,
    /// matrix: the signal with the position of the axis, mm.
    position: Option<String>,
    /// matrix, network: what rises are measured from: a number, "start" or "zero". A network's default is 0.
    reference: Option<ReferenceValue>,
    /// matrix: the component of the guideway's displacement along the axis, as it moves the axis to plus.
    component: Option<Component>,
    /// matrix: what the guideway carries: displaced to plus, a tool is too far in plus, the work too far in minus.
    carries: Option<Carries>,
}

fn kinds(_: &mut SchemaGenerator) -> Schema {
    schemars::json_schema!({ "type": "string", "enum": KINDS.map(|kind| kind.word) })
}

impl RawModel {
    pub(super) fn resolve(&self, at: &At<'_>) -> Option<Model> {
        let own = KINDS.into_iter().find(|known| Some(known.word) == self.kind.as_deref())?;
        for kind in KINDS {
            for key in kind.keys.iter().filter(|key| !own.keys.contains(key)) {
                // Of those that several kinds have, the first one speaks.
                if owners(key).next().is_some_and(|first| first.word == kind.word) {
                    at.foreign(&[key], &listed(key), "remove it, or change `kind`");
                }
            }
        }
        if let Some(identified_with) = &self.identified_with {
            identified_with.doubt(&at.key("identified_with"));
        }
        if let Some(seals) = &self.sha256 {
            seals.check(self, at);
        }
        let kind = (own.resolve)(self, at);
        let model = self.name.clone().zip(kind).map(|(name, kind)| Model::new(name, kind));
        let expected = match &self.expected {
            Some(expected) => expected.resolve(&at.key("expected")).map(Some),
            None => Some(None),
        };
        let stand_ins =
            self.stand_ins.as_deref().map(|name| stand_ins::resolve(self, &at.key("stand_ins"), name));
        let envelope = envelope::resolve(self, at, model.as_ref())?;
        let stand_ins = stand_ins.map_or(Some(None), |found| found.map(Some))?;
        Some(Model { envelope, expected: expected?, stand_ins, ..model? })
    }

    fn seals(&self) -> Option<&RawSeals> {
        self.sha256.as_ref()
    }

    /// The file that this key names.
    fn file_of(&self, key: &str) -> Option<&str> {
        match key {
            "file" => self.file.as_deref(),
            "envelope" => self.envelope.as_deref(),
            "halves" => self.halves.as_deref(),
            "stand_ins" => self.stand_ins.as_deref(),
            _ => None,
        }
    }

    pub(super) fn may_be_linear(&self) -> bool {
        self.kind.as_deref().is_none_or(|kind| kind == linear::KIND.word)
    }

    /// Whether a term's rise is measured from its temperature at zero.
    pub(super) fn has_term_at_zero(&self) -> bool {
        let of_slope = self.slope.iter().flat_map(RawSlope::terms);
        self.terms.iter().flatten().chain(of_slope).any(RawTerm::is_at_zero)
    }

    /// Whether the rise of an input of a file is measured from its value at zero.
    pub(super) fn has_input_at_zero(&self) -> bool {
        self.inputs.as_ref().is_some_and(|inputs| inputs.are_at_zero(self.reference))
    }
}

/// What the model in this place of an axis's list computes, and where that holds.
pub(super) fn preview(profile: &Profile, place: usize, model: &Model, all_over: &[AllOver]) -> Section {
    let kind = KINDS.into_iter().find_map(|kind| (kind.preview)(profile, &model.kind));
    let Computation { formula, effects } = kind.unwrap_or_default();
    let mut section = Section::default();
    section.line(format!("  {}. {}: {formula}", place + 1, model.name));
    section.lines("     ", &effects);
    section.entry("name", &model.name);
    section.entry("formula", formula);
    section.entry("effects", effects);
    all_over::preview(&mut section, profile, model, all_over);
    if let Some(envelope) = &model.envelope {
        let envelope = envelope::preview(profile, envelope);
        section.line(format!("     {envelope}"));
        section.entry("envelope", envelope);
    }
    if let Some(expected) = &model.expected {
        let expected = expected::preview(expected);
        section.line(format!("     {expected}"));
        section.entry("expected", expected);
    }
    if let Some(stand_ins) = &model.stand_ins {
        let stand_ins = stand_ins::preview(profile, stand_ins);
        section.line(format!("     {stand_ins}"));
        section.entry("stand_ins", stand_ins);
    }
    section
}

fn owners(key: &str) -> impl Iterator<Item = &'static KindOfModel> {
    KINDS.into_iter().filter(move |kind| kind.keys.contains(&key))
}

/// `a formula, a matrix or a network`.
fn listed(key: &str) -> String {
    let owners: Vec<&str> = owners(key).map(|kind| kind.one).collect();
    match owners.as_slice() {
        [before @ .., last] if !before.is_empty() => format!("{} or {last}", before.join(", ")),
        other => other.concat(),
    }
}
