//! Names of the columns of the log.

pub(super) const TIME: &str = "time";
pub(super) const MEMORY: &str = "machine_memory";
pub(super) const ZERO: &str = "machine_zero";
/// Column with the correction of the computer's clock. It is filled only in the first row of a file that begins after
/// a correction.
pub(in crate::gateway) const CLOCK: &str = "machine_clock";

pub(super) const PERMIT: &str = "permit";
pub(super) const FROM: &str = "from_um";
/// Log columns that every axis has, in addition to the columns of its decision.
pub(super) const SIGN: &str = "sign_um";
pub(super) const BEHIND: &str = "behind_um";
pub(super) const RETURN: &str = "return_um";
pub(super) const RETURN_SLOPE: &str = "return_slope_um";
/// Log column for a slope that the control applies: the slope in the register from which the axis continued. The unit
/// is µm, as the effect of the slope at the axis's largest distance from the reference position.
pub(super) const SLOPE_FROM: &str = "slope_from_um";
/// Log columns of an axis with a probe.
pub(super) const MEASURED: &str = "measured_um";
pub(super) const ACTING: &str = "acting_um";
pub(super) const FORGET: &str = "forget";
pub(super) const WORSE: &str = "worse";
/// Log column of an axis with a model that calculates its expected error.
pub(super) const EXPECTED: &str = "expected_um";
/// Log column of an axis that may use stand-ins for frozen sensors.
pub(super) const STOOD_IN: &str = "stood_in";
/// Log column of an axis whose models have stand-ins: 1 if the operator has disarmed the axis, so that its sensors
/// are accepted again.
pub(super) const TRUST: &str = "trust";
/// Log column of an axis that learns a model: request to change the preferred model, as JSON.
pub(super) const PREFERRED: &str = "preferred";
/// Log columns of the decision of an axis, in their order.
pub(super) const DECIDED: [&str; 5] = ["raw_um", "cz_um", "model", "state", "acted"];
