//! The models: from a snapshot to a raw Cz. Each kind is one file behind [`Evaluate`].

use crate::reading::SignalId;

mod formula;
mod lag;
mod linear;

pub use formula::{Condition, Expression, ExpressionError, Formula, Symbol};
pub use lag::{Lag, Lagged};
pub use linear::{Linear, Reference, Slope, Term};

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
    /// Its terms, those of the slope last.
    pub fn terms(&self) -> impl Iterator<Item = &Term> {
        let linear = match &self.kind {
            Kind::Linear(linear) => Some(linear),
            Kind::Formula(_) => None,
        };
        linear.into_iter().flat_map(Linear::all_terms)
    }
}

impl Evaluate for Model {
    fn evaluate(&self, known: &Known<'_>) -> Result<Asked, Unusable> {
        let asked = match &self.kind {
            Kind::Linear(linear) => linear.evaluate(known),
            Kind::Formula(formula) => formula.evaluate(known),
        }?;
        let is_number = asked.cz.is_finite() && asked.slope.is_finite();
        if is_number { Ok(asked) } else { Err(Unusable::NotANumber) }
    }

    fn inputs(&self) -> Vec<SignalId> {
        match &self.kind {
            Kind::Linear(linear) => linear.inputs(),
            Kind::Formula(formula) => formula.inputs(),
        }
    }
}
