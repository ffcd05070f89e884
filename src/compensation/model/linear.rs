//! `Cz = offset + Σ gain · (T − T_ref)`: M1 and M3 of JP H07-61598 B2, and every regression on temperature rises.

use super::{Evaluate, Unusable};
use crate::compensation::Snapshot;
use crate::compensation::reference::Machine;
use crate::reading::SignalId;

/// A constant plus a sum of terms, µm.
#[derive(Clone, Debug, PartialEq)]
pub struct Linear {
    /// Cz where every rise is zero, µm.
    pub offset: f64,
    /// Added up.
    pub terms: Vec<Term>,
}

/// One gain times one rise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term {
    /// The temperature.
    pub signal: SignalId,
    /// µm per unit of the signal.
    pub gain: f64,
    /// What the rise is measured from.
    pub reference: Reference,
}

/// What ΔT is measured from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reference {
    /// A number; 0 means the temperature itself.
    Fixed(f64),
    /// The value at machine start.
    Start,
    /// The value at the last zero.
    Zero,
}

impl Evaluate for Linear {
    fn evaluate(&self, snapshot: &Snapshot<'_>, machine: &Machine) -> Result<f64, Unusable> {
        let mut sum = self.offset;
        for term in &self.terms {
            let value = snapshot.value(term.signal).ok_or(Unusable::Signal(term.signal))?;
            let reference =
                machine.reference(term.reference, term.signal).ok_or(Unusable::Reference(term.signal))?;
            sum += term.gain * (value - reference);
        }
        Ok(sum)
    }

    fn inputs(&self) -> Vec<SignalId> {
        self.terms.iter().map(|term| term.signal).collect()
    }
}
