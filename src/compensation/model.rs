//! The models: from a snapshot to a raw Cz. Each kind is one file behind [`Evaluate`].

use crate::reading::SignalId;

pub mod envelope;
pub mod network;

mod formula;
mod input;
mod linear;
mod matrix;

pub use envelope::{Beyond, Envelope, Extrapolation, Outside};
pub use formula::{Condition, Expression, ExpressionError, Formula, Symbol};
pub use input::Input;
pub use linear::{Linear, Reference, Term};
pub use matrix::Matrix;
pub use network::Network;

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

/// What a model wants, its envelope considered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// Cz in µm, finite; where the envelope shrinks, by so much.
    pub value: f64,
    /// How far the machine is from what the model was identified on; `None` inside.
    pub extrapolating: Option<Extrapolation>,
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

/// What every kind of model can do.
pub trait Evaluate {
    /// The compensation value in µm, from good readings only.
    ///
    /// # Errors
    /// What is missing.
    fn evaluate(&self, snapshot: &Snapshot<'_>, machine: &Machine) -> Result<f64, Unusable>;

    /// The signals it needs.
    fn inputs(&self) -> Vec<SignalId>;
}

impl Model {
    /// What it wants now, its envelope considered.
    ///
    /// # Errors
    /// What is missing.
    pub fn wants(&self, snapshot: &Snapshot<'_>, machine: &Machine) -> Result<Wanted, Unusable> {
        let value = self.evaluate(snapshot, machine)?;
        let outside = match &self.envelope {
            Some(envelope) => envelope.look(snapshot, machine)?,
            None => None,
        };
        let extrapolating = outside.or_else(|| match &self.kind {
            Kind::Matrix(matrix) => matrix.beyond(snapshot),
            _ => None,
        });
        let gain = extrapolating.map_or(1.0, |outside| outside.gain);
        Ok(Wanted { value: value * gain, extrapolating })
    }
}

impl Evaluate for Model {
    fn evaluate(&self, snapshot: &Snapshot<'_>, machine: &Machine) -> Result<f64, Unusable> {
        let value = match &self.kind {
            Kind::Linear(linear) => linear.evaluate(snapshot, machine),
            Kind::Formula(formula) => formula.evaluate(snapshot, machine),
            Kind::Matrix(matrix) => matrix.evaluate(snapshot, machine),
            Kind::Network(network) => network.evaluate(snapshot, machine),
        }?;
        if value.is_finite() { Ok(value) } else { Err(Unusable::NotANumber) }
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
