//! Running state of an axis. The first row of each log file contains this state, so that a replay does not need the
//! earlier files.

use serde::{Deserialize, Serialize};

use super::guard::Guard;
use super::{AxisState, Decision, Permit};
use crate::quantity::{Moment, shifted};

/// Running state of one axis: its limiters of Cz and slope, its state and its last decision.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisRunning {
    pub(super) axis: String,
    pub(super) guard: Guard,
    pub(super) slope_guard: Guard,
    pub(super) state: AxisState,
    pub(super) permit: Permit,
    pub(super) tripped: bool,
    #[serde(default)]
    pub(super) kept_outside: bool,
    #[serde(default)]
    pub(super) fallback_outside: Option<usize>,
    pub(super) stepped: Option<Moment>,
    pub(super) due: Option<Moment>,
    pub(super) decision: Decision,
}

shifted!(AxisRunning: state, stepped, due, decision);
