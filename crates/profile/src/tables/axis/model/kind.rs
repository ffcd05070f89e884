//! Kinds of models, for example linear models and networks.

use super::raw::RawModel;
use crate::tables::KeyContext;
use crate::tables::signal::Signal;
use isotherm_core::compensation::model::Kind;
use isotherm_core::reading::SignalId;

/// Kind of model: its word in the profile, its keys, its parser and its preview.
pub(super) struct KindOfModel {
    /// Value of the key `kind` for this kind of model.
    pub(super) word: &'static str,
    /// Name of the kind with its article, for messages: "a matrix".
    pub(super) one: &'static str,
    /// Keys that models of this kind may have, in addition to the keys that every model may have.
    pub(super) keys: &'static [&'static str],
    pub(super) resolve: fn(&RawModel, &KeyContext<'_>) -> Option<Kind>,
    /// Returns the calculation of a model as text for the preview. `None` for a model of another kind.
    pub(super) preview: fn(&[Signal], &Kind) -> Option<Computation>,
    /// Returns the positions at which the output of `isotherm check` evaluates the model. `None` if the model does not
    /// depend on a position, or is not of this kind.
    pub(super) places: fn(&Kind) -> Option<Places>,
}

/// Position signal of a model, and the positions in mm at which the preview evaluates the model.
pub(super) type Places = (SignalId, Vec<f64>);

/// Calculation of a model, as text for the preview.
#[derive(Default)]
pub(super) struct Computation {
    /// Formula, for example `Cz = 2.4·(bed − 20) + 0 µm`.
    pub(super) formula: String,
    /// Sentences about the effect of each signal on Cz if the signal changes by one unit.
    pub(super) effects: Vec<String>,
}
