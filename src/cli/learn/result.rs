//! Result of `isotherm learn` for one axis.

use serde::Serialize;

use isotherm_core::candidate::Gain;
use isotherm_core::quantity::Moment;
use isotherm_identify::learning::TakenRun;

/// Result of learning for one axis.
#[derive(Debug, Serialize)]
pub(super) struct AxisResult {
    pub(super) axis: String,
    /// New runs in the logs, which were not used for learning before.
    pub(super) new: Vec<TakenRun>,
    /// Number of runs from which the candidate was learned.
    pub(super) runs: usize,
    /// Residual errors of candidate and model in use over the last compared days; `None` if no day was compared.
    pub(super) gain: Option<GainShown>,
    /// Whether the candidate is better than the model in use.
    pub(super) proposed: bool,
    /// Whether the axis learns (`learn` in its probe), so that a gateway may adopt the candidate.
    #[serde(skip)]
    pub(super) is_learning: bool,
    /// Remarks, for example about files that cannot be used.
    pub(super) remarks: Vec<String>,
    /// Candidate as a block for the profile; `None` without a run.
    pub(super) block: Option<String>,
}

/// Residual errors with the model in use and with the candidate, as root mean squares in µm.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct GainShown {
    /// Start of the first compared day, in nanoseconds since the Unix epoch.
    pub(super) since: Moment,
    pub(super) days: usize,
    pub(super) touches: u32,
    pub(super) in_use_um: f64,
    pub(super) candidate_um: f64,
}

impl From<Gain> for GainShown {
    fn from(gain: Gain) -> GainShown {
        let Gain { since, days, touches, in_use, candidate } = gain;
        GainShown { since, days, touches, in_use_um: in_use.get(), candidate_um: candidate.get() }
    }
}
