//! Learned model of an axis: the model that it has adopted, and the candidate.

use schemars::JsonSchema;
use serde::Serialize;

/// Learned model of an axis.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct LearnedStatus {
    /// Name of the learned model that is preferred; `None` for the model of the profile.
    pub adopted: Option<String>,
    /// Name of the model that was preferred before, to which `isotherm adopt --back` returns. Empty for the model of the
    /// profile; `None` if no other model was preferred.
    pub before: Option<String>,
    /// Name of the model whose adoption waits: for the next datum (zero point of Cz), or until the adoption
    /// would not move Cz. Empty for the model of the profile; `None` if no adoption waits.
    pub waiting: Option<String>,
    /// Whether the gateway adopts a better candidate automatically.
    pub auto: bool,
    /// Candidate that was learned last; `None` if there is none.
    pub candidate: Option<CandidateStatus>,
}

/// Candidate: newly learned model of an axis, with the result of its comparison with the model in use.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct CandidateStatus {
    /// Name of the candidate.
    pub model: String,
    /// Number of measurement runs from which the candidate was learned. A run lasts from one datum to the next.
    pub runs: usize,
    /// First day on which the candidate was compared with the model in use; `None` before the first comparison.
    pub since: Option<String>,
    /// Number of days on which the candidate was compared with the model in use, at most 5.
    pub days: usize,
    /// Number of touches (measurements with a probe) on the days of the comparison.
    pub touches: u32,
    /// Residual error with the model in use on these days, as a root mean square, µm.
    pub in_use_um: Option<f64>,
    /// Residual error that the candidate would have left on these days, as a root mean square, µm.
    pub candidate_um: Option<f64>,
    /// Whether the candidate may be adopted: it is better than the model in use.
    pub better: bool,
}
