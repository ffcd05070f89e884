//! Causes of the states of the axes, as text for the operator.

use std::borrow::Cow;

use isotherm_core::compensation::{Decision, Permit, Unusable};
use isotherm_core::explained::Explained;
use isotherm_core::reading::{Quality, Reading, Reason, SignalId};
use isotherm_profile::{Arm, Output, Profile};

use super::arming::{Arming, has_its_reference};
use super::continuity::Devices;
use super::device_health::DeviceHealth;
use super::output::{Outputs, RegisterHealth};
use super::{comparison, extrapolation, stand_in};

/// Cause shown for an axis whose model requested more than the error level.
pub(in crate::gateway) const BEYOND_ERROR: &str = "the model requested more than the error level";
/// Hint for a fault whose cause only an operator can find.
pub(in crate::gateway) const WHEN_FOUND: &str = "arm the axis again when the cause is found";
/// Hint for a sensor that is lost, or frozen (its reading does not change).
pub(super) const SEE_TO_THE_SENSOR: &str = "check the sensor, its cable and its channel";

/// Parts of the gateway's state from which the cause of an axis state is determined.
#[derive(Clone, Copy)]
pub(in crate::gateway) struct CauseInputs<'a> {
    pub(in crate::gateway) profile: &'a Profile,
    pub(in crate::gateway) axis: usize,
    pub(in crate::gateway) arming: &'a Arming,
    pub(in crate::gateway) decision: &'a Decision,
    pub(in crate::gateway) outputs: &'a Outputs,
    pub(in crate::gateway) device_health: &'a DeviceHealth,
    pub(in crate::gateway) devices: &'a Devices,
    /// Readings of all signals, as the last step of the axes used them.
    pub(in crate::gateway) seen: &'a [Reading],
    /// Whether the gateway has detected that the machine is running.
    pub(in crate::gateway) has_run: bool,
    pub(in crate::gateway) stopping: bool,
    pub(in crate::gateway) dry_run: bool,
}

/// Returns why an axis without a model is off.
pub(in crate::gateway) fn unmodelled(profile: &Profile, axis: usize) -> Explained {
    Explained::new("no model yet", how_to_find_a_model(profile, axis))
}

/// Returns a hint on how to identify the model of an axis.
pub fn how_to_find_a_model(profile: &Profile, axis: usize) -> String {
    let (path, name) = (profile.path.display(), &profile.axes[axis].settings.name);
    format!(
        "record runs with `isotherm record {path} --out campaign/`, then find the model and put it into the profile with \
         `isotherm identify {path} campaign/ --axis {name} --into-profile`"
    )
}

impl CauseInputs<'_> {
    /// Returns why an axis does not follow its preferred model; empty if the axis follows the model. The cause
    /// contains no figure that changes all the time, because a changed text would be reported as a new cause.
    pub(in crate::gateway) fn explained(&self) -> Explained {
        let CauseInputs { profile, axis, arming, decision, .. } = *self;
        let has_model = profile.axes[axis].has_model();
        // An axis without a model is armed only for a check of its sign.
        if !has_model && !arming.is_armed() && arming.asked.is_none() {
            return unmodelled(profile, axis);
        }
        let has_own = !profile.axes[axis].settings.own_models().is_empty();
        if has_model && !has_own && decision.model.is_none() && decision.lacks.is_none() {
            let name = &profile.axes[axis].settings.name;
            let path = profile.path.display();
            return Explained::new(
                "no model is adopted yet",
                format!(
                    "probe the axis on some days; then adopt the learned model: isotherm adopt {path} --axis {name}"
                ),
            );
        }
        if let Some(refusal) = arming.refusal.as_ref().filter(|_| arming.is_waiting(profile, axis)) {
            return refusal.clone();
        }
        if arming.is_latched() && arming.asked.is_none() {
            let known = Some(arming.why.clone()).filter(|why| !why.cause.is_empty());
            return known.unwrap_or_else(|| "switched off".into()).or_hint("arm the axis again");
        }
        let permit = arming.permit(profile, axis, self.outputs, self.stopping, self.dry_run);
        if permit == Permit::Stopping {
            return "the gateway is stopping".into();
        }
        let is_well = |standing| match permit {
            Permit::Off => standing == RegisterHealth::Verified,
            _ => matches!(standing, RegisterHealth::Verified | RegisterHealth::Unknown),
        };
        let troubled = self
            .outputs
            .ids(axis)
            .iter()
            .map(|id| (*id, profile.output(*id), &self.outputs[id.0]))
            .find(|(_, output, state)| output.writes.is_scheduled() && !is_well(state.standing))
            .map(|(id, output, state)| {
                let condition = format!("output {} is {}", output.name, state.standing.name());
                let cause = state.cause.filter(|_| state.failures > 0);
                match (state.handshake.failed, cause) {
                    (Some(failed), _) => {
                        Explained::new(format!("{condition}: {}", failed.message()), failed.hint())
                    }
                    (None, Some(seen)) => self
                        .device_health
                        .why_of_output(id, seen)
                        .within(|cause| format!("{condition}: {cause}")),
                    (None, None) => Explained { cause: condition, hint: hint_at(output, state.standing) },
                }
            });
        let displaced = self
            .outputs
            .of_axis(axis)
            .find(|(output, state)| {
                permit == Permit::Unverified && !has_its_reference(profile, output, state)
            })
            .map(|(output, _)| format!("{} lacks the reference position", output.name).into());
        let troubled = troubled.or(displaced);
        if decision.tripped {
            return Explained::new(BEYOND_ERROR, WHEN_FOUND);
        }
        let worse = comparison::cause(&profile.axes[axis].settings, decision);
        if let Some(worse) = worse.filter(|_| permit == Permit::Armed) {
            return worse;
        }
        match (permit, troubled, decision.lacks) {
            (Permit::Unverified | Permit::Held | Permit::Off, Some(troubled), _) => troubled,
            (_, _, Some(lacks)) => self.lacks(lacks),
            (Permit::Off, None, None) if profile.arm == Arm::Manual && arming.asked.is_none() => {
                "not armed yet".into()
            }
            (Permit::Off, None, None) if arming.asked.is_some() => match self.devices.unconfirmed(axis) {
                Some((device, cause)) => {
                    let name = &profile.device(device).name;
                    format!("the settings of {name} are not checked yet: {cause}").into()
                }
                None => "not all devices have answered yet".into(),
            },
            _ => match (&decision.extrapolating, &decision.stood_in) {
                (Some(found), _) if !decision.state.is_following() => extrapolation::cause(profile, found),
                (_, Some(found)) => stand_in::explained(profile, found),
                _ => Explained::default(),
            },
        }
    }

    fn lacks(&self, lacks: Unusable) -> Explained {
        lacking(self.profile, lacks, self.has_run, |id| self.bad(id))
    }

    /// Returns the fault of a signal that the model of an axis needs.
    fn bad(&self, id: SignalId) -> Explained {
        let name = &self.profile.signal(id).name;
        let Some(Quality::Bad(reason)) = self.seen.get(id.0).map(|reading| reading.quality) else {
            return format!("{name} had no good reading").into();
        };
        self.device_health.why(id, reason).within(|cause| match reason {
            Reason::OpenCircuit => format!("{name} has an open circuit"),
            Reason::ShortCircuit => format!("{name} has a short circuit"),
            // The age of a stale value changes with each check.
            Reason::Stale => format!("{name}: {reason}"),
            _ => format!("{name}: {cause}"),
        })
    }
}

