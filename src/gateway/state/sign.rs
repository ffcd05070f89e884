//! Sign of an axis: the direction in which Cz (compensation value) moves the axis. The types contain the running
//! check with a dial gauge, and the saved results of earlier checks.

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::observe::requester::Requester;
use crate::observe::status::{DialDirection, SignStatus};
use isotherm_core::compensation::settings::GuardSettings;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{Profile, Writes};

/// Distance by which a sign check changes Cz, µm. A dial gauge shows this distance clearly, and the movement does not
/// spoil a workpiece.
pub(in crate::gateway) const WAY: f64 = 5.0;
/// Time in which the operator must answer, after Cz has reached the value at which the gauge is read. Without an
/// answer, Cz returns to its earlier value.
pub const PATIENCE: Duration = Duration::from_secs(180);

/// Sign check that is running.
#[derive(Clone, Debug)]
pub(in crate::gateway) struct SignCheck {
    pub(in crate::gateway) by: Arc<Requester>,
    pub(in crate::gateway) stage: SignStage,
    /// Time at which the check ends if the operator has not answered. Cz then returns to its earlier value.
    pub(in crate::gateway) until: Moment,
}

/// Stage of a sign check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::gateway) enum SignStage {
    /// The check waits until the axis compensates and its registers hold Cz.
    Waits,
    /// The axis has no model, and its register did not hold zero. Cz returns to zero, and the check then ends. The
    /// operator must set the gauge again, because the gauge has also shown the return to zero.
    ReturnsToZero,
    /// Cz moves to the value at which the gauge is read.
    Moves(SignMove),
    /// The registers hold the Cz at which the operator may read the gauge.
    Reached(SignMove),
}

/// Movement of a sign check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::gateway) struct SignMove {
    pub(in crate::gateway) from: Micron,
    /// Cz at which the gauge is read.
    pub(in crate::gateway) to: Micron,
}

/// Saved result of the sign check of an axis. The result is part of the saved state.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::gateway) struct SignMemory {
    /// Whether the operator was reminded to check the sign of the axis.
    #[serde(default)]
    reminded: bool,
    /// Time and result of the last sign check that an operator has answered. `None` if no check was answered.
    pub(in crate::gateway) checked: Option<(String, DialDirection)>,
}

impl SignMemory {
    /// Returns `true` if the operator must be reminded, because the sign of the axis was never checked. Returns
    /// `true` only once.
    pub(in crate::gateway) fn reminds(&mut self) -> bool {
        self.checked.is_none() && !std::mem::replace(&mut self.reminded, true)
    }
}

impl SignMove {
    /// Returns the movement of a sign check from this Cz, by [`WAY`] in the plus direction.
    pub(in crate::gateway) fn beginning_at(from: Micron) -> SignMove {
        SignMove { from, to: Micron::new(from.get() + WAY).unwrap_or(from) }
    }

    /// Returns the change of Cz during the movement, with its sign.
    pub(in crate::gateway) fn way(self) -> Micron {
        self.to - self.from
    }
}

impl SignCheck {
    /// Returns the Cz that the check requests in place of the value of the model; `None` if the check does not move
    /// the axis.
    pub(in crate::gateway) fn target(&self) -> Option<Micron> {
        match self.stage {
            SignStage::Waits | SignStage::ReturnsToZero => None,
            SignStage::Moves(moved) | SignStage::Reached(moved) => Some(moved.to),
        }
    }

    /// Returns the status of the check for the display.
    pub(in crate::gateway) fn status(&self, profile: &Profile, axis: usize, now: Moment) -> SignStatus {
        let moved = match self.stage {
            SignStage::Waits | SignStage::ReturnsToZero => SignMove::beginning_at(Micron::ZERO),
            SignStage::Moves(moved) | SignStage::Reached(moved) => moved,
        };
        SignStatus {
            asked: self.by.way.by(&self.by.who),
            by_um: moved.way().get(),
            there: matches!(self.stage, SignStage::Reached(_)),
            expires_s: self.until.since(now).as_secs_f64(),
            must: must(profile, axis, moved.way()),
        }
    }
}

