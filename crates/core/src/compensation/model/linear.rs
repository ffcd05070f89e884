//! `Cz = offset + Σ gain · (T − T_ref) + slope · (P − P0)`: M1 and M3 of JP H07-61598 B2, the lagged expansions of
//! Janeczko 1989, and every regression on temperature rises.
//!
//! The slope is a second sum, in µm/mm, that grows with the distance from a reference position: Li, Yang, Zhang, Zhang
//! 1998, `Δz(z1) = Δz(z0) + k·(z1 − z0)`; in a SINUMERIK `ΔK = K0(T) + tanβ(T)·(P − P0)`.

use super::{Asked, Evaluate, Known, Lag, Term, Unusable};
use crate::reading::SignalId;

/// A constant plus a sum of terms, µm.
#[derive(Clone, Debug, PartialEq)]
pub struct Linear {
    /// Cz where every rise is zero, µm.
    pub offset: f64,
    /// Added up.
    pub terms: Vec<Term>,
    /// What grows with the position.
    pub slope: Option<Slope>,
}

/// A sum of terms, µm/mm, times the distance from a reference position.
#[derive(Clone, Debug, PartialEq)]
pub struct Slope {
    /// Where the axis is, mm.
    pub position: SignalId,
    /// P0: where the slope adds nothing, mm.
    pub reference: f64,
    /// The ends of the axis's travel, mm, where they are known.
    pub travel: Option<(f64, f64)>,
    /// Added up.
    pub terms: Vec<Term>,
}

impl Linear {
    /// Every term, those of the slope last: one [`Lag`] belongs to each.
    pub fn all_terms(&self) -> impl Iterator<Item = &Term> {
        self.terms.iter().chain(self.slope.iter().flat_map(|slope| &slope.terms))
    }
}

impl Evaluate for Linear {
    fn evaluate(&self, known: &Known<'_>) -> Result<Asked, Unusable> {
        let mut lags = known.lags.iter();
        let cz = sum(self.offset, &self.terms, &mut lags, known)?;
        let Some(slope) = &self.slope else { return Ok(Asked { cz, slope: 0.0 }) };
        let per_mm = sum(0.0, &slope.terms, &mut lags, known)?;
        if known.apart {
            return Ok(Asked { cz, slope: per_mm });
        }
        let position = known.snapshot.value(slope.position).ok_or(Unusable::Signal(slope.position))?;
        Ok(Asked { cz: cz + per_mm * (position - slope.reference), slope: 0.0 })
    }

    fn inputs(&self) -> Vec<SignalId> {
        let positions = self.slope.iter().map(|slope| slope.position);
        self.all_terms().map(|term| term.signal).chain(positions).collect()
    }
}

fn sum<'a>(
    offset: f64,
    terms: &[Term],
    lags: &mut impl Iterator<Item = &'a Lag>,
    known: &Known<'_>,
) -> Result<f64, Unusable> {
    let mut sum = offset;
    for term in terms {
        sum += term.part(lags.next().unwrap_or(&Lag::NONE), known)?;
    }
    Ok(sum)
}

impl Term {
    /// What it adds to the sum now.
    pub(super) fn part(&self, lag: &Lag, known: &Known<'_>) -> Result<f64, Unusable> {
        Ok(self.gain * self.rise(known, lag)?)
    }
}
