//! Models, which compute a raw Cz (compensation value of an axis) from a snapshot of the machine. Each kind is one file
//! with an implementation of [`Evaluate`], and one line in `Kind::model`.

pub mod envelope;
pub mod network;
pub mod stand_ins;

mod contribution;
mod evaluate;
mod expected;
mod formula;
mod input;
mod lag;
mod linear;
mod matrix;
mod term;
mod unusable;

pub use super::reference::Reference;
pub use contribution::Contribution;
pub use envelope::{Beyond, CLEARLY_INSIDE, Coverage, Envelope, Extrapolation, Outside};
pub use evaluate::{Evaluate, Outputs};
pub use expected::{Expected, Growth};
pub use formula::{Condition, Expression, ExpressionError, Formula, Symbol};
pub use input::{Input, Inputs, Rises};
pub use lag::{Lag, Lagged, TimeConstant};
pub use linear::{Linear, Slope};
pub use matrix::Matrix;
pub use network::Network;
pub use stand_ins::StandIns;
pub use term::Term;
pub use unusable::Unusable;

use crate::quantity::Micron;
use crate::reading::SignalId;

/// One model of an axis: its name, its kind with the numbers, and its properties from the profile, such as its
/// envelope.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Name of the model in the profile, on the web page, and in the log (column `z_model` for an axis z).
    pub name: String,
    /// Kind of the model (linear, formula, matrix or network), with its numbers.
    pub kind: Kind,
    /// Region on which the model was identified, if the profile states a region.
    pub envelope: Option<Envelope>,
    /// Residual error on runs that were not used to identify the model, if the profile gives it.
    pub expected: Option<Expected>,
    /// Predictions of the model's sensors from each other, if the profile names a file with such predictions.
    pub stand_ins: Option<StandIns>,
}

/// Kinds of models. A new kind is a file next to the others, a variant of this enum, and a line in `Kind::model`.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// A sum of gains times temperature rises.
    Linear(Linear),
    /// An expression over temperatures and the time since machine start.
    Formula(Formula),
    /// Displacements of a guideway from the temperatures of the blocks, parts of the machine's structure with one
    /// temperature each.
    Matrix(Matrix),
    /// A network of neurons or radial basis functions.
    Network(Network),
}

impl Kind {
    /// Returns the implementation of this kind of model.
    fn model(&self) -> &dyn Evaluate {
        match self {
            Kind::Linear(model) => model,
            Kind::Formula(model) => model,
            Kind::Matrix(model) => model,
            Kind::Network(model) => model,
        }
    }
}

/// Values that a model requests, and the position of the inputs in its envelope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluated {
    /// Values of the model itself, before the envelope reduces them.
    pub outputs: Outputs,
    /// Position of the machine inside or outside the range on which the model was identified; `None` if it is unknown.
    pub coverage: Option<Coverage>,
}

impl Model {
    /// Creates a model without envelope, expected error and stand-ins.
    pub fn new(name: String, kind: Kind) -> Model {
        Model { name, kind, envelope: None, expected: None, stand_ins: None }
    }

    /// Returns the inputs that may have a lag, in the order of their [`Lag`]s. A linear model returns the
    /// inputs of its terms, then the inputs of its slope's terms. A matrix returns the inputs of its blocks
    /// (parts of the structure), a network all its inputs.
    pub fn rises(&self) -> impl Iterator<Item = &Input> {
        self.kind.model().lagging().into_iter()
    }

    /// Returns the signals that the model requires.
    pub fn signals(&self) -> Vec<SignalId> {
        self.kind.model().signals()
    }

    /// Returns the values that the model requests now, without regard to its envelope.
    ///
    /// # Errors
    /// Returns which input has no value, or that the result is not finite.
    pub fn outputs(&self, inputs: &Inputs<'_>) -> Result<Outputs, Unusable> {
        self.kind.model().evaluate(inputs)
    }

    /// Returns the values that the model requests now, and the position of its inputs in the envelope.
    ///
    /// # Errors
    /// Returns which input has no value, or that the result is not finite.
    pub fn evaluate(&self, inputs: &Inputs<'_>) -> Result<Evaluated, Unusable> {
        let outputs = Outputs { apart: self.apart(inputs)?, ..self.outputs(inputs)? };
        let envelope = self.envelope.as_ref().map(|envelope| envelope.coverage(inputs)).transpose()?;
        Ok(Evaluated { outputs, coverage: worse(envelope, self.kind.model().coverage(&inputs.snapshot)) })
    }

    /// Returns the difference of Cz between the model's two halves (the two models whose mean is this model).
    fn apart(&self, inputs: &Inputs<'_>) -> Result<Micron, Unusable> {
        let apart = self.envelope.as_ref().map_or(&[][..], Envelope::apart);
        let mut sum = 0.0;
        for ((place, term), apart) in self.correctable().iter().enumerate().zip(apart) {
            sum += apart * term.input.rise(inputs, inputs.lags.get(place).unwrap_or(&Lag::NONE))?.get();
        }
        Micron::new(sum).ok_or(Unusable::NotANumber)
    }

    /// Returns the terms whose gains probings can correct: the terms of a linear model, without the terms of its slope.
    /// Empty for other models.
    pub fn correctable(&self) -> &[Term] {
        self.kind.model().correctable().map_or(&[], |linear| &linear.terms)
    }

    /// Returns the terms of a linear model without slope, whose sum with the offset is Cz. Returns an empty list for
    /// any other model, because a slope adds a value that is not in the terms.
    pub fn sum(&self) -> &[Term] {
        let plain = self.kind.model().correctable().filter(|linear| linear.slope.is_none());
        plain.map_or(&[], |linear| &linear.terms)
    }

    /// Returns the present contribution to Cz of each term that probings can correct, µm. A term without a usable value
    /// gives NaN.
    pub fn parts<'a>(&'a self, inputs: Inputs<'a>) -> impl Iterator<Item = f64> + Clone + 'a {
        self.correctable().iter().enumerate().map(move |(place, term)| {
            let lag = inputs.lags.get(place).unwrap_or(&Lag::NONE);
            term.part(lag, &inputs).unwrap_or(f64::NAN)
        })
    }

    /// Returns the offset and the gains of a linear model, as the profile gives them. A saved state of the model is
    /// used only if these numbers are still the same.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        let linear = self.kind.model().correctable().into_iter();
        linear.flat_map(|linear| [linear.offset.get()].into_iter().chain(linear.gains()))
    }

    /// Returns the reference of each input that may lag, in the order of [`Model::rises`].
    pub fn references(&self) -> impl Iterator<Item = Reference> {
        self.rises().map(|input| input.reference)
    }
}

/// Returns the coverage (position of the inputs inside or outside the identified region) that the axis uses. This is
/// the coverage of the envelope, unless there is no envelope or only the end of the guideway is exceeded.
fn worse(envelope: Option<Coverage>, guideway: Option<Coverage>) -> Option<Coverage> {
    match (envelope, guideway) {
        (Some(inside), Some(beyond)) if inside.extrapolating.is_none() && beyond.extrapolating.is_some() => {
            guideway
        }
        _ => envelope.or(guideway),
    }
}
