//! The models: from a snapshot to a raw Cz. Each kind is one file behind [`Evaluate`].

use crate::reading::SignalId;

mod formula;
mod linear;

pub use formula::{Condition, Expression, ExpressionError, Formula, Symbol};
pub use linear::{Linear, Reference, Term};

use super::Snapshot;
use super::reference::Machine;

/// A model with the name the profile gives it.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// For people: the page, the log, `z_model`.
    pub name: String,
    /// How it computes.
    pub kind: Kind,
}

/// The kinds of models.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// A sum of gains times temperature rises.
    Linear(Linear),
    /// An expression over temperatures and machine-on time.
    Formula(Formula),
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

impl Evaluate for Model {
    fn evaluate(&self, snapshot: &Snapshot<'_>, machine: &Machine) -> Result<f64, Unusable> {
        let value = match &self.kind {
            Kind::Linear(linear) => linear.evaluate(snapshot, machine),
            Kind::Formula(formula) => formula.evaluate(snapshot, machine),
        }?;
        if value.is_finite() { Ok(value) } else { Err(Unusable::NotANumber) }
    }

    fn inputs(&self) -> Vec<SignalId> {
        match &self.kind {
            Kind::Linear(linear) => linear.inputs(),
            Kind::Formula(formula) => formula.inputs(),
        }
    }
}
