//! Arming of an axis: the conditions for arming, the Cz (compensation value) from which the axis starts, and the
//! permit that depends on its outputs.

use std::sync::Arc;

use isotherm_core::compensation::{Permit, ReturnTo};
use isotherm_core::display::Intent;
use isotherm_core::explained::Explained;
use isotherm_core::output::Who;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{Arm, Output, Profile, Share, Writes};

use super::output::{OutputState, Outputs, RegisterHealth};
use super::sign::SignCheck;
use super::units::cz_factor;
use crate::observe::requester::Requester;

/// Reason shown for an axis that an operator has switched off.
pub(in crate::gateway) const BY_A_PERSON: &str = "switched off by a person";

/// Request to arm that waits for a condition.
#[derive(Clone, Debug)]
pub(in crate::gateway) struct ArmRequest {
    pub(in crate::gateway) by: Arc<Requester>,
    /// Time at which the request to arm expires.
    pub(in crate::gateway) until: Moment,
    /// Last reported condition for which the request waits, and the time of that report.
    pub(in crate::gateway) reported: (String, Moment),
    /// Cz (compensation value) of the axis in the previous gateway process. The axis starts from this Cz if its
    /// registers give no Cz. `None` if the request does not come from a handover.
    pub(in crate::gateway) from: Option<Micron>,
}

/// Arming state of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gateway) enum ArmingState {
    /// The axis is off. With `arm = "auto"`, the gateway arms it as soon as possible.
    #[default]
    Off,
    /// The axis was switched off, for example by an operator or after an external write. The axis stays off until an
    /// operator arms it.
    Latched,
    /// The axis is armed, by the request of an operator or by the profile.
    Armed(Who),
    /// The axis is armed, and the model requested more than the error level. The axis is switched off when the fault
    /// action has ended.
    Tripped(Who),
}

/// Arming of one axis: its state, its open requests, and the values from which its next step continues.
#[derive(Clone, Debug, Default)]
pub(in crate::gateway) struct Arming {
    pub(in crate::gateway) state: ArmingState,
    pub(in crate::gateway) why: Explained,
    /// Request to arm that waits for a condition; `None` if no request waits.
    pub(in crate::gateway) asked: Option<ArmRequest>,
    /// Running sign check with a dial gauge; `None` if no check runs.
    pub(in crate::gateway) sign: Option<SignCheck>,
    /// Reason why the last sign check ended before the operator answered.
    pub(in crate::gateway) sign_ended: Option<Explained>,
    /// Reason for the last refused attempt to arm. The same reason is not reported a second time.
    pub(in crate::gateway) refusal: Option<Explained>,
    /// Cz from which the next step of the axis continues, for example the value of its register. `None` if the step
    /// continues from the last decision.
    pub(in crate::gateway) take_over: Option<Micron>,
    /// Effect from which the next step of the slope continues, if the control applies a slope itself. The effect is
    /// the value in µm at the axis's largest distance from the reference position.
    pub(in crate::gateway) take_over_slope: Option<Micron>,
    /// Cz to which the axis returns, because the settings of one of its sensors were changed. The Cz is from the time
    /// before the change.
    pub(in crate::gateway) return_to: Option<ReturnTo>,
    /// Whether the next step accepts the sensors of the axis again, because an operator has switched the axis off and
    /// checked the sensors.
    pub(in crate::gateway) trust: bool,
}

/// Result of an attempt to arm an axis.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::gateway) enum Attempt {
    /// The axis is not armed in this step. It is already armed, or arming is not requested, or a register value or
    /// reading is missing.
    NotYet,
    /// The axis may be armed. Contains the Cz and the effect of the slope from which the axis starts.
    From(Micron, Option<Micron>),
    Refused(Explained),
}

impl Arming {
    /// Returns the requester that armed the axis. `None` if the axis is off.
    pub(in crate::gateway) fn armed_by(&self) -> Option<Who> {
        match self.state {
            ArmingState::Armed(by) | ArmingState::Tripped(by) => Some(by),
            ArmingState::Off | ArmingState::Latched => None,
        }
    }

    /// Returns whether the axis is armed.
    pub(in crate::gateway) fn is_armed(&self) -> bool {
        self.armed_by().is_some()
    }

