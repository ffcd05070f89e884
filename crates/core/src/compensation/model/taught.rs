//! What probings need to know of a model: its gains, what each contributes, what it is measured from.

use super::{Inputs, Kind, Lag, Linear, Model, Reference, Term};

impl Model {
    /// The terms whose gains can be corrected: those of a linear model, without its slope's.
    pub fn gained(&self) -> impl Iterator<Item = &Term> {
        self.linear().into_iter().flat_map(|linear| &linear.terms)
    }

    /// What each of them contributes to Cz now, µm; NaN where it contributes nothing that could be used.
    pub fn parts<'a>(&'a self, inputs: Inputs<'a>) -> impl Iterator<Item = f64> + Clone + 'a {
        let terms = self.linear().map_or(&[][..], |linear| &linear.terms).iter();
        terms.enumerate().map(move |(place, term)| {
            let lag = inputs.lags.get(place).unwrap_or(&Lag::NONE);
            term.part(lag, &inputs).unwrap_or(f64::NAN)
        })
    }

    /// The offset and the gains that the profile gives a linear model.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        let linear = self.linear().into_iter();
        linear.flat_map(|linear| [linear.offset.get()].into_iter().chain(linear.gains()))
    }

    /// What its rises are measured from.
    pub fn references(&self) -> impl Iterator<Item = Reference> {
        self.rises().map(|input| input.reference)
    }

    pub(super) fn linear(&self) -> Option<&Linear> {
        match &self.kind {
            Kind::Linear(linear) => Some(linear),
            Kind::Formula(_) | Kind::Matrix(_) | Kind::Network(_) => None,
        }
    }
}
