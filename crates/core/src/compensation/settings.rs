//! Settings of the machine and its axes, from the profile.

use std::time::Duration;

use super::model::Model;
use crate::quantity::{Micron, MicronPerSecond, Millimetre};

mod machine;

pub use machine::MachineSettings;

/// One axis: its models in order of preference, and the guard that stands before the register.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisSettings {
    /// The axis's name in the profile.
    pub name: String,
    /// The first whose signals are all good is used. Empty where none has been found yet.
    pub models: Vec<Model>,
    /// Bounds of the offset.
    pub guard: GuardSettings,
    /// Update period.
    pub every: Duration,
    /// What happens when no model can be used.
    pub on_fault: OnFault,
    /// Sizes of Cz at which people are warned, and at which the axis gives up.
    pub levels: Levels,
    /// What Cz is measured from.
    pub datum: Datum,
    /// The control multiplies the slope by the distance itself and is given both parts; `None`: it is given Cz.
    pub intercept_slope: Option<InterceptSlope>,
    /// Measured errors correct its models; `None`: it takes none.
    pub probe: Option<ProbeSettings>,
}

/// What a measured error may change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeSettings {
    /// Largest correction of a model's Cz, µm.
    pub limit: Micron,
    /// How much of a residual one probing takes into the offset.
    pub filter: Filter,
    /// A model that would be wrong by more than this is not what was measured: the probing is refused.
    pub max_error: Micron,
    /// A residual beyond it is reported: the model ages.
    pub warn: Option<Micron>,
    /// The gains of linear models learn as well.
    pub gains: Option<GainSettings>,
    /// What happens while its touches show that the axis is worse with the model than without compensation.
    pub worse: OnWorse,
}

impl ProbeSettings {
    /// The standard deviation of a probing, µm.
    pub fn scatter(&self) -> f64 {
        match self.filter {
            Filter::Weighed { repeat, .. } => repeat,
            Filter::Share(_) => Filter::REPEAT,
        }
    }
}

/// What an axis does while touches show that it is worse with its model than without compensation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnWorse {
    /// It follows the model all the same, and it is reported.
    #[default]
    Warn,
    /// Cz goes to zero at the axis's rate, until touches show that the model is better than that.
    Ramp,
}

/// How much of a residual one probing takes into the offset of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Filter {
    /// Always the same share of it, above 0 and up to 1.
    Share(f64),
    /// As much as the offset is less certain than the probing.
    Weighed {
        /// The probing's own standard deviation, µm. Above zero.
        repeat: f64,
        /// What an hour adds to the variance of the offset, µm²/h. Above zero.
        walk: f64,
    },
}

impl Filter {
    /// The scatter of a probing where the profile does not name it, µm.
    pub const REPEAT: f64 = 0.5;
    /// The walk of an offset where the profile does not name it, µm²/h.
    pub const WALK: f64 = 4.0;
}

/// How gains learn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GainSettings {
    /// What the knowledge of one probing is worth at the next, above 0 and up to 1.
    pub forgetting: f64,
    /// Largest relative change of a gain.
    pub limit: f64,
}

/// Two levels of |Cz|, as controls have them (Beckhoff TF5200: warn, error). `warn` ≤ `limit` ≤ `error`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Levels {
    /// Beyond it people are warned, once.
    pub warn: Option<Micron>,
    /// A model that asks for more is not believed: the axis takes its fault action and stays off until armed.
    pub error: Option<Micron>,
}

/// What an axis's Cz is measured from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Datum {
    /// The model's own zero.
    #[default]
    Model,
    /// What the model asked for at the last zero: `Cz(t) − Cz(t_zero)`. A datum measured while the machine is warm has
    /// that much drift in it already.
    Zero,
}

/// The bounds of a slope that the control applies itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InterceptSlope {
    /// P0: where the slope adds nothing.
    pub reference: Millimetre,
    /// The farthest that the axis goes from the reference position: tanβ times this obeys the axis's guard.
    pub reach: Millimetre,
    /// One count of the slope's register, as its effect at the reach in µm; `None` where it takes fractions.
    pub count: Option<Micron>,
}

impl AxisSettings {
    /// Whether Cz goes to zero while touches show that the model is worse than that.
    pub fn leaves_what_is_worse(&self) -> bool {
        self.probe.is_some_and(|probe| probe.worse == OnWorse::Ramp)
    }

    /// How often an axis that goes to zero updates: as often as its rate needs it to, however slow its normal period,
    /// but no oftener than a fieldbus could follow.
    pub fn ramp_period(&self) -> Duration {
        let one_step = self.guard.step.get() / self.guard.rate.get();
        let one_step = Duration::try_from_secs_f64(one_step).unwrap_or(Duration::MAX);
        self.every.min(one_step.max(SHORTEST_PERIOD))
    }

    /// How long the fault action takes from this Cz, once it has begun.
    pub fn time_to_rest(&self, cz: Micron) -> Duration {
        let period = self.ramp_period();
        let a_step_each = self.guard.step.get() / period.as_secs_f64();
        let speed = match self.on_fault {
            OnFault::Hold => return Duration::ZERO,
            OnFault::Zero => a_step_each,
            OnFault::Ramp { .. } => a_step_each.min(self.guard.rate.get()),
        };
        let way = Duration::try_from_secs_f64(cz.abs().get() / speed).unwrap_or(Duration::MAX);
        way.saturating_add(period * 2)
    }
}

/// A ramp in the tiniest steps updates no oftener than this.
const SHORTEST_PERIOD: Duration = Duration::from_millis(100);

/// The bounds of an offset. All positive and finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuardSettings {
    /// Largest |Cz|.
    pub limit: Micron,
    /// Largest change of one update.
    pub step: Micron,
    /// Largest speed.
    pub rate: MicronPerSecond,
    /// A change smaller than this is not made.
    pub deadband: Micron,
    /// One count of the register in µm of Cz; `None` where the register takes fractions.
    pub count: Option<Micron>,
}

/// What an axis does when its inputs or outputs fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnFault {
    /// Keep the last value for as long as the fault lasts.
    Hold,
    /// Keep it this long, then go to zero at the axis's `rate`.
    Ramp {
        /// How long the last value is kept.
        after: Duration,
    },
    /// Go to zero at once, as fast as `step` per update allows.
    Zero,
}
