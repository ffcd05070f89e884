//! States of an axis, and the transitions between them.
//!
//! ```text
//!            armed                    no usable model, or outputs not verified
//!   Off ─────────────► Active ─────────────────────────────► Holding
//!    ▲                  ▲  ▲  ◄─────────────────────────────    │
//!    │ disarmed         │  │            all good again          │ after (ramp) · at once (zero)
//!    │ (from anywhere)  │  │                                    ▼
//!                       │  └────────── all good again ────── Ramping
//!      preferred model  │                                       │ at zero
//!      not usable       ▼                                       ▼
//!                    Degraded                                 Zeroed ──► (all good again: Active)
//! ```
//!
//! # Theory of operation
//! An axis that is off decides nothing, and the register value does not change. When the axis is armed, it
//! takes over the register value. The first decision is therefore at most one step from the value that was
//! taken over. The axis follows a model, within the limits of its Cz, while the model can be used and the
//! last write was verified. If the axis follows a fallback model, its state is `Degraded`. If no model can be
//! used or a write was not verified, the axis keeps its value. Then it runs the fault action of the profile.
//! When the axis recovers, the same limits apply to its changes. A model that requests more than the error
//! level cannot be used until the axis is armed again. When the gateway stops, the fault action runs without
//! its waiting time. An axis that is off stays off.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::quantity::{Moment, Shift, Shifted};

/// State of an axis: off, following a model, keeping its Cz, or returning to zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AxisState {
    /// The axis is not armed. Nothing is decided or written for it.
    #[default]
    Off,
    /// The axis follows its preferred model.
    Active,
    /// The axis follows a fallback model, or its preferred model with a stand-in (estimate) for a frozen or
    /// lost sensor.
    Degraded,
    /// The axis has kept its last Cz since this moment.
    Holding(Moment),
    /// Cz of the axis goes to zero, within the step and rate of the axis.
    Ramping,
    /// Cz is zero until the inputs and outputs of the axis are good again.
    Zeroed,
}

impl AxisState {
    /// Returns the name of the state in the log (column `z_state` for an axis z), on the web page, and in metrics.
    pub fn name(self) -> &'static str {
        match self {
            AxisState::Off => "off",
            AxisState::Active => "active",
            AxisState::Degraded => "degraded",
            AxisState::Holding(_) => "holding",
            AxisState::Ramping => "ramping",
            AxisState::Zeroed => "zeroed",
        }
    }

    /// Names of all states, as [`AxisState::name`] returns them.
    pub const NAMES: [&'static str; 6] = ["off", "active", "degraded", "holding", "ramping", "zeroed"];

    /// Words for the states in events. The words "at zero" are not used here, because they mean that zero was verified
    /// in the control.
    const DISPLAYED: [&'static str; 6] =
        ["off", "compensating", "fallback model", "frozen", "returning to zero", "zero requested"];

    /// Returns the word in events for the state of this name. An unknown name is returned unchanged.
    pub fn display_of(name: &str) -> &str {
        let found = AxisState::NAMES.iter().zip(AxisState::DISPLAYED).find(|(known, _)| **known == name);
        found.map_or(name, |(_, word)| word)
    }

    /// Returns whether the axis follows a model.
    pub fn is_following(self) -> bool {
        matches!(self, AxisState::Active | AxisState::Degraded)
    }
}

impl Shifted for AxisState {
    fn shift(&mut self, by: Shift) {
        if let AxisState::Holding(since) = self {
            since.shift(by);
        }
    }
}

impl fmt::Display for AxisState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
