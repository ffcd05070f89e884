//! `[axis.*.probe]` as written.

use schemars::JsonSchema;
use serde::Deserialize;

/// Measured errors that correct an axis's models.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Probe")]
pub(crate) struct RawProbe {
    /// The signal with the measured error, in um or mm: actual minus commanded, while the compensation acts. Without it
    /// errors come by command only.
    pub(crate) signal: Option<String>,
    /// The signal that says when a new error has been measured: a flag or a counter; each change to another value than 0
    /// counts. Default: each change of the error itself.
    pub(crate) trigger: Option<String>,
    /// Largest correction of a model's Cz, µm; at most the axis's `limit`.
    #[schemars(required)]
    pub(crate) limit: Option<f64>,
    /// The share of a measured residual that one probing takes into the correction, above 0 and up to 1.
    #[schemars(required)]
    pub(crate) filter: Option<f64>,
    /// A probing after which the model would be wrong by more than this is not believed, µm.
    #[schemars(required)]
    pub(crate) max_error: Option<f64>,
    /// A residual beyond this is told, µm: the model ages. At most `max_error`.
    pub(crate) warn: Option<f64>,
    /// The gains of linear models learn as well, by recursive least squares.
    pub(crate) gains: Option<RawGains>,
}

/// How gains learn.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "ProbeGains")]
pub(crate) struct RawGains {
    /// What a probing is worth at the next one, above 0 and up to 1; 1 forgets nothing.
    #[schemars(required)]
    pub(crate) forgetting: Option<f64>,
    /// Largest change of a gain as a share of it, above 0 and below 1.
    #[schemars(required)]
    pub(crate) limit: Option<f64>,
}
