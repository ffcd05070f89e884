//! Term of a sum over temperature rises: a gain times the rise of an input.

use std::ops::Mul;

use super::{Input, Inputs, Lag, Unusable};
use crate::quantity::{Celsius, MicronPerCelsius};

/// Term of a sum: gain times rise of an input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term<Gain = MicronPerCelsius> {
    /// Input whose rise is multiplied by the gain.
    pub input: Input,
    /// Contribution to the sum if the rise of the input is one unit.
    pub gain: Gain,
}

impl<Gain: Mul<Celsius, Output = f64> + Copy> Term<Gain> {
    /// Returns the present contribution of the term to the sum.
    #[inline]
    pub(super) fn part(&self, lag: &Lag, inputs: &Inputs<'_>) -> Result<f64, Unusable> {
        Ok(self.gain * self.input.rise(inputs, lag)?)
    }
}
