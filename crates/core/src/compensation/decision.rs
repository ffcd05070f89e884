//! Decision of one compensation step for one axis: its Cz, and how this Cz was determined.

use serde::{Deserialize, Serialize};

use super::{AxisState, Extrapolation, Stages, SubstitutedSensor, Unusable, Worse};
use crate::quantity::{Micron, Moment, shifted};

/// Decision of one compensation step for one axis: its Cz, and how this Cz was determined.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// Time of the decision.
    pub at: Moment,
    /// Cz that the model requests, with the correction from probings, before the limits of the axis are applied.
    pub raw: Option<Micron>,
    /// Expected residual error if the decision is applied: one standard deviation. `None` if the error is unknown, or
    /// the machine is outside the range on which the model was identified.
    #[serde(default)]
    pub expected: Option<Micron>,
    /// Number of probings whose residuals scale the expected error; 0 if the error is not scaled.
    #[serde(default)]
    pub expected_touches: u32,
    /// Correction that probings have added to the model's own Cz.
    #[serde(default)]
    pub correction: Micron,
    /// Index of the model in the profile's list; `None` if no model can be used.
    pub model: Option<usize>,
    /// Cz after the limits of the axis (limit, deadband, step, rate, rounding). The gateway writes this value.
    pub cz: Micron,
    /// Part of the compensation that depends on the position (slope times distance), at the largest distance from the
    /// reference position. The limits of the axis are applied. Zero unless the control applies the slope itself. If it
    /// does, Cz is K0, the value at the reference position.
    pub slope: Micron,
    /// Target of Cz within the limit: the value that the model, the fault action, the stop or the sign check requests.
    /// Equal to Cz if nothing is requested.
    #[serde(default)]
    pub target: Micron,
    /// Target of the position-dependent part of the compensation (slope times largest distance), within the limit.
    #[serde(default)]
    pub slope_target: Micron,
    /// State of the axis after the decision, for example that it follows its preferred model.
    pub state: AxisState,
    /// Limits of the axis (limit, deadband, step, rate, rounding) that changed the requested value.
    pub acted: Stages,
    /// Reason why the preferred model cannot be used; `None` if the preferred model is used.
    pub lacks: Option<Unusable>,
    /// Sensor of the model in use whose reading is replaced by a stand-in (an estimate from other sensors); `None` if
    /// no reading is replaced.
    #[serde(default)]
    pub stood_in: Option<SubstitutedSensor>,
    /// Whether the model requested more than the error level. If so, the axis runs its fault action until it is armed
    /// again.
    pub tripped: bool,
    /// Comparison which shows that the model in use is worse than no compensation; `None` if the model is not worse.
    /// While no model can be used, this is the comparison of the last model in use.
    #[serde(default)]
    pub worse: Option<Worse>,
    /// Details about inputs outside the range on which the model in use was identified; `None` inside the range.
    pub extrapolating: Option<Extrapolation>,
    /// Distance from the range on which the model in use was identified: above 0 outside, negative inside. `None` if
    /// the model has neither envelope nor guideway. Extrapolation ends below [`CLEARLY_INSIDE`](super::CLEARLY_INSIDE).
    pub excess: Option<f64>,
}

shifted!(Decision: at, stood_in);
