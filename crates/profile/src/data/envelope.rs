//! The region of inputs a model was identified on.
//!
//! ```json
//! { "format": "isotherm-envelope", "version": 1, "reach": 3.4, "covariance": [[4.0, 1.2], [1.2, 2.5]],
//!   "inputs": [{ "signal": "bed", "mean": 24.1, "min": 20.0, "max": 30.5 }, …] }
//! ```
//! In the unit of each signal, less its `reference` (a number, default 0, "start" or "zero"). `reach`: the largest
//! Mahalanobis distance that is inside; without it, that of 99 % of a normal distribution.

use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::raw::ReferenceValue;
use isotherm_core::compensation::model::envelope::{BadEnvelope, MOST};

/// An envelope file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct EnvelopeFile {
    #[serde(rename = "format")]
    _format: IgnoredAny,
    #[serde(rename = "version")]
    _version: IgnoredAny,
    pub(crate) reach: Option<f64>,
    pub(crate) inputs: Vec<KnownInput>,
    pub(crate) covariance: Vec<Vec<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct KnownInput {
    pub(crate) signal: String,
    pub(crate) reference: Option<ReferenceValue>,
    pub(crate) mean: f64,
    pub(crate) min: f64,
    pub(crate) max: f64,
}

impl EnvelopeFile {
    pub(crate) fn parse(bytes: &[u8]) -> Result<EnvelopeFile, String> {
        super::read(bytes, "isotherm-envelope")
    }

    /// What is wrong, with the names of the inputs.
    pub(crate) fn why(&self, wrong: BadEnvelope) -> String {
        let name = |place: usize| self.inputs.get(place).map_or("", |input| input.signal.as_str());
        match wrong {
            BadEnvelope::Count => format!("it has {} inputs; 1 to {MOST} are allowed", self.inputs.len()),
            BadEnvelope::Size => format!(
                "its covariance has {} rows of {} columns; {} inputs want as many of each",
                self.covariance.len(),
                self.covariance.first().map_or(0, Vec::len),
                self.inputs.len()
            ),
            BadEnvelope::Range(place) => {
                format!("{}: its mean must lie between its min and its max, which must differ", name(place))
            }
            BadEnvelope::NotSymmetric(first, second) => format!(
                "its covariance is not symmetric: {} with {} is not {} with {}",
                name(first),
                name(second),
                name(second),
                name(first)
            ),
            BadEnvelope::NotPositiveDefinite(place) => format!(
                "its covariance is not positive definite: {} does not vary, or is made of the inputs before it",
                name(place)
            ),
            BadEnvelope::Reach => "its reach must be above zero".to_owned(),
        }
    }
}