/// Returns the reason in a decision why the axis does not follow its model. Empty if the decision contains no reason.
/// `has_run`: whether the machine was running. `bad`: returns the fault of a signal that the model needs.
pub(crate) fn why_by_decision(
    profile: &Profile,
    axis: usize,
    decision: &Decision,
    has_run: bool,
    bad: impl FnOnce(SignalId) -> Explained,
) -> Explained {
    if decision.tripped {
        return Explained::new(BEYOND_ERROR, WHEN_FOUND);
    }
    if let Some(worse) = comparison::cause(&profile.axes[axis].settings, decision) {
        return worse;
    }
    match (decision.lacks, &decision.extrapolating) {
        (Some(lacks), _) if decision.model.is_none() => lacking(profile, lacks, has_run, bad),
        (_, Some(found)) => extrapolation::cause(profile, found),
        _ => Explained::default(),
    }
}

/// Returns why a model cannot be used. `has_run`: whether the machine was running. `bad`: returns the fault of a
/// signal.
fn lacking(
    profile: &Profile,
    lacks: Unusable,
    has_run: bool,
    bad: impl FnOnce(SignalId) -> Explained,
) -> Explained {
    const RUN_IT: &str = "switch the machine on";
    let name = |id: SignalId| &profile.signal(id).name;
    match lacks {
        Unusable::Signal(id) => bad(id),
        Unusable::Reference(id) if !has_run => Explained::new(
            format!("no machine start detected yet, and {} is measured from machine start", name(id)),
            RUN_IT,
        ),
        Unusable::Reference(id) => Explained::new(
            format!("{} has no reference yet", name(id)),
            "wait until `settle` after machine start is over; for a reference \"zero\", capture zero",
        ),
        Unusable::Frozen(id) => Explained::new(
            format!("{} is frozen, and this model has no stand-in for it", name(id)),
            SEE_TO_THE_SENSOR,
        ),
        Unusable::Unproven(id) => format!(
            "{} is valid again, but is not used until it has agreed with the other sensors for one hour",
            name(id)
        )
        .into(),
        Unusable::MachineOff => Explained::new("no machine start detected yet", RUN_IT),
        Unusable::NotANumber => Explained::new(
            "the model result is invalid, because it is not a number",
            "check the coefficients of the model and the values of its signals",
        ),
    }
}

/// Returns a hint for an output that is not verified although none of its requests failed; `None` if there is no
/// hint.
fn hint_at(output: &Output, standing: RegisterHealth) -> Option<Cow<'static, str>> {
    Some(match standing {
        RegisterHealth::Interlocked => {
            let when = output
                .when
                .as_ref()
                .map_or("the condition `when` of the output is true", |when| when.text.as_str());
            format!("the gateway writes again when {when}").into()
        }
        RegisterHealth::Foreign => "correct the value at the control, then arm the axis".into(),
        RegisterHealth::Unverified => "see the alarm of the output".into(),
        RegisterHealth::Unknown | RegisterHealth::Verified => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gateway::store::log::sample;

    #[test]
    fn the_first_clause_of_a_cause_has_at_most_five_words() {
        let (profile, bed) = (sample::profile(), SignalId(0));
        let all = [
            Unusable::Reference(bed),
            Unusable::MachineOff,
            Unusable::Frozen(bed),
            Unusable::Unproven(bed),
            Unusable::NotANumber,
        ];
        for (lacks, has_run) in all.into_iter().flat_map(|lacks| [(lacks, false), (lacks, true)]) {
            let why = lacking(&profile, lacks, has_run, |_| Explained::default());
            let clause = why.cause.split(", ").next().unwrap_or_default();
            assert!((1..=5).contains(&clause.split_whitespace().count()), "{}", why.cause);
        }
    }
}
