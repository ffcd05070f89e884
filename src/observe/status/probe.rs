//! What measured errors have taught an axis, and what they show of its model.

use serde::Serialize;

/// What measured errors have taught an axis.
#[derive(Clone, Debug, Serialize)]
pub struct ProbeStatus {
    /// What is added to the model's Cz now, µm.
    pub correction_um: f64,
    /// Its largest size, µm.
    pub limit_um: f64,
    /// Beyond it people are warned, µm.
    pub warn_um: Option<f64>,
    /// One beyond it is refused, µm.
    pub max_error_um: f64,
    /// The last probing, learned from or not.
    pub last: Option<ProbedStatus>,
    /// When, and what would have remained with the model's Cz, µm: the last probings that were learned from, oldest first.
    pub history: Vec<(String, f64)>,
    /// How far each gain has been changed; empty where gains do not learn.
    pub gains: Vec<GainStatus>,
    /// The axis is worse with the model in use than without compensation; `None` where touches do not show that.
    pub worse: Option<WorseStatus>,
}

/// Figures of a model that is worse than no compensation.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct WorseStatus {
    /// How many touches they are of; none directly after a new datum.
    pub touches: usize,
    /// Root mean square of the error without compensation, µm.
    pub without_um: f64,
    /// Root mean square of the error with the Cz of the model, µm.
    pub with_um: f64,
    /// Cz goes to zero until it is over.
    pub ramps: bool,
}

/// One probing.
#[derive(Clone, Debug, Serialize)]
pub struct ProbedStatus {
    /// RFC 3339.
    pub at: String,
    /// The measured error, µm.
    pub error_um: f64,
    /// The Cz that acted, µm.
    pub acting_um: f64,
    /// What would remain with the model's Cz, µm.
    pub residual_um: Option<f64>,
    /// Why nothing was learned from it, in words.
    pub refused: Option<String>,
}

/// The gain of one term.
#[derive(Clone, Debug, Serialize)]
pub struct GainStatus {
    /// Its model.
    pub model: String,
    /// Its signal.
    pub signal: String,
    /// By which share of it it has been changed.
    pub change: f64,
}