    /// Returns whether the axis stays off until an operator arms it.
    pub(in crate::gateway) fn is_latched(&self) -> bool {
        self.state == ArmingState::Latched
    }

    /// Returns whether the axis is armed, but its model requested more than the error level.
    pub(in crate::gateway) fn is_tripped(&self) -> bool {
        matches!(self.state, ArmingState::Tripped(_))
    }

    /// Records whether the model of an armed axis requests more than the error level.
    pub(in crate::gateway) fn set_tripped(&mut self, is_tripped: bool) {
        if let Some(by) = self.armed_by() {
            self.state = if is_tripped { ArmingState::Tripped(by) } else { ArmingState::Armed(by) };
        }
    }

    /// Ends the request to arm. If `arms_itself` is false, an axis that is off stays off until an operator requests
    /// arming again.
    pub(in crate::gateway) fn end_request(&mut self, arms_itself: bool, why: Explained) {
        self.asked = None;
        if !self.is_armed() {
            self.state = if arms_itself { ArmingState::Off } else { ArmingState::Latched };
        }
        self.why = why;
    }

    /// Returns whether a sign check moves the axis now. The axis then does not follow its model.
    pub(in crate::gateway) fn is_moved_by_sign_check(&self) -> bool {
        self.sign.as_ref().is_some_and(|check| check.target().is_some())
    }

    /// Returns whether the gateway must arm the axis as soon as possible. An axis without a model is armed only for a
    /// sign check.
    pub(in crate::gateway) fn is_wanted(&self, profile: &Profile, axis: usize) -> bool {
        match profile.arm {
            _ if !profile.axes[axis].has_model() => self.asked.is_some() && self.sign.is_some(),
            Arm::Auto => !self.is_latched() || self.asked.is_some(),
            Arm::Manual => self.asked.is_some(),
        }
    }

    /// Returns whether the axis is off on purpose: an operator switched it off, or `arm = "manual"` and no operator has
    /// armed it.
    pub(in crate::gateway) fn is_left_off(&self, profile: &Profile) -> bool {
        let is_wished =
            if self.is_latched() { self.why.cause == BY_A_PERSON } else { profile.arm == Arm::Manual };
        !self.is_armed() && self.asked.is_none() && is_wished
    }

    /// Returns whether the axis is off and will be armed as soon as possible.
    pub(in crate::gateway) fn is_waiting(&self, profile: &Profile, axis: usize) -> bool {
        !self.is_armed() && self.is_wanted(profile, axis)
    }

    /// Returns the intent of the axis for the display: be armed, follow the model, or move for a sign check.
    /// The result is [`Intent::Unmodelled`] for an axis without a model, unless its sign is checked.
    pub(in crate::gateway) fn intent(&self, profile: &Profile, axis: usize) -> Intent {
        match self.sign {
            None if !profile.axes[axis].has_model() => Intent::Unmodelled,
            _ if self.is_waiting(profile, axis) => Intent::Arm,
            Some(_) => Intent::CheckSign,
            None => Intent::Follow,
        }
    }

