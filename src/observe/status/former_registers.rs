//! Registers that belong to no output any more and still contain an offset of the gateway.

use serde::Serialize;

use isotherm_core::explained::Explained;

/// A register that belongs to no output any more and still contains an offset of the gateway.
#[derive(Clone, Debug, Serialize)]
pub struct FormerRegisterStatus {
    /// Name that its output had.
    pub output: String,
    /// Register, unit and line.
    pub register: String,
    /// State of the release: `left`; `asked` (released, the gateway has not been restarted); or `returning`.
    pub state: ReleaseProgress,
    /// Cz of the gateway in the register as last verified, µm.
    pub held_um: f64,
    /// Cz that a release has found in the register if it differs, µm.
    pub found_um: Option<f64>,
    /// Saved operator offset of a shared register, in the unit of the register. `None` if the register is not shared.
    pub operator: Option<f64>,
    /// Largest |Cz| that its axis had, µm; `None` if an earlier version of the program has saved the state.
    pub limit_um: Option<f64>,
    /// Largest change of one update, µm.
    pub step_um: Option<f64>,
    /// Largest speed at which Cz changes, µm/s.
    pub rate_um_per_s: Option<f64>,
    /// Shortest time until the register reaches its base value, s.
    pub back_s: Option<f64>,
    /// Reason why the register cannot be released, with a remedy; `None` if it can.
    pub obstacle: Option<Explained>,
}

/// Request of an operator for the registers of an output that was moved or removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReleaseRequest<'a> {
    /// Return the registers to their base values. The operator has seen these offsets of the gateway in the registers,
    /// as Cz in µm.
    Back(&'a [f64]),
    /// Cancel the request: they keep their values.
    Stay,
}

/// Progress of the release of a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReleaseProgress {
    /// The operator has not released the register.
    Left,
    /// Released by an operator; the gateway has not been restarted since.
    Asked,
    /// The register is returning to its base value.
    Returning,
}
