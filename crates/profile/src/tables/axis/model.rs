//! `[[axis.*.model]]`: models of an axis.

use crate::document::{Section, entries};
use crate::duration::Timespan;
use crate::tables::signal::Signal;
use crate::tables::{KeyContext, optional};
use isotherm_core::compensation::model::Model;
use kind::{Computation, KindOfModel};
use uniform_temperature::UniformTemperature;

pub(super) use raw::RawModel;

pub(super) mod effect;
mod envelope;
mod expected;
mod file;
mod formula;
mod half_models;
mod identified_with;
mod inputs;
mod kind;
mod linear;
mod matrix;
pub mod network;
mod raw;
mod seals;
mod stand_ins;
pub(crate) mod uniform_temperature;

/// All kinds of models. A new kind of model needs its own file in this directory, an entry in this list, and its keys
/// in `raw.rs`.
const KINDS: [&KindOfModel; 4] = [&linear::KIND, &formula::KIND, &matrix::KIND, &network::KIND];

impl RawModel {
    /// Resolves a model. `settle` is the averaging time of references, from the table `[machine]`.
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
            seals.check([&self.file, &self.envelope, &self.halves, &self.stand_ins], at);
        }
        let kind = (own.resolve)(self, at);
        let model = self.name.clone().zip(kind).map(|(name, kind)| Model::new(name, kind));
        let expected = optional(self.expected.as_ref(), |raw| raw.resolve(&at.key("expected")));
        let place = at.key("stand_ins");
        let (seals, named) = (self.sha256.as_ref(), self.stand_ins.as_deref());
        let stand_ins = optional(named, |name| stand_ins::resolve(seals, &place, name));
        let envelope = envelope::resolve(self, at, model.as_ref())?;
        Some(Model { envelope, expected: expected?, stand_ins: stand_ins?, ..model? })
    }
}

/// Returns the preview of a model: its formula and effects, and the range in which the model is valid.
/// `place` is its index among the models of the axis.
pub(super) fn preview(
    signals: &[Signal],
    place: usize,
    model: &Model,
    all_over: &mut [UniformTemperature],
) -> Section {
    let kind = KINDS.into_iter().find_map(|kind| (kind.preview)(signals, &model.kind));
    let Computation { formula, effects } = kind.unwrap_or_default();
    let mut section = Section::default();
    section.line(format!("  {}. {}: {formula}", place + 1, model.name));
    section.lines("     ", &effects);
    entries!(section, name = &model.name, formula, effects);
    uniform_temperature::preview(&mut section, signals, model, all_over);
    let parts = [
        ("envelope", model.envelope.as_ref().map(|envelope| envelope::preview(signals, envelope))),
        ("expected", model.expected.as_ref().map(expected::preview)),
        ("stand_ins", model.stand_ins.as_ref().map(|stand_ins| stand_ins::preview(signals, stand_ins))),
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

/// Lists the kinds of models that have this key: `a formula, a matrix or a network`.
fn listed(key: &str) -> String {
    let owners: Vec<&str> = owners(key).map(|kind| kind.one).collect();
    match owners.as_slice() {
        [before @ .., last] if !before.is_empty() => format!("{} or {last}", before.join(", ")),
        other => other.concat(),
    }
}
