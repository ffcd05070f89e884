//! Why an axis does what it does.

use isotherm_core::compensation::{Decision, Permit, Unusable};
use isotherm_core::reading::{Quality, Reading, Reason, SignalId};
use isotherm_profile::{Arm, Profile};

use super::arming::{Arming, has_its_reference};
use super::contact::Contact;
use super::output::{Outputs, Standing};
use super::{extrapolation, stand_in};
use isotherm_profile::counted;

/// What it can be known from.
#[derive(Clone, Copy)]
pub(super) struct Reasons<'a> {
    pub(super) profile: &'a Profile,
    pub(super) axis: usize,
    pub(super) arming: &'a Arming,
    pub(super) decision: &'a Decision,
    pub(super) outputs: &'a Outputs,
    pub(super) contact: &'a Contact,
    /// The readings as they were last looked at.
    pub(super) seen: &'a [Reading],
    /// The machine has been seen running.
    pub(super) has_run: bool,
    pub(super) stopping: bool,
    pub(super) dry_run: bool,
}

/// Why an axis without a model is off.
pub(super) fn unmodelled(profile: &Profile, axis: usize) -> String {
    format!("no model yet: {}", how_to_find_a_model(profile, axis))
}

/// How an axis gets its model.
pub fn how_to_find_a_model(profile: &Profile, axis: usize) -> String {
    let (path, name) = (profile.path.display(), &profile.axes[axis].settings.name);
    format!(
        "record runs with `isotherm record {path} --out campaign/`, find the model with `isotherm identify {path} campaign/ \
         --axis {name} --write model.toml`, and put the block of model.toml into the profile"
    )
}

impl Reasons<'_> {
    /// Why an axis is not following its preferred model; empty where it is.
    pub(super) fn message(&self) -> String {
        let Reasons { profile, axis, arming, decision, .. } = *self;
        if !profile.axes[axis].has_model() {
            return unmodelled(profile, axis);
        }
        if let Some(refusal) = arming.refusal.as_ref().filter(|_| arming.is_waiting(profile, axis)) {
            return refusal.clone();
        }
        if arming.latched && arming.asked.is_none() {
            return format!(
                "{}; arm it again",
                if arming.why.is_empty() { "switched off" } else { &arming.why }
            );
        }
        let permit = arming.permit(profile, axis, self.outputs, self.stopping, self.dry_run);
        if permit == Permit::Stopping {
            return "the gateway is stopping".to_owned();
        }
        let is_well = |standing| match permit {
            Permit::Off => standing == Standing::Verified,
            _ => matches!(standing, Standing::Verified | Standing::Unknown),
        };
        let troubled = self
            .outputs
            .ids(axis)
            .iter()
            .map(|id| (*id, profile.output(*id), &self.outputs[id.0]))
            .find(|(_, output, state)| output.writes.is_scheduled() && !is_well(state.standing))
            .map(|(id, output, state)| {
                let stands = format!("output {} is {}", output.name, state.standing.name());
                let cause = state.cause.filter(|_| state.failures > 0);
                match (state.handshake.failed, cause) {
                    (Some(failed), _) => format!("{stands}: {}", failed.message()),
                    (None, Some(fault)) => {
                        let why = self.contact.why_of_output(id, fault);
                        format!("{stands}, {}: {why}", counted(state.failures, "time"))
                    }
                    (None, None) => stands,
                }
            });
        let displaced = self
            .outputs
            .of_axis(axis)
            .find(|(output, state)| {
                permit == Permit::Unverified && !has_its_reference(profile, output, state)
            })
            .map(|(output, _)| format!("output {} does not hold the reference position yet", output.name));
        let troubled = troubled.or(displaced);
        if decision.tripped {
            return "its model asked for more than the error level".to_owned();
        }
        match (permit, troubled, decision.lacks) {
            (Permit::Unverified | Permit::Held | Permit::Off, Some(troubled), _) => troubled,
            (_, _, Some(lacks)) => self.lacks(lacks),
            (Permit::Off, None, None) if profile.arm == Arm::Manual && arming.asked.is_none() => {
                "nobody has armed it yet".to_owned()
            }
            (Permit::Off, None, None) if arming.asked.is_some() => {
                "its devices have not all been looked at yet".to_owned()
            }
            _ => match (&decision.extrapolating, &decision.stood_in) {
                (Some(found), _) if !decision.state.is_following() => extrapolation::message(profile, found),
                (_, Some(found)) => stand_in::message(profile, found),
                _ => String::new(),
            },
        }
    }

    fn lacks(&self, lacks: Unusable) -> String {
        let name = |id: SignalId| &self.profile.signal(id).name;
        match lacks {
            Unusable::Signal(id) => {
                let quality = self.seen.get(id.0).map(|reading| reading.quality);
                match quality {
                    Some(Quality::Bad(Reason::OpenCircuit)) => format!("{} has an open circuit", name(id)),
                    Some(Quality::Bad(Reason::ShortCircuit)) => format!("{} has a short circuit", name(id)),
                    Some(Quality::Bad(reason)) => {
                        format!("{}: {}", name(id), self.contact.why(id, reason))
                    }
                    _ => format!(
                        "{}: {}",
                        name(id),
                        quality.map_or(String::new(), |quality| quality.to_string())
                    ),
                }
            }
            Unusable::Reference(id) if !self.has_run => {
                format!(
                    "the machine has not been seen running yet, which is what {} is counted from",
                    name(id)
                )
            }
            Unusable::Reference(id) => format!("the reference of {} is not captured yet", name(id)),
            Unusable::Frozen(id) => format!("{} is frozen, and no other sensor stands in for it", name(id)),
            Unusable::Unproven(id) => {
                format!(
                    "{} is back, and not believed until it has agreed with the others for an hour",
                    name(id)
                )
            }
            Unusable::MachineOff => "the machine has not been seen running yet".to_owned(),
            Unusable::NotANumber => "the model's result is not a number".to_owned(),
        }
    }
}
