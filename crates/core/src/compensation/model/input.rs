//! One input of a matrix, a network or an envelope: a signal, what its rise is measured from, and how late it acts.

use std::time::Duration;

use super::{Known, Lag, Term, Unusable};
use crate::compensation::reference::Reference;
use crate::reading::SignalId;

/// A signal less its reference, at once or behind a lag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    /// A temperature, a position, a speed.
    pub signal: SignalId,
    /// What is taken off it; the number 0 leaves the value itself.
    pub reference: Reference,
    /// Time constant of a first-order lag, above zero; `None`: the rise acts at once. An envelope's inputs have none.
    pub lag: Option<Duration>,
}

impl Input {
    /// The rise itself as a term.
    pub(super) fn term(&self) -> Term {
        Term { signal: self.signal, gain: 1.0, reference: self.reference, lag: self.lag }
    }

    /// The rise now, in the signal's unit; behind its lag, where it has one.
    ///
    /// # Errors
    /// The signal cannot be used, or its reference has not been captured.
    pub fn rise(&self, known: &Known<'_>, lag: &Lag) -> Result<f64, Unusable> {
        self.term().rise(known, lag)
    }
}
