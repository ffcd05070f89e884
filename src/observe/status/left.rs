//! Registers that are no output's any more and keep a value of ours.

use serde::Serialize;

use isotherm_core::explained::Explained;

/// A register that is no output's any more and keeps a value of ours.
#[derive(Clone, Debug, Serialize)]
pub struct LeftStatus {
    /// Name that its output had.
    pub output: String,
    /// Register, unit and line.
    pub register: String,
    /// `left`, `asked`, `returning`.
    pub state: LeftState,
    /// Cz of ours in it as last verified, µm.
    pub held_um: f64,
    /// Cz that a release has found in it, if that was another one, µm.
    pub found_um: Option<f64>,
    /// The operator's part of a shared register as it was saved, in the unit of the register. `None` if all of it is ours.
    pub operator: Option<f64>,
    /// Largest |Cz| that its axis had, µm; `None` if an earlier version of the program has saved the state.
    pub limit_um: Option<f64>,
    /// Largest change of one update, µm.
    pub step_um: Option<f64>,
    /// Largest speed, µm/s.
    pub rate_um_per_s: Option<f64>,
    /// Seconds that the way back to its base takes at least.
    pub back_s: Option<f64>,
    /// Why it cannot be released, with what to do; `None` if it can.
    pub obstacle: Option<Explained>,
}

/// Wish of a person for the registers of an output that was moved or removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wish<'a> {
    /// They go back to their base. The person has seen these Cz of ours in them, µm.
    Back(&'a [f64]),
    /// They stay as they are: the request is taken back.
    Stay,
}

/// How far the release of a register is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum LeftState {
    /// Nobody has released it.
    Left,
    /// A person has released it, and the gateway has not been restarted since.
    Asked,
    /// The register is on its way back.
    Returning,
}