/// Returns a text about the movement that a gauge or the readout must show in the sign check of an axis.
pub fn sign_expectation(profile: &Profile, axis: usize) -> String {
    must(profile, axis, SignMove::beginning_at(Micron::ZERO).way())
}

/// Returns whether this Cz of a register, in µm, counts as zero. The sign check of an axis without a model begins at
/// zero.
pub fn is_at_zero(profile: &Profile, axis: usize, cz: f64) -> bool {
    let guard = &profile.axes[axis].settings.guard;
    Micron::new(cz).is_some_and(|cz| is_at(guard, cz, Micron::ZERO))
}

/// Returns a text about the direction in which a gauge or the readout must move when Cz changes by `way`.
pub(in crate::gateway) fn must(profile: &Profile, axis: usize, way: Micron) -> String {
    let axis_name = &profile.axes[axis].settings.name;
    let of_axis = || profile.outputs.iter().filter(|output| output.axis.0 == axis);
    let mut texts = Vec::new();
    if of_axis().any(|output| matches!(output.writes, Writes::Offset | Writes::Intercept)) {
        let (way, um) = if way < Micron::ZERO { ("minus", way.abs()) } else { ("plus", way) };
        texts.push(format!(
            "the tool must have moved by {um} in {way} direction of {axis_name}, relative to the workpiece"
        ));
    }
    if of_axis().any(|output| matches!(output.writes, Writes::Corrected { .. })) {
        let mm = way.get() / 1000.0;
        texts.push(format!("the readout of {axis_name} must show {mm:+.3} mm, with the machine at rest"));
    }
    texts.join("; ")
}

/// Returns why these settings and this Cz do not permit the movement of a sign check. `None` if they permit it.
pub(in crate::gateway) fn refused(guard: &GuardSettings, from: Micron, axis: &str) -> Option<String> {
    let beyond = (from.get() + WAY).abs() > guard.limit.get();
    if beyond {
        let limit = guard.limit;
        return Some(format!("Cz is {from}, and +{WAY} µm would be beyond axis.{axis}.limit of {limit}"));
    }
    let grain = guard.deadband.get().max(guard.count.map_or(0.0, Micron::get));
    (grain > WAY / 2.0).then(|| {
        format!(
            "axis.{axis}.deadband, or one count of its register, is {grain} µm: too coarse for a step of \
             +{WAY} µm"
        )
    })
}

/// Returns the longest time in which the Cz of an axis without a model returns to zero after its sign check.
pub(in crate::gateway) fn time_to_zero(guard: &GuardSettings, every: Duration, cz: Micron) -> Duration {
    let speed = (guard.step.get() / every.as_secs_f64()).min(guard.rate.get());
    let way = Duration::try_from_secs_f64(cz.abs().get() / speed).unwrap_or(PATIENCE);
    // The first step is due after one period, and the register holds the last one within another.
    way.saturating_add(every * 2)
}

/// Returns whether `cz` equals `place`, to the resolution of Cz: the deadband, or one count of the register if a
/// count is larger.
pub(in crate::gateway) fn is_at(guard: &GuardSettings, cz: Micron, place: Micron) -> bool {
    let grain = guard.deadband.get().max(guard.count.map_or(0.0, Micron::get));
    (cz - place).abs().get() <= grain * 1.001 + 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gateway::state::test_profiles::{THREE_SIGNALS, bench};

    #[test]
    fn the_return_to_zero_is_limited_by_step_or_rate() {
        let time = |step: f64, rate: f64| {
            let axis = format!(
                "{THREE_SIGNALS}\n[axis.z]\nlimit = 20.0\nstep = {step:?}\nrate = {rate:?}\nevery = \"1s\"\n\
                 on_fault = {{ action = \"hold\" }}\n"
            );
            let settings = bench(&axis).axes[0].settings.clone();
            time_to_zero(&settings.guard, settings.every, Micron::new(-5.0).unwrap()).as_secs_f64()
        };
        assert!((time(1.0, 10.0) - 7.0).abs() < 1e-9, "{}", time(1.0, 10.0));
        assert!((time(5.0, 0.5) - 12.0).abs() < 1e-9, "{}", time(5.0, 0.5));
    }
}
