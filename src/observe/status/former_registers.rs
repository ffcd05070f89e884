//! Registers that outputs no longer use, but that still contain an offset of the gateway.

use schemars::JsonSchema;
use serde::Serialize;

use isotherm_core::explained::Explained;

/// Register that outputs no longer use, but that still contains an offset of the gateway.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct FormerRegisterStatus {
    /// Name of the output that used the register.
    pub output: String,
    /// Register, unit and bus.
    pub register: String,
    /// State of the release: `left`; `asked` (requested, but the gateway has not been restarted); or `returning`.
    pub state: ReleaseProgress,
    /// Cz of the gateway that was last verified in the register, µm.
    pub held_um: f64,
    /// Cz that a release has found in the register, µm. `None` if it equals the last verified Cz.
    pub found_um: Option<f64>,
    /// Saved operator offset of a shared register: the part of its value that the operator entered, in the unit of
    /// the register. `None` if the register is not shared.
    pub operator: Option<f64>,
    /// Maximum absolute Cz of the former axis, µm. `None` if an earlier version of isotherm has saved the state.
    pub limit_um: Option<f64>,
    /// Maximum change of Cz from one update to the next, µm.
    pub step_um: Option<f64>,
    /// Maximum speed at which Cz changes, µm/s.
    pub rate_um_per_s: Option<f64>,
    /// Minimum time until the register reaches its base value, s.
    pub back_s: Option<f64>,
    /// Reason why the register cannot be released, with a remedy; `None` if it can.
    #[schemars(with = "Option<String>")]
    pub obstacle: Option<Explained>,
}

/// Request of an operator about the former registers of an output that was moved or removed in the profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReleaseRequest<'a> {
    /// Return the registers to their base values. The list contains the offsets in the registers as they were shown to
    /// the operator, as Cz in µm.
    Back(&'a [f64]),
    /// Withdraw the request to release the registers, so that they keep their values.
    Stay,
}

/// Progress of the release of a former register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReleaseProgress {
    /// No operator has requested the release.
    Left,
    /// An operator has requested the release, but the gateway has not been restarted since.
    Asked,
    /// The register is returning to its base value.
    Returning,
}
