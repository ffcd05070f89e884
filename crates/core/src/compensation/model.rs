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
pub use envelope::{Beyond, CLEARLY_INSIDE, Coverage, Envelope, Extrapolation, Outside};
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
use crate::quantity::{Micron, MicronPerMillimetre};

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
    /// An expression over temperatures and the time since machine start.
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
    /// The machine has not been seen running: there is no time since its start.
    MachineOff,
    /// The result is not a finite number (a division by zero, a root of a negative number).
    NotANumber,
}

/// What a model is evaluated from.
#[derive(Clone, Copy, Debug)]
pub struct Inputs<'a> {
    /// The readings.
    pub snapshot: &'a Snapshot<'a>,
    /// The time since machine start, and references.
    pub machine: &'a Machine,
    /// One for each of [`Model::rises`], in their order.
    pub lags: &'a [Lag],
    /// The control itself multiplies the slope by the distance: it is given both parts.
    pub splits_slope: bool,
}

/// What a model asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outputs {
    /// Cz at the present position; where the slope is split off, K0: Cz at the reference position.
    pub cz: Micron,
    /// tanβ where it is split off, else zero.
    pub slope: MicronPerMillimetre,
}

impl Outputs {
    /// Of µm and µm/mm as they were computed.
    pub(super) fn of(cz: f64, slope: f64) -> Result<Outputs, Unusable> {
        let outputs = Micron::new(cz).zip(MicronPerMillimetre::new(slope));
        outputs.map(|(cz, slope)| Outputs { cz, slope }).ok_or(Unusable::NotANumber)
    }
}

/// What a model asks for, and how far it can be trusted there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluated {
    /// As it comes from the model: where the envelope shrinks it, before that.
    pub outputs: Outputs,
    /// Where the machine is in or outside what the model was identified on; `None` where that is not known.
    pub coverage: Option<Coverage>,
}

/// What every kind of model can do.
pub trait Evaluate {
    /// The compensation value, from good readings only.
    ///
    /// # Errors
    /// What is missing, or that the result is no finite number.
    fn evaluate(&self, inputs: &Inputs<'_>) -> Result<Outputs, Unusable>;

    /// The signals it needs.
    fn signals(&self) -> Vec<SignalId>;
}

impl Model {
    /// What may lag, in order, one [`Lag`] for each: the inputs of its terms, those of the slope last; of a matrix its
    /// blocks, of a network what it reads.
    pub fn rises(&self) -> impl Iterator<Item = &Input> {
        let (linear, inputs) = match &self.kind {
            Kind::Linear(linear) => (Some(linear), &[][..]),
            Kind::Formula(_) => (None, &[][..]),
            Kind::Matrix(matrix) => (None, matrix.blocks()),
            Kind::Network(network) => (None, network.reads()),
        };
        linear.into_iter().flat_map(Linear::rises).chain(inputs)
    }

    /// What it asks for now, and where its inputs lie.
    ///
    /// # Errors
    /// What is missing.
    pub fn wants(&self, inputs: &Inputs<'_>) -> Result<Evaluated, Unusable> {
        let outputs = self.evaluate(inputs)?;
        let envelope = self.envelope.as_ref().map(|envelope| envelope.look(inputs)).transpose()?;
        let guideway = match &self.kind {
            Kind::Matrix(matrix) => matrix.coverage(inputs.snapshot),
            _ => None,
        };
        Ok(Evaluated { outputs, coverage: worse(envelope, guideway) })
    }
}

/// An envelope comes before a guideway, whose ends count only where the axis is beyond them.
fn worse(envelope: Option<Coverage>, guideway: Option<Coverage>) -> Option<Coverage> {
    match (envelope, guideway) {
        (Some(inside), Some(beyond)) if inside.extrapolating.is_none() && beyond.extrapolating.is_some() => {
            guideway
        }
        _ => envelope.or(guideway),
    }
}

impl Evaluate for Model {
    fn evaluate(&self, inputs: &Inputs<'_>) -> Result<Outputs, Unusable> {
        match &self.kind {
            Kind::Linear(linear) => linear.evaluate(inputs),
            Kind::Formula(formula) => formula.evaluate(inputs),
            Kind::Matrix(matrix) => matrix.evaluate(inputs),
            Kind::Network(network) => network.evaluate(inputs),
        }
    }

    fn signals(&self) -> Vec<SignalId> {
        match &self.kind {
            Kind::Linear(linear) => linear.signals(),
            Kind::Formula(formula) => formula.signals(),
            Kind::Matrix(matrix) => matrix.signals(),
            Kind::Network(network) => network.signals(),
        }
    }
}
