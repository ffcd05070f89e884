//! Correction of an axis from measured errors, and the comparison of its model with no compensation.

use schemars::JsonSchema;
use serde::Serialize;

/// Correction of an axis from measured errors.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct ProbeStatus {
    /// Present correction that is added to the model's Cz, µm.
    pub correction_um: f64,
    /// Maximum absolute correction, µm.
    pub limit_um: f64,
    /// Residual error above which an event warns, µm; `None` if the profile has no such level.
    pub warn_um: Option<f64>,
    /// Measured error above which a probing is refused, µm.
    pub max_error_um: f64,
    /// Last probing, even if it was refused.
    pub last: Option<ProbedStatus>,
    /// Last accepted probings, oldest first: the time, and the error that would have remained with the model's Cz and
    /// the correction before this probing, µm.
    pub history: Vec<(String, f64)>,
    /// Changes of the model's gains that result from probings. Empty if probings do not change gains.
    pub gains: Vec<GainStatus>,
    /// Figures if probings show that the model in use is worse than no compensation; `None` otherwise.
    pub worse: Option<WorseStatus>,
}

/// Figures of a model that is worse than no compensation.
#[derive(Clone, Copy, Debug, JsonSchema, Serialize)]
pub struct WorseStatus {
    /// Number of probings in the comparison; 0 directly after a new datum (zero point of Cz).
    pub touches: usize,
    /// Root mean square of the error without compensation, µm.
    pub without_um: f64,
    /// Root mean square of the error with the Cz of the model, µm.
    pub with_um: f64,
    /// Whether the gateway moves Cz to zero, and keeps it there while the model is worse than no
    /// compensation.
    pub ramps: bool,
}

/// Result of one probing: a measured error of the axis.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct ProbedStatus {
    /// Time of the probing, RFC 3339.
    pub at: String,
    /// Measured error, µm.
    pub error_um: f64,
    /// Cz that acted during the probing, µm.
    pub acting_um: f64,
    /// Error that would remain with the model's Cz, µm; `None` if no model had a value.
    pub residual_um: Option<f64>,
    /// Reason why the probing was refused, for display; `None` if it was accepted.
    pub refused: Option<String>,
}

/// Change of one gain that results from probings.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct GainStatus {
    /// Name of the model.
    pub model: String,
    /// Name of the signal.
    pub signal: String,
    /// Change as a share of the gain in the profile.
    pub change: f64,
}
