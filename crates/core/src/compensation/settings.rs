//! Settings of the machine and its axes, from the profile.

use std::time::Duration;

use super::model::Model;
use crate::quantity::{Micron, MicronPerSecond, Millimetre};

mod machine;

pub use machine::MachineSettings;

/// Settings of one axis: its models in order of preference, and its guard.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisSettings {
    /// Name of the axis in the profile.
    pub name: String,
    /// Models. The first one whose signals are all good is used. Empty before a model has been identified.
    pub models: Vec<Model>,
    /// Bounds of the offset.
    pub guard: GuardSettings,
    /// Time between two decisions of the axis.
    pub every: Duration,
    /// Action if no model can be used.
    pub on_fault: OnFault,
    /// Levels of Cz for a warning, and for the fault action.
    pub levels: Levels,
    /// Datum: zero point from which Cz is measured.
    pub datum: Datum,
    /// Bounds of the slope, if the control multiplies the slope by the distance itself. `None` if it gets Cz.
    pub intercept_slope: Option<InterceptSlope>,
    /// Settings for learning from measured errors; `None` if the axis does not learn.
    pub probe: Option<ProbeSettings>,
}

/// Settings for learning from measured errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeSettings {
    /// Largest correction of a model's Cz, µm.
    pub limit: Micron,
    /// Share of a residual that one probing adds to the offset.
    pub filter: Filter,
    /// Largest accepted error of a model. A probing beyond it is refused.
    pub max_error: Micron,
    /// Residual beyond which an aged model is reported.
    pub warn: Option<Micron>,
    /// Settings for learning the gains of linear models; `None` if they do not learn.
    pub gains: Option<GainSettings>,
    /// Action while probings show that the axis is worse with the model than without compensation.
    pub worse: OnWorse,
}

impl ProbeSettings {
    /// Returns the standard deviation of a probing, µm.
    pub fn scatter(&self) -> f64 {
        match self.filter {
            Filter::Weighed { repeat, .. } => repeat,
            Filter::Share(_) => Filter::REPEAT,
        }
    }
}

/// Action of an axis while probings show that it is worse with its model than without compensation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnWorse {
    /// The axis continues to follow the model, and the result is reported.
    #[default]
    Warn,
    /// Cz goes to zero at the axis's rate, until probings show that the model is better than no compensation.
    Ramp,
}

/// Share of a residual that one probing adds to the offset of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Filter {
    /// Constant share, above 0 and up to 1.
    Share(f64),
    /// Share by the certainty of the offset compared with that of the probing.
    Weighed {
        /// Standard deviation of a probing, µm. Above zero.
        repeat: f64,
        /// Increase of the variance of the offset in each hour, µm²/h. Above zero.
        walk: f64,
    },
}

impl Filter {
    /// Standard deviation of a probing if the profile does not name it, µm.
    pub const REPEAT: f64 = 0.5;
    /// Increase of the variance if the profile does not name it, µm²/h.
    pub const WALK: f64 = 4.0;
}

/// Settings for learning gains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GainSettings {
    /// Weight of earlier probings at the next one, above 0 and up to 1.
    pub forgetting: f64,
    /// Largest relative change of a gain.
    pub limit: f64,
}

/// Two levels of |Cz|, as controls have them (Beckhoff TF5200: warn, error). `warn` ≤ `limit` ≤ `error`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Levels {
    /// Level beyond which one warning is given.
    pub warn: Option<Micron>,
    /// Level beyond which a model is not used. The axis takes its fault action until it is armed again.
    pub error: Option<Micron>,
}

/// Datum: zero point from which the Cz of an axis is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Datum {
    /// Zero of the model itself.
    #[default]
    Model,
    /// Value that the model requested at the last zero command: `Cz(t) − Cz(t_zero)`. A datum measured while the
    /// machine is warm already contains that drift.
    Zero,
}

/// Bounds of a slope that the control applies itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InterceptSlope {
    /// Position P0 at which the slope adds nothing.
    pub reference: Millimetre,
    /// Largest distance of the axis from the reference position. tanβ times this distance obeys the axis's guard.
    pub reach: Millimetre,
    /// One count of the slope's register, as its effect at the reach in µm; `None` if the register takes fractions.
    pub count: Option<Micron>,
}

impl AxisSettings {
    /// Returns true if Cz goes to zero while probings show that the model is worse than no compensation.
    pub fn leaves_what_is_worse(&self) -> bool {
        self.probe.is_some_and(|probe| probe.worse == OnWorse::Ramp)
    }

    /// Returns the update period of an axis that goes to zero. It is as short as the rate requires, but not shorter
    /// than a fieldbus can follow.
    pub fn ramp_period(&self) -> Duration {
        let one_step = self.guard.step.get() / self.guard.rate.get();
        let one_step = Duration::try_from_secs_f64(one_step).unwrap_or(Duration::MAX);
        self.every.min(one_step.max(SHORTEST_PERIOD))
    }

    /// Returns the duration of the fault action from this Cz, without its waiting time.
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

/// Shortest update period of a ramp.
const SHORTEST_PERIOD: Duration = Duration::from_millis(100);

/// Bounds of an offset. All values are positive and finite, except a deadband of zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuardSettings {
    /// Largest absolute value of Cz. The guard never exceeds it.
    pub limit: Micron,
    /// Largest change of one update.
    pub step: Micron,
    /// Largest speed at which Cz changes.
    pub rate: MicronPerSecond,
    /// Smallest change that is made.
    pub deadband: Micron,
    /// One count of the register in µm of Cz; `None` if the register takes fractions.
    pub count: Option<Micron>,
}

/// Action of an axis if its inputs or outputs fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnFault {
    /// Keeps the last value for as long as the fault lasts.
    Hold,
    /// Keeps the value for this time, then goes to zero at the axis's `rate`.
    Ramp {
        /// Time for which the last value is kept.
        after: Duration,
    },
    /// Goes to zero at once, as fast as `step` per update allows.
    Zero,
}
