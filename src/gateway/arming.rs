//! When an axis may decide: arming, what it takes over, and what its outputs allow.

use std::sync::Arc;

use isotherm_core::compensation::{Permit, ReturnTo};
use isotherm_core::display::Intent;
use isotherm_core::explained::Explained;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{Arm, Output, Profile, Share, Writes};

use super::output::{OutputState, Outputs, Standing};
use super::sign::SignCheck;
use super::units::is_beyond_limit;
use crate::observe::asker::Asker;

/// Why an axis is off that a person switched off.
pub(super) const BY_A_PERSON: &str = "switched off by a person";

/// A request to arm that could not be served yet.
#[derive(Clone, Debug)]
pub(super) struct ArmRequest {
    pub(super) by: Arc<Asker>,
    /// When it expires.
    pub(super) until: Moment,
    /// What it waits for as it was reported last, and when that was.
    pub(super) reported: (String, Moment),
    /// Cz as the gateway before this one had it, where no register says what stands there.
    pub(super) from: Option<Micron>,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Arming {
    pub(super) armed: bool,
    /// A person, or a foreign change, switched it off: it stays off until a person arms it.
    pub(super) latched: bool,
    pub(super) why: Explained,
    /// A person asked for it, and had his way.
    pub(super) by_person: bool,
    /// Its model asked for more than the error level: it is switched off when the fault action has come to its end.
    pub(super) tripped: bool,
    /// A person asked for it and it could not be done yet.
    pub(super) asked: Option<ArmRequest>,
    /// Its sign is being checked with a dial gauge.
    pub(super) sign: Option<SignCheck>,
    /// Why the last attempt was refused; reported once.
    pub(super) refusal: Option<Explained>,
    /// To be taken over at the next step.
    pub(super) take_over: Option<Micron>,
    /// The same for a slope that the control applies: its effect at the axis's reach.
    pub(super) take_over_slope: Option<Micron>,
    /// Cz before the settings of one of its sensors were changed.
    pub(super) return_to: Option<ReturnTo>,
    /// A person has switched it off, and has looked: its sensors are believed at the next step.
    pub(super) trust: bool,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Attempt {
    /// Not wanted now, or something is not known yet.
    NotYet,
    /// It may start from this Cz, and this effect of its slope.
    From(Micron, Option<Micron>),
    Refused(Explained),
}

impl Arming {
    /// Whether the axis shall be armed as soon as it can be. One without a model never is.
    pub(super) fn is_wanted(&self, profile: &Profile, axis: usize) -> bool {
        match profile.arm {
            _ if !profile.axes[axis].has_model() => false,
            Arm::Auto => !self.latched || self.asked.is_some(),
            Arm::Manual => self.asked.is_some(),
        }
    }

    /// It is off because people want it so: one has switched it off, or is to arm it first.
    pub(super) fn is_left_off(&self, profile: &Profile) -> bool {
        let is_wished = if self.latched { self.why.cause == BY_A_PERSON } else { profile.arm == Arm::Manual };
        !self.armed && self.asked.is_none() && is_wished
    }

    /// It would be armed if that could be done.
    pub(super) fn is_waiting(&self, profile: &Profile, axis: usize) -> bool {
        !self.armed && self.is_wanted(profile, axis)
    }

    /// What people want of the axis.
    pub(super) fn intent(&self, profile: &Profile, axis: usize) -> Intent {
        match self.sign {
            _ if !profile.axes[axis].has_model() => Intent::Unmodelled,
            _ if self.is_waiting(profile, axis) => Intent::Arm,
            Some(_) => Intent::CheckSign,
            None => Intent::Follow,
        }
    }

    pub(super) fn attempt(
        &self,
        profile: &Profile,
        axis: usize,
        outputs: &Outputs,
        ready: bool,
        beyond_error: Option<Micron>,
    ) -> Attempt {
        if self.armed || !self.is_wanted(profile, axis) || !ready {
            return Attempt::NotYet;
        }
        if let Some(wanted) = beyond_error {
            let name = &profile.axes[axis].settings.name;
            return Attempt::Refused(Explained::new(
                format!("its model asks for {wanted}, more than axis.{name}.error"),
                "look for the sensor or the cause first",
            ));
        }
        let (mut from, mut from_slope) = (None, None);
        for (output, state) in outputs.of_axis(axis) {
            if !output.writes.is_scheduled() {
                continue;
            }
            match (state.standing, state.cz) {
                (Standing::Verified | Standing::Foreign, Some(_)) if output.writes == Writes::Reference => {}
                (Standing::Verified | Standing::Foreign, Some(cz)) => {
                    let limit = profile.axes[axis].settings.guard.limit;
                    let is_beyond = is_beyond_limit(profile, output, cz);
                    let axis = &profile.axes[axis].settings.name;
                    if is_beyond && output.share == Share::Ledger {
                        return Attempt::Refused(Explained::new(
                            format!(
                                "our share in the register of output {} is {cz}, beyond the limit of ±{limit}",
                                output.name
                            ),
                            format!("raise axis.{axis}.limit until it has gone back to zero"),
                        ));
                    }
                    if is_beyond {
                        // With a bias, zero is not the count 0.
                        let zero = match output.encoding.bias {
                            0 => "zero".to_owned(),
                            bias => format!("zero, which is {bias} there,"),
                        };
                        return Attempt::Refused(Explained::new(
                            format!(
                                "the register of output {} holds {cz}, beyond the limit of ±{limit}",
                                output.name
                            ),
                            format!("set it to {zero} at the CNC, or raise axis.{axis}.limit"),
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
                        "a slope is in effect about another reference position than output {} writes",
                        output.name
                    ),
                    "set the slope to zero at the CNC",
                ));
            }
        }
        let handed_over = self.asked.as_ref().and_then(|asked| asked.from);
        Attempt::From(from.or(handed_over).unwrap_or(Micron::ZERO), from_slope)
    }

    /// What the axis may do now. In a dry run no reference position is ever written, and none is waited for.
    pub(super) fn permit(
        &self,
        profile: &Profile,
        axis: usize,
        outputs: &Outputs,
        stopping: bool,
        dry_run: bool,
    ) -> Permit {
        if !self.armed {
            return Permit::Off;
        }
        if stopping {
            return Permit::Stopping;
        }
        let mut permit = Permit::Armed;
        for (output, state) in outputs.of_axis(axis) {
            match state.standing {
                Standing::Unverified => return Permit::Unverified,
                Standing::Unknown if output.writes.is_scheduled() => return Permit::Unverified,
                // No slope is brought in before the control knows what it is measured from.
                _ if !dry_run && !has_its_reference(profile, output, state) => return Permit::Unverified,
                Standing::Interlocked if output.writes.is_scheduled() => permit = Permit::Held,
                _ => {}
            }
        }
        permit
    }
}

/// An output that writes the reference position holds it, to half a count.
pub(super) fn has_its_reference(profile: &Profile, output: &Output, state: &OutputState) -> bool {
    let apart = profile.axis(output.axis).settings.intercept_slope;
    let (Writes::Reference, Some(apart)) = (output.writes, apart) else { return true };
    let near = output.encoding.scale.get().abs() * 0.501;
    state.value.is_some_and(|value| (value - apart.reference.get()).abs() <= near)
}
