//! Interface of every kind of model, and the values that a model requests.

use super::{Coverage, Inputs, Linear, Rises, Unusable};
use crate::compensation::Snapshot;
use crate::quantity::{Micron, MicronPerMillimetre};
use crate::reading::SignalId;

/// Interface of every kind of model: the values that a model requests, its signals, and its inputs that may
/// have a lag.
pub trait Evaluate {
    /// Returns the values that the model requests. Only good readings and stand-ins are used.
    ///
    /// # Errors
    /// Returns which input has no value, or that the result is not finite.
    fn evaluate(&self, inputs: &Inputs<'_>) -> Result<Outputs, Unusable>;

    /// Returns the signals that the model requires.
    fn signals(&self) -> Vec<SignalId>;

    /// Returns the inputs that may have a lag, in the order of their [`Lag`](super::Lag)s.
    fn lagging(&self) -> Rises<'_> {
        Rises::default()
    }

    /// Returns the position of the machine relative to bounds that this kind of model has itself, for example the ends
    /// of a guideway. `None` if the kind of model has no bounds.
    fn coverage(&self, _: &Snapshot<'_>) -> Option<Coverage> {
        None
    }

    /// Returns the linear model whose gains can be corrected by probings; `None` for other kinds.
    fn correctable(&self) -> Option<&Linear> {
        None
    }
}

/// Values that a model requests: Cz, and the slope if the control applies it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outputs {
    /// Cz at the present position. If the control applies the slope itself, it is K0: Cz at the reference position.
    pub cz: Micron,
    /// Slope tanβ if the control applies the slope itself, else zero.
    pub slope: MicronPerMillimetre,
    /// Difference of Cz between the model's two halves (the two models whose mean is this model); zero if the model is
    /// not the mean of two models.
    pub apart: Micron,
}

impl Outputs {
    /// Creates the outputs from a computed Cz in µm and slope in µm/mm. Returns [`Unusable::NotANumber`] if one of the
    /// two numbers is not finite.
    pub(in crate::compensation) fn of(cz: f64, slope: f64) -> Result<Outputs, Unusable> {
        let outputs = Micron::new(cz).zip(MicronPerMillimetre::new(slope));
        outputs.map(|(cz, slope)| Outputs { cz, slope, apart: Micron::ZERO }).ok_or(Unusable::NotANumber)
    }
}
