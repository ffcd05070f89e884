//! The states of an axis.
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
//! An axis that is off decides nothing; what stands in the register stays. Arming takes over what stands there, so
//! the first decision is a step from it, never a jump to something else. While a model can be used and what was
//! written was verified, the axis follows the model through the guard; on a fallback model it says so. When either
//! fails it keeps its value, and then does what the profile says. Coming back is the same walk through the guard.
//! A model that asks for more than the error level counts as none until the axis is armed again.
//! When the gateway stops, the action runs without its waiting time; an axis that is off stays off.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::quantity::{Moment, Shift, Shifted};

/// What an axis is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AxisState {
    /// Not armed: nothing is decided, nothing written.
    #[default]
    Off,
    /// Following its preferred model.
    Active,
    /// Following a fallback model, because the preferred one cannot be used.
    Degraded,
    /// Keeping its last value since this moment.
    Holding(Moment),
    /// Going to zero.
    Ramping,
    /// At zero, until its inputs and outputs are good again.
    Zeroed,
}

impl AxisState {
    /// The word for it everywhere: `z_state`, page, metrics, log.
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

    /// Every name, for those who count them.
    pub const NAMES: [&'static str; 6] = ["off", "active", "degraded", "holding", "ramping", "zeroed"];

    /// Words of events for the decided states. "At zero" is not among them: it is said of a verified value alone.
    const DISPLAYED: [&'static str; 6] =
        ["off", "compensating", "fallback model", "frozen", "returning to zero", "zero requested"];

    /// The word that people see for the state of this name; a name that is none is its own word.
    pub fn display_of(name: &str) -> &str {
        let found = AxisState::NAMES.iter().zip(AxisState::DISPLAYED).find(|(known, _)| **known == name);
        found.map_or(name, |(_, word)| word)
    }

    /// Following a model.
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
