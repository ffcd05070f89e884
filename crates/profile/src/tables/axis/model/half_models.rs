//! `halves` of a model: two half models. Each is a sum of terms, and their mean is the model. Outside of the envelope,
//! their difference shows the uncertainty of the model.
//!
//! ```json
//! { "format": "isotherm-halves", "version": 1,
//!   "terms": [{ "signal": "bed", "lag_s": 360, "ridge": 1.9, "net": 2.3 }, …] }
//! ```
//! The terms have the order of the model's terms. The mean of `ridge` and `net` must be the gain of the model.
//! Otherwise the file belongs to another model, and is rejected.

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::file::{bytes, read, taken};
use super::seals::RawSeals;
use crate::document::figure;
use crate::duration::shown;
use crate::tables::KeyContext;
use isotherm_core::compensation::model::{Model, Term};

/// Largest accepted difference between the gain of a term and the mean of its gains in the two halves. The number is
/// relative to the larger of these two gains.
const NEAR: f64 = 1e-6;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct HalvesFile {
    #[serde(rename = "format")]
    _format: IgnoredAny,
    #[serde(rename = "version")]
    _version: IgnoredAny,
    terms: Vec<HalfTerm>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct HalfTerm {
    signal: String,
    lag_s: f64,
    ridge: f64,
    net: f64,
}

/// Reads the file `halves` of a model. Returns for each term of the model the difference between its gains in the two
/// halves. If the file does not match the model, reports an error and returns `None`.
pub(super) fn resolve(
    seals: Option<&RawSeals>,
    at: &KeyContext<'_>,
    name: &str,
    model: &Model,
) -> Option<Vec<f64>> {
    let bytes = bytes(seals, "halves", at, name)?;
    let file: HalvesFile = taken(at, name, read(&bytes, "isotherm-halves"))?;
    let apart = file.of(model.sum(), &at.report.signals);
    taken(at, name, apart)
}

impl HalvesFile {
    fn of(&self, terms: &[Term], names: &[String]) -> Result<Vec<f64>, String> {
        if terms.is_empty() {
            return Err("only a linear model without a slope has halves: remove `halves`".to_owned());
        }
        if self.terms.len() != terms.len() {
            let (own, of_model) = (self.terms.len(), terms.len());
            return Err(format!(
                "this file belongs to another model: it has {own} terms, but the model has {of_model}"
            ));
        }
        let one = |((place, half), term): ((usize, &HalfTerm), &Term)| {
            half.of(term, &names[term.input.signal.0]).map_err(|why| {
                format!("this file belongs to another model: term {} of the model is {why}", place + 1)
            })
        };
        self.terms.iter().enumerate().zip(terms).map(one).collect()
    }
}

impl HalfTerm {
    fn of(&self, term: &Term, name: &str) -> Result<f64, String> {
        let lag = term.input.time_constant().unwrap_or_default();
        if self.signal != name || (self.lag_s - lag.as_secs_f64()).abs() > 1e-3 {
            let (signal, lag_s) = (&self.signal, figure(self.lag_s, 9));
            return Err(format!(
                "{name} with a lag of {}, but the file has {signal} with a lag of {lag_s} s",
                shown(lag)
            ));
        }
        let (mean, gain) = (f64::midpoint(self.ridge, self.net), term.gain.get());
        if (mean - gain).abs() > NEAR * self.ridge.abs().max(self.net.abs()) {
            let (gain, mean) = (figure(gain, 9), figure(mean, 9));
            return Err(format!(
                "{name} with a gain of {gain}, but the mean of the gains in the two halves is {mean}"
            ));
        }
        let apart = self.ridge - self.net;
        apart
            .is_finite()
            .then_some(apart)
            .ok_or_else(|| format!("{name}, but the two halves of this term differ too much"))
    }
}
