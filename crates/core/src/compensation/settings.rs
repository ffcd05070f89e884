//! Settings of the machine and its axes, from the profile. Cz is the compensation value of an axis. A probing measures
//! the error that remains.

use std::time::Duration;

use super::model::Model;
use crate::quantity::{Micron, MicronPerSecond, Millimetre};

mod machine;

pub use machine::MachineSettings;

/// Settings of one axis: its models in order of preference, and the limits on its Cz.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisSettings {
    /// Name of the axis in the profile.
    pub name: String,
    /// Models in order of preference. The axis uses the first model whose signals are all good. Empty before a model
    /// has been identified.
    pub models: Vec<Model>,
    /// Bounds of Cz and its changes: limit, step, rate, deadband and count.
    pub guard: GuardSettings,
    /// Time between two decisions of the axis.
    pub every: Duration,
    /// Action if no model can be used, or a write cannot be verified.
    pub on_fault: OnFault,
    /// Two absolute values of Cz: beyond `warn` the axis gives a warning, beyond `error` it runs its fault action.
    pub levels: Levels,
    /// Datum: zero point from which Cz is measured.
    pub datum: Datum,
    /// Bounds of the slope if the control multiplies the slope by the distance itself. `None` if the control gets Cz
    /// only.
    pub intercept_slope: Option<InterceptSlope>,
    /// Settings for correcting the models with measured errors; `None` if the profile has no probing for the axis.
    pub probe: Option<ProbeSettings>,
    /// Model whose gains are learned while the gateway runs; `None` if the axis does not learn.
    pub learned: Option<LearnedSlot>,
}

/// Model of an axis whose gains are learned while the gateway runs. Its gains in the settings are zero.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LearnedSlot {
    /// Index of the learned model in the axis's list of models.
    pub model: usize,
    /// Fingerprint (hash) of the other models of the axis. A learned model is used only together with these models.
    pub own: String,
}

/// Settings for correcting an axis's models with measured errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeSettings {
    /// Largest absolute correction of a model's Cz, µm.
    pub limit: Micron,
    /// Rule for the fraction of a residual that one probing adds to the correction.
    pub filter: Filter,
    /// Largest accepted residual error of a model. A probing with a larger residual error is refused.
    pub max_error: Micron,
    /// Residual error beyond which the model is reported as aged; `None` if it is never reported.
    pub warn: Option<Micron>,
    /// Settings for correcting the gains of linear models; `None` if gains are not corrected.
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
    /// The axis continues to follow the model. The result of the comparison is reported.
    #[default]
    Warn,
    /// Cz goes to zero at the axis's rate, and stays zero until probings show that the model is better than no
    /// compensation.
    Ramp,
}

/// Rule for the fraction of a residual that one probing adds to the correction of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Filter {
    /// Constant fraction of the residual, above 0 and up to 1.
    Share(f64),
    /// Fraction that depends on two variances: the variance of the correction, and the variance of the probing.
    Weighed {
        /// Standard deviation of a probing, µm. Above zero.
        repeat: f64,
        /// Increase of the variance of the correction in each hour, µm²/h. Above zero.
        walk: f64,
    },
}

impl Filter {
    /// Default of the standard deviation of a probing, µm, for a profile that does not state it.
    pub const REPEAT: f64 = 0.5;
    /// Default of the increase of a correction's variance in each hour, µm²/h, for a profile that does not state it.
    pub const WALK: f64 = 4.0;

    /// Returns the standard deviation of a probing, µm. A filter with a constant fraction has no such setting; the
    /// default is returned for it.
    #[must_use]
    pub const fn repeat(self) -> f64 {
        match self {
            Filter::Share(_) => Filter::REPEAT,
            Filter::Weighed { repeat, .. } => repeat,
        }
    }
}

/// Settings for correcting the gains of linear models with probings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GainSettings {
    /// Factor that each probing applies to the weight of all earlier probings, above 0 and up to 1.
    pub forgetting: f64,
    /// Largest relative correction of a gain: 0.3 allows ±30 %.
    pub limit: f64,
}