    pub(in crate::gateway) fn attempt(
        &self,
        profile: &Profile,
        axis: usize,
        outputs: &Outputs,
        ready: bool,
        beyond_error: Option<Micron>,
    ) -> Attempt {
        if self.is_armed() || !self.is_wanted(profile, axis) || !ready {
            return Attempt::NotYet;
        }
        if let Some(wanted) = beyond_error {
            let name = &profile.axes[axis].settings.name;
            return Attempt::Refused(Explained::new(
                format!("the model requests {wanted}, more than axis.{name}.error"),
                "find the cause first, for example a faulty sensor",
            ));
        }
        let (mut from, mut from_slope) = (None, None);
        for (output, state) in outputs.of_axis(axis) {
            if !output.writes.is_scheduled() {
                continue;
            }
            match (state.standing, state.cz) {
                (RegisterHealth::Verified | RegisterHealth::Foreign, Some(_))
                    if output.writes == Writes::Reference => {}
                (RegisterHealth::Verified | RegisterHealth::Foreign, Some(cz)) => {
                    let limit = profile.axes[axis].settings.guard.limit;
                    let is_beyond = is_beyond_limit(profile, output, cz);
                    let axis = &profile.axes[axis].settings.name;
                    if is_beyond && output.share == Share::Ledger {
                        return Attempt::Refused(Explained::new(
                            format!(
                                "the gateway share in the register of output {} is {cz}, beyond the limit of \
                                 ±{limit}",
                                output.name
                            ),
                            format!("raise axis.{axis}.limit until the gateway share has returned to zero"),
                        ));
                    }
                    if is_beyond {
                        // With a bias, zero is not the count 0.
                        let zero = match output.encoding.bias {
                            0 => "zero".to_owned(),
                            bias => format!("zero (register value {bias})"),
                        };
                        return Attempt::Refused(Explained::new(
                            format!("{} holds {cz}, beyond the limit of ±{limit}", output.name),
                            format!("set the register to {zero} at the CNC, or raise axis.{axis}.limit"),
                        ));
                    }
                    if output.writes == Writes::Slope {
                        from_slope = from_slope.or(Some(cz));
                    } else {
                        from = from.or(Some(cz));
                    }
                }
                _ => return Attempt::NotYet,
            }
        }
        if from_slope.is_some_and(|slope| slope != Micron::ZERO) {
            let displaced =
                |(output, state): &(&Output, &OutputState)| !has_its_reference(profile, output, state);
            if let Some((output, _)) = outputs.of_axis(axis).find(displaced) {
                return Attempt::Refused(Explained::new(
                    format!(
                        "the control applies a slope, but with another reference position than output {} writes",
                        output.name
                    ),
                    "set the slope to zero at the CNC",
                ));
            }
        }
        let handed_over = self.asked.as_ref().and_then(|asked| asked.from);
        Attempt::From(from.or(handed_over).unwrap_or(Micron::ZERO), from_slope)
    }

    /// Returns the permit of the axis for its next step: off, armed, unverified, held or stopping. In a dry run, the
    /// reference position P0 is not written, so the axis does not wait until P0 is written.
    pub(in crate::gateway) fn permit(
        &self,
        profile: &Profile,
        axis: usize,
        outputs: &Outputs,
        stopping: bool,
        dry_run: bool,
    ) -> Permit {
        if !self.is_armed() {
            return Permit::Off;
        }
        if stopping {
            return Permit::Stopping;
        }
        let mut permit = Permit::Armed;
        for (output, state) in outputs.of_axis(axis) {
            match state.standing {
                RegisterHealth::Unverified => return Permit::Unverified,
                RegisterHealth::Unknown if output.writes.is_scheduled() => return Permit::Unverified,
                // The control must have the reference position before a slope is applied.
                _ if !dry_run && !has_its_reference(profile, output, state) => return Permit::Unverified,
                RegisterHealth::Interlocked if output.writes.is_scheduled() => permit = Permit::Held,
                _ => {}
            }
        }
        permit
    }
}

/// Returns whether the Cz in a register is beyond the limit of its axis. To allow for rounding, the limit plus half a
/// count still counts as the limit. The reference position P0 is not a correction, and has no limit.
fn is_beyond_limit(profile: &Profile, output: &Output, cz: Micron) -> bool {
    let limit = profile.axis(output.axis).settings.guard.limit.get();
    let slack = match output.encoding.data_type.integer_range() {
        Some(_) => 0.5 * output.encoding.scale.get().abs() / cz_factor(profile, output),
        // Rounding error of a number in the 24 bits of a float.
        None => limit * f64::from(f32::EPSILON),
    };
    output.writes != Writes::Reference && cz.abs().get() > limit + slack
}

/// Returns whether the register for the reference position P0 contains P0, to half a count. Returns `true` for an
/// output that does not write P0.
pub(super) fn has_its_reference(profile: &Profile, output: &Output, state: &OutputState) -> bool {
    let apart = profile.axis(output.axis).settings.intercept_slope;
    let (Writes::Reference, Some(apart)) = (output.writes, apart) else { return true };
    let near = output.encoding.scale.get().abs() * 0.501;
    state.value.is_some_and(|value| (value - apart.reference.get()).abs() <= near)
}
