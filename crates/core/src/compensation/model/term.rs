//! One term of a sum over temperature rises.

use std::ops::Mul;

use super::{Input, Inputs, Lag, Unusable};
use crate::quantity::{Celsius, MicronPerCelsius};

/// Term of a sum: gain times rise of an input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term<Gain = MicronPerCelsius> {
    /// Input of the term.
    pub input: Input,
    /// Contribution of a rise of one unit, or of its square, to the sum.
    pub gain: Gain,
}

impl<Gain: Mul<Celsius, Output = f64> + Copy> Term<Gain> {
    /// Returns the contribution to the sum now.
    #[inline]
    pub(super) fn part(&self, lag: &Lag, inputs: &Inputs<'_>) -> Result<f64, Unusable> {
        Ok(self.gain * self.input.rise(inputs, lag)?)
    }
}
