//! Control: everything besides the readings that an axis needs for one step, for example whether it may write.
//! Elsewhere, a control is usually a CNC.

use serde::{Deserialize, Serialize};

use super::probe::Measured;
use crate::quantity::Micron;

/// Input of an axis for one step, besides the readings: its permission to write, and requests of the operator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Control {
    /// Permission of the axis: whether it may decide and write, and if not, why.
    pub permit: Permit,
    /// Cz in the register, from which the axis resumes. This field is set when the axis is armed, and when an output
    /// recovers.
    pub take_over: Option<Micron>,
    /// Position-dependent part of the compensation (slope times largest distance from the reference position), from
    /// which the slope resumes. This field is set only if the control applies the slope itself.
    pub take_over_slope: Option<Micron>,
    /// Whether the axis must discard the corrections that its models have from probings.
    pub forget: bool,
    /// Measured error with which the axis corrects its models; `None` if there is no new measured error.
    pub measured: Option<Measured>,
    /// Target of Cz instead of the model's value, while an operator checks the sign of Cz with a dial gauge. Limit,
    /// step and rate of the axis still apply.
    pub sign: Option<Micron>,
    /// Whether the operator has disarmed the axis and checked its sensors. If so, all present readings are accepted.
    pub trust: bool,
    /// Verified Cz of the output register that is farthest behind the last decision. The next Cz stays within one step
    /// of this value. `None` if no register is behind.
    pub behind: Option<Micron>,
    /// Cz and slope from before a change of a sensor's settings. An axis that keeps its Cz returns to these values,
    /// because its later decisions used wrong readings.
    pub return_to: Option<ReturnTo>,
}

/// Cz, and the position-dependent part of the compensation (slope times largest distance), before the settings of a
/// sensor were changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReturnTo {
    /// Cz before the settings of the sensor were changed.
    pub cz: Micron,
    /// Position-dependent part of the compensation (slope times largest distance from the reference position), before
    /// the settings were changed. Zero without a slope.
    pub slope: Micron,
}

impl Control {
    /// Returns whether the axis must take over a register value.
    pub fn takes_over(&self) -> bool {
        self.take_over.is_some() || self.take_over_slope.is_some()
    }

    /// Returns whether the control contains a measured error, or a demand to discard the corrections.
    pub fn teaches(&self) -> bool {
        self.measured.is_some() || self.forget
    }
}

/// Permission of an axis to decide and to write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Permit {
    /// The axis is not armed: it decides nothing, and its register is not written.
    #[default]
    Off,
    /// The axis is armed, and its last write was verified.
    Armed,
    /// The axis is armed, but its last write was not verified.
    Unverified,
    /// The axis is armed, but an interlock prevents writes, so the register value stays. The axis waits without a time
    /// limit.
    Held,
    /// The gateway is stopping. The axis runs its fault action without the waiting time.
    Stopping,
}

impl Permit {
    /// Returns the name of the permit in a log.
    pub fn name(self) -> &'static str {
        match self {
            Permit::Off => "off",
            Permit::Armed => "armed",
            Permit::Unverified => "unverified",
            Permit::Held => "held",
            Permit::Stopping => "stopping",
        }
    }

    /// Returns the permit with this name in a log; `None` if the name is unknown.
    pub fn from_name(name: &str) -> Option<Permit> {
        [Permit::Off, Permit::Armed, Permit::Unverified, Permit::Held, Permit::Stopping]
            .into_iter()
            .find(|permit| permit.name() == name)
    }
}
