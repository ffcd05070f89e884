//! The models: from a snapshot to a raw Cz. Each kind is one file behind [`Evaluate`].

use crate::reading::SignalId;

pub mod envelope;
pub mod network;

mod formula;
mod input;
mod lag;
mod linear;
mod matrix;
mod taught;
mod term;

pub use super::reference::Reference;
pub use envelope::{Beyond, CLEARLY_INSIDE, Envelope, Extrapolation, Outside, Place};
pub use formula::{Condition, Expression, ExpressionError, Formula, Symbol};
pub use input::Input;
pub use lag::{Lag, Lagged};
pub use linear::{Linear, Slope};
pub use matrix::Matrix;
pub use network::Network;
pub use term::Term;

use serde::{Deserialize, Serialize};

use super::Snapshot;
use super::reference::Machine;

/// A model with the name the profile gives it.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// For people: the page, the log, `z_model`.
    pub name: String,
    /// How it computes.
    pub kind: Kind,
    /// The region it was identified on, where the profile names one.
    pub envelope: Option<Envelope>,
}

/// The kinds of models.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// A sum of gains times temperature rises.
    Linear(Linear),
    /// An expression over temperatures and machine-on time.
    Formula(Formula),
    /// Displacements of a guideway from one temperature per block of the structure.
    Matrix(Matrix),
    /// A network of neurons or radial basis functions.
    Network(Network),
}

/// Why a model has no value now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unusable {
    /// This signal cannot be used.
    Signal(SignalId),
    /// The reference of this signal has not been captured yet.
    Reference(SignalId),
    /// Machine-on time has not begun: the machine has not been seen running.
    MachineOff,
    /// The result is not a finite number (a division by zero, a root of a negative number).
    NotANumber,
}

/// What a model is evaluated from.
#[derive(Clone, Copy, Debug)]
pub struct Known<'a> {
    /// The readings.
    pub snapshot: &'a Snapshot<'a>,
    /// Machine-on time and references.
    pub machine: &'a Machine,
    /// One for each of the model's terms, in their order.
    pub lags: &'a [Lag],
    /// The control itself multiplies the slope by the distance: the two parts are wanted apart.
    pub apart: bool,
}

/// What a model asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Asked {
    /// Cz at the present position, µm; where the parts are wanted apart, K0: Cz at the reference position.
    pub cz: f64,
    /// tanβ in µm/mm where the parts are wanted apart, else 0.
    pub slope: f64,
}

/// What a model asks for, and whether it knows of what it speaks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// As it comes from the model, finite: where the envelope shrinks it, before that.
    pub asked: Asked,
    /// Where the machine is in or outside what the model was identified on; `None` where that is not known.
    pub place: Option<Place>,
}

/// What every kind of model can do.
pub trait Evaluate {
    /// The compensation value, from good readings only.
    ///
    /// # Errors
    /// What is missing.
    fn evaluate(&self, known: &Known<'_>) -> Result<Asked, Unusable>;

    /// The signals it needs.
    fn inputs(&self) -> Vec<SignalId>;
}

impl Model {
    /// What may lag, in order, one [`Lag`] for each: its terms, those of the slope last; the inputs of a matrix or a
    /// network, as terms of gain 1.
    pub fn terms(&self) -> impl Iterator<Item = Term> + '_ {
        let (linear, inputs) = match &self.kind {
            Kind::Linear(linear) => (Some(linear), &[][..]),
            Kind::Formula(_) => (None, &[][..]),
            Kind::Matrix(matrix) => (None, matrix.blocks()),
            Kind::Network(network) => (None, network.reads()),
        };
        linear.into_iter().flat_map(Linear::all_terms).copied().chain(inputs.iter().map(Input::term))
    }

    /// What it asks for now, and where its inputs lie.
    ///
    /// # Errors
    /// What is missing.
    pub fn wants(&self, known: &Known<'_>) -> Result<Wanted, Unusable> {
        let asked = self.evaluate(known)?;
        let inputs = match &self.envelope {
            Some(envelope) => Some(envelope.look(known)?),
            None => None,
        };
        let guideway = match &self.kind {
            Kind::Matrix(matrix) => matrix.place(known.snapshot),
            _ => None,
        };
        Ok(Wanted { asked, place: worse(inputs, guideway) })
    }
}

/// An envelope comes before a guideway, whose ends count only where the axis is beyond them.
fn worse(inputs: Option<Place>, guideway: Option<Place>) -> Option<Place> {
    match (inputs, guideway) {
        (Some(inside), Some(beyond)) if inside.extrapolating.is_none() && beyond.extrapolating.is_some() => {
            guideway
        }
        _ => inputs.or(guideway),
    }
}

impl Evaluate for Model {
    fn evaluate(&self, known: &Known<'_>) -> Result<Asked, Unusable> {
        let asked = match &self.kind {
            Kind::Linear(linear) => linear.evaluate(known),
            Kind::Formula(formula) => formula.evaluate(known),
            Kind::Matrix(matrix) => matrix.evaluate(known),
            Kind::Network(network) => network.evaluate(known),
        }?;
        let is_number = asked.cz.is_finite() && asked.slope.is_finite();
        if is_number { Ok(asked) } else { Err(Unusable::NotANumber) }
    }

    fn inputs(&self) -> Vec<SignalId> {
        match &self.kind {
            Kind::Linear(linear) => linear.inputs(),
            Kind::Formula(formula) => formula.inputs(),
            Kind::Matrix(matrix) => matrix.inputs(),
            Kind::Network(network) => network.inputs(),
        }
    }
}
