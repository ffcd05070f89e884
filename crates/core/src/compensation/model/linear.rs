//! Linear model `Cz = offset + Σ gain · (T − T_ref) + slope · (P − P0)`. This model covers the models M1 and M3 of JP
//! H07-61598 B2, the lagged expansions of Janeczko 1989, and every regression on temperature rises.
//!
//! The slope is a second sum of gains times rises, in µm/mm, multiplied by the distance from a reference position.
//! Sources: Li, Yang, Zhang, Zhang 1998, `Δz(z1) = Δz(z0) + k·(z1 − z0)`; SINUMERIK `ΔK = K0(T) + tanβ(T)·(P − P0)`.

use std::ops::Mul;

use super::{Evaluate, Input, Inputs, Lag, Outputs, Rises, Term, Unusable};
use crate::quantity::{Celsius, Micron, MicronPerMillimetreCelsius, Millimetre};
use crate::reading::SignalId;

/// Linear model: an offset plus a sum of terms (gain times temperature rise).
#[derive(Clone, Debug, PartialEq)]
pub struct Linear {
    /// Cz of the model if every rise is zero.
    pub offset: Micron,
    /// Terms whose sum is added to the offset.
    pub terms: Vec<Term>,
    /// Part of Cz that is proportional to the distance from a reference position; `None` if the model has no such part.
    pub slope: Option<Slope>,
}

/// Part of a linear model that depends on the position: a sum of terms, µm/mm, times the distance from a reference
/// position.
#[derive(Clone, Debug, PartialEq)]
pub struct Slope {
    /// Signal of the axis position, mm.
    pub position: SignalId,
    /// Position P0 at which the slope adds nothing.
    pub reference: Millimetre,
    /// Ends of the axis's travel; `None` if unknown.
    pub travel: Option<(Millimetre, Millimetre)>,
    /// Terms whose sum is the slope, µm/mm.
    pub terms: Vec<Term<MicronPerMillimetreCelsius>>,
}

impl Linear {
    /// Returns the inputs of the terms, then the inputs of the slope's terms, in the order of their [`Lag`]s.
    pub fn rises(&self) -> impl Iterator<Item = &Input> {
        self.lagging().into_iter()
    }

    /// Returns the gains of the terms in µm/°C, then the gains of the slope's terms in µm/mm/°C.
    pub fn gains(&self) -> impl Iterator<Item = f64> {
        let slope = self.slope.iter().flat_map(|slope| &slope.terms);
        self.terms.iter().map(|term| term.gain.get()).chain(slope.map(|term| term.gain.get()))
    }
}

impl Evaluate for Linear {
    fn evaluate(&self, inputs: &Inputs<'_>) -> Result<Outputs, Unusable> {
        let mut lags = inputs.lags.iter();
        let cz = sum(self.offset.get(), &self.terms, &mut lags, inputs)?;
        let Some(slope) = &self.slope else { return Outputs::of(cz, 0.0) };
        let per_mm = sum(0.0, &slope.terms, &mut lags, inputs)?;
        if inputs.splits_slope {
            return Outputs::of(cz, per_mm);
        }
        let position = inputs.snapshot.position(slope.position).ok_or(Unusable::Signal(slope.position))?;
        Outputs::of(cz + per_mm * (position.get() - slope.reference.get()), 0.0)
    }

    fn signals(&self) -> Vec<SignalId> {
        let positions = self.slope.iter().map(|slope| slope.position);
        self.rises().map(|input| input.signal).chain(positions).collect()
    }

    fn lagging(&self) -> Rises<'_> {
        let slope = self.slope.as_ref().map_or(&[][..], |slope| &slope.terms);
        Rises { terms: &self.terms, slope, inputs: &[] }
    }

    fn correctable(&self) -> Option<&Linear> {
        Some(self)
    }
}

fn sum<'a, Gain: Mul<Celsius, Output = f64> + Copy>(
    offset: f64,
    terms: &[Term<Gain>],
    lags: &mut impl Iterator<Item = &'a Lag>,
    inputs: &Inputs<'_>,
) -> Result<f64, Unusable> {
    let mut sum = offset;
    for term in terms {
        sum += term.part(lags.next().unwrap_or(&Lag::NONE), inputs)?;
    }
    Ok(sum)
}