/// Two levels of |Cz|, `warn` and `error`, as in controls (Beckhoff TF5200). The limit of Cz is between the levels:
/// `warn` ≤ `limit` ≤ `error`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Levels {
    /// Absolute value of Cz beyond which one warning is given; `None` for no warning.
    pub warn: Option<Micron>,
    /// Absolute value of Cz beyond which a model is not used. The axis then runs its fault action until it is armed
    /// again.
    pub error: Option<Micron>,
}

/// Datum: zero point from which the Cz of an axis is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Datum {
    /// Cz is the value that the model requests.
    #[default]
    Model,
    /// Cz is measured from the value at the last zero command: `Cz(t) − Cz(t_zero)`. A workpiece zero that is set on a
    /// warm machine already contains the drift up to that time.
    Zero,
}

/// Bounds of a slope that the control applies itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InterceptSlope {
    /// Position P0 at which the slope adds nothing.
    pub reference: Millimetre,
    /// Largest distance of the axis from the reference position. The limits of the axis apply to tanβ times this
    /// distance.
    pub reach: Millimetre,
    /// One count of the slope's register, converted to its effect at the distance `reach`, µm. `None` if the register
    /// accepts fractions.
    pub count: Option<Micron>,
}

impl AxisSettings {
    /// Returns the models of the profile: all models except the learned model.
    pub fn own_models(&self) -> &[Model] {
        let own = self.learned.as_ref().map_or(self.models.len(), |slot| slot.model);
        self.models.get(..own).unwrap_or(&self.models)
    }

    /// Returns whether Cz goes to zero while probings show that the model is worse than no compensation.
    pub fn leaves_what_is_worse(&self) -> bool {
        self.probe.is_some_and(|probe| probe.worse == OnWorse::Ramp)
    }

    /// Returns the update period of an axis whose Cz goes to zero. The period is as short as the rate requires, but not
    /// shorter than a fieldbus can follow.
    pub fn ramp_period(&self) -> Duration {
        let one_step = self.guard.step.get() / self.guard.rate.get();
        let one_step = Duration::try_from_secs_f64(one_step).unwrap_or(Duration::MAX);
        self.every.min(one_step.max(SHORTEST_PERIOD))
    }

    /// Returns the time that the fault action takes to bring this Cz to zero, not counting its waiting time. Zero if
    /// the action keeps the value.
    pub fn time_to_rest(&self, cz: Micron) -> Duration {
        let period = self.ramp_period();
        let a_step_each = self.guard.step.get() / period.as_secs_f64();
        let speed = match self.on_fault {
            OnFault::Hold if !self.models.is_empty() => return Duration::ZERO,
            OnFault::Zero => a_step_each,
            // An axis without a model never keeps the value of a sign check.
            OnFault::Hold | OnFault::Ramp { .. } => a_step_each.min(self.guard.rate.get()),
        };
        let way = Duration::try_from_secs_f64(cz.abs().get() / speed).unwrap_or(Duration::MAX);
        way.saturating_add(period * 2)
    }
}

/// Shortest update period of an axis whose Cz goes to zero.
const SHORTEST_PERIOD: Duration = Duration::from_millis(100);

/// Bounds of Cz and its changes. All values are positive and finite, except a deadband of zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuardSettings {
    /// Largest absolute value of Cz that is written.
    pub limit: Micron,
    /// Largest change of Cz at one update.
    pub step: Micron,
    /// Largest speed at which Cz changes.
    pub rate: MicronPerSecond,
    /// Smallest change of Cz that is made. The axis ignores a smaller change of its target.
    pub deadband: Micron,
    /// One count of the register in µm of Cz; `None` if the register accepts fractions.
    pub count: Option<Micron>,
}

/// Action of an axis if its inputs or outputs fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnFault {
    /// The axis keeps its last Cz for as long as the fault lasts.
    Hold,
    /// The axis keeps its last Cz for this time. Then Cz goes to zero at the axis's `rate`.
    Ramp {
        /// Time for which the axis keeps its last Cz.
        after: Duration,
    },
    /// Cz goes to zero at once, by one `step` at each update.
    Zero,
}
