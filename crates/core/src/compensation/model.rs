//! The models: from a snapshot to a raw Cz. Each kind is one file behind [`Evaluate`], and one line in `Kind::model`.

use crate::reading::SignalId;

pub mod envelope;
pub mod network;
pub mod stand_ins;

mod expected;
mod formula;
mod input;
mod lag;
mod linear;
mod matrix;
mod term;

pub use super::reference::Reference;
pub use envelope::{Beyond, CLEARLY_INSIDE, Coverage, Envelope, Extrapolation, Outside};
pub use expected::{Expected, Growth};
pub use formula::{Condition, Expression, ExpressionError, Formula, Symbol};
pub use input::{Input, Rises};
pub use lag::{Lag, Lagged, TimeConstant};
pub use linear::{Linear, Slope};
pub use matrix::Matrix;
pub use network::Network;
pub use stand_ins::StandIns;
pub use term::Term;

use serde::{Deserialize, Serialize};

use super::Snapshot;
use super::instead::Instead;
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
    /// How wrong it was on runs that it had not seen, where the profile says so.
    pub expected: Option<Expected>,
    /// What its sensors say of each other, where the profile names a file of it.
    pub stand_ins: Option<StandIns>,
}

/// The kinds of models. A new one is a file beside the others, a variant here and its line in `Kind::model`.
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

impl Kind {
    /// What computes.
    fn model(&self) -> &dyn Evaluate {
        match self {
            Kind::Linear(model) => model,
            Kind::Formula(model) => model,
            Kind::Matrix(model) => model,
            Kind::Network(model) => model,
        }
    }
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

    /// What may lag, in order, one [`Lag`] for each.
    fn lagging(&self) -> Rises<'_> {
        Rises::default()
    }

    /// Where the machine is on what the model has bounds for by itself; `None` where it has none.
    fn coverage(&self, _: &Snapshot<'_>) -> Option<Coverage> {
        None
    }

    /// Itself, where its gains can be corrected by probings.
    fn correctable(&self) -> Option<&Linear> {
        None
    }
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
    /// The reading of this signal is frozen, and nothing stands in for it.
    Frozen(SignalId),
    /// This signal reads something again, which is not believed yet.
    Unproven(SignalId),
    /// The result is not a finite number (a division by zero, a root of a negative number).
    NotANumber,
}

impl From<&Instead> for Unusable {
    /// Nobody says what is needed of this sensor.
    fn from(instead: &Instead) -> Unusable {
        if instead.frozen { Unusable::Frozen(instead.signal) } else { Unusable::Unproven(instead.signal) }
    }
}

/// What a model is evaluated from.
#[derive(Clone, Copy, Debug)]
pub struct Inputs<'a> {
    /// The readings.
    pub snapshot: Snapshot<'a>,
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
    /// What the two halves of the model differ by; zero where it has none.
    pub apart: Micron,
}

impl Outputs {
    /// Checks a computed Cz in µm and slope in µm/mm: both must be finite.
    pub(super) fn of(cz: f64, slope: f64) -> Result<Outputs, Unusable> {
        let outputs = Micron::new(cz).zip(MicronPerMillimetre::new(slope));
        outputs.map(|(cz, slope)| Outputs { cz, slope, apart: Micron::ZERO }).ok_or(Unusable::NotANumber)
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

impl Model {
    /// A model that knows no bounds.
    pub fn new(name: String, kind: Kind) -> Model {
        Model { name, kind, envelope: None, expected: None, stand_ins: None }
    }

    /// What may lag, in order, one [`Lag`] for each: the inputs of its terms, those of the slope last; of a matrix its
    /// blocks, of a network what it reads.
    pub fn rises(&self) -> impl Iterator<Item = &Input> {
        self.kind.model().lagging().into_iter()
    }

    /// The signals it needs.
    pub fn signals(&self) -> Vec<SignalId> {
        self.kind.model().signals()
    }

    /// What it asks for now, wherever its inputs lie.
    ///
    /// # Errors
    /// What is missing, or that the result is no finite number.
    pub fn outputs(&self, inputs: &Inputs<'_>) -> Result<Outputs, Unusable> {
        self.kind.model().evaluate(inputs)
    }

    /// What it asks for now, and where its inputs lie.
    ///
    /// # Errors
    /// What is missing.
    pub fn evaluate(&self, inputs: &Inputs<'_>) -> Result<Evaluated, Unusable> {
        let outputs = Outputs { apart: self.apart(inputs)?, ..self.outputs(inputs)? };
        let envelope = self.envelope.as_ref().map(|envelope| envelope.coverage(inputs)).transpose()?;
        Ok(Evaluated { outputs, coverage: worse(envelope, self.kind.model().coverage(&inputs.snapshot)) })
    }

    /// What its two halves differ by now.
    fn apart(&self, inputs: &Inputs<'_>) -> Result<Micron, Unusable> {
        let apart = self.envelope.as_ref().map_or(&[][..], Envelope::apart);
        let mut sum = 0.0;
        for ((place, term), apart) in self.correctable().iter().enumerate().zip(apart) {
            sum += apart * term.input.rise(inputs, inputs.lags.get(place).unwrap_or(&Lag::NONE))?.get();
        }
        Micron::new(sum).ok_or(Unusable::NotANumber)
    }

    /// The terms whose gains can be corrected: those of a linear model, without its slope's.
    pub fn correctable(&self) -> &[Term] {
        self.kind.model().correctable().map_or(&[], |linear| &linear.terms)
    }

    /// The terms of a linear model that is nothing but their sum: no slope, which would add what is not in them.
    pub fn sum(&self) -> &[Term] {
        let plain = self.kind.model().correctable().filter(|linear| linear.slope.is_none());
        plain.map_or(&[], |linear| &linear.terms)
    }

    /// What each of them contributes to Cz now, µm; NaN where it contributes nothing that could be used.
    pub fn parts<'a>(&'a self, inputs: Inputs<'a>) -> impl Iterator<Item = f64> + Clone + 'a {
        self.correctable().iter().enumerate().map(move |(place, term)| {
            let lag = inputs.lags.get(place).unwrap_or(&Lag::NONE);
            term.part(lag, &inputs).unwrap_or(f64::NAN)
        })
    }

    /// The offset and the gains that the profile gives a linear model.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        let linear = self.kind.model().correctable().into_iter();
        linear.flat_map(|linear| [linear.offset.get()].into_iter().chain(linear.gains()))
    }

    /// What its rises are measured from.
    pub fn references(&self) -> impl Iterator<Item = Reference> {
        self.rises().map(|input| input.reference)
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
