//! One input of a matrix or a network: a signal, and what its rise is measured from.

use super::{Known, Reference, Unusable};
use crate::reading::SignalId;

/// A signal less its reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    /// A temperature, a position, a speed.
    pub signal: SignalId,
    /// What is taken off it; the number 0 leaves the value itself.
    pub reference: Reference,
}

impl Input {
    /// The rise now, in the signal's unit.
    ///
    /// # Errors
    /// The signal cannot be used, or its reference has not been captured.
    pub fn rise(&self, known: &Known<'_>) -> Result<f64, Unusable> {
        let value = known.snapshot.value(self.signal).ok_or(Unusable::Signal(self.signal))?;
        let reference =
            known.machine.captured(self.reference, self.signal).ok_or(Unusable::Reference(self.signal))?;
        Ok(value - reference.value)
    }
}
