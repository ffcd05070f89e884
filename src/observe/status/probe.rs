//! Correction of an axis from measured errors, and the comparison of its model with no compensation.

use serde::Serialize;

/// Correction of an axis from measured errors.
#[derive(Clone, Debug, Serialize)]
pub struct ProbeStatus {
    /// Present correction of the model's Cz, µm.
    pub correction_um: f64,
    /// Largest absolute correction, µm.
    pub limit_um: f64,
    /// Warning level of a residual, µm.
    pub warn_um: Option<f64>,
    /// Error level: a probing beyond it is refused, µm.
    pub max_error_um: f64,
    /// Last probing, even if nothing was learned from it.
    pub last: Option<ProbedStatus>,
    /// Last accepted probings, oldest first: time, and error that would have remained with the model's Cz, µm.
    pub history: Vec<(String, f64)>,
    /// Learned change of each gain; empty if gains are not learned.
    pub gains: Vec<GainStatus>,
    /// Comparison in which the model in use is worse than no compensation; `None` if probings do not show that.
    pub worse: Option<WorseStatus>,
}

/// Figures of a model that is worse than no compensation.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct WorseStatus {
    /// Number of probings in the comparison; 0 directly after a new datum (zero point of Cz).
    pub touches: usize,
    /// Root mean square of the error without compensation, µm.
    pub without_um: f64,
    /// Root mean square of the error with the Cz of the model, µm.
    pub with_um: f64,
    /// Cz goes to zero until the model is not worse any more.
    pub ramps: bool,
}

/// Result of one probing.
#[derive(Clone, Debug, Serialize)]
pub struct ProbedStatus {
    /// Time of the probing, RFC 3339.
    pub at: String,
    /// The measured error, µm.
    pub error_um: f64,
    /// Cz that acted, µm.
    pub acting_um: f64,
    /// Error that would remain with the model's Cz, µm; `None` if no model had a value.
    pub residual_um: Option<f64>,
    /// Why nothing was learned, for display; `None` if the probing was accepted.
    pub refused: Option<String>,
}

/// Learned change of one gain.
#[derive(Clone, Debug, Serialize)]
pub struct GainStatus {
    /// Name of the model.
    pub model: String,
    /// Name of the signal.
    pub signal: String,
    /// Change as a share of the gain.
    pub change: f64,
}
