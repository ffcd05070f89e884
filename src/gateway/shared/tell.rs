//! What changed in a step, as events; and why an axis does what it does, in words.

use super::{Core, Shared};
use crate::gateway::arming::has_its_reference;
use crate::gateway::board::Change;
use crate::gateway::extrapolation;
use crate::gateway::output::Standing;
use crate::observe::events::Event;
use isotherm_core::compensation::{Permit, Unusable};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::{Reason, SignalId};
use isotherm_profile::Arm;

impl Core {
    pub(super) fn tell_signals(&mut self, shared: &Shared, now: Moment) {
        for change in self.board.changes(now) {
            match change {
                // The device or the bus has been told already.
                Change::Lost(_, reason) | Change::Back(_, reason, _)
                    if matches!(reason, Reason::LinkDown | Reason::Timeout | Reason::BadReply) => {}
                Change::Lost(id, reason) => {
                    let signal = shared.profile.signal(id).name.clone();
                    self.untold.push(Event::SignalBad { signal, reason: reason.to_string() });
                }
                Change::Rereferenced(id, from, to) => {
                    let signal = shared.profile.signal(id);
                    let (signal, unit) = (signal.name.clone(), signal.unit.to_string());
                    self.untold.push(Event::Rereferenced { signal, unit, from, to });
                }
                Change::Back(id, _, since) => {
                    let signal = shared.profile.signal(id).name.clone();
                    self.untold.push(Event::SignalGood { signal, bad_for: now.since(since) });
                }
            }
        }
    }

    pub(super) fn tell_axes(&mut self, shared: &Shared) {
        for (axis, settings) in shared.profile.axes.iter().enumerate() {
            let Some(decision) = self.compensation.decision(axis) else { continue };
            let name = &settings.settings.name;
            if self.told_states[axis].name() != decision.state.name() {
                self.untold.push(Event::AxisState {
                    axis: name.clone(),
                    from: self.told_states[axis].name(),
                    to: decision.state.name(),
                    why: self.why(shared, axis),
                });
                self.told_states[axis] = decision.state;
            }
            self.levels[axis].tell(&settings.settings, decision, &mut self.untold);
            let told = extrapolation::event(&shared.profile, name, decision, &mut self.extrapolating[axis]);
            self.untold.extend(told);
        }
    }

    /// Why an axis is not following its preferred model, in words; empty where it is.
    pub(in crate::gateway) fn why(&self, shared: &Shared, axis: usize) -> String {
        let Some(decision) = self.compensation.decision(axis) else { return String::new() };
        let arming = &self.arming[axis];
        if let Some(refusal) = &arming.refusal {
            return refusal.clone();
        }
        if arming.latched && !arming.asked {
            return format!(
                "{}; arm it again",
                if arming.why.is_empty() { "switched off" } else { &arming.why }
            );
        }
        let permit = arming.permit(&shared.profile, axis, &self.outputs, self.stopping, shared.dry_run);
        if permit == Permit::Stopping {
            return "the gateway is stopping".to_owned();
        }
        let is_well = |standing| match permit {
            Permit::Off => standing == Standing::Verified,
            _ => matches!(standing, Standing::Verified | Standing::Unknown),
        };
        let troubled = self
            .outputs
            .of_axis(&shared.profile, axis)
            .find(|(output, state)| output.writes.is_scheduled() && !is_well(state.standing))
            .map(|(output, state)| {
                let stands = format!("output {} is {}", output.name, state.standing.name());
                let cause = state.cause.filter(|_| state.failures > 0);
                match (state.handshake.failed, cause) {
                    (Some(failed), _) => format!("{stands}: {failed}"),
                    (None, Some(fault)) => format!("{stands}: {fault}, {} times", state.failures),
                    (None, None) => stands,
                }
            });
        let displaced = self
            .outputs
            .of_axis(&shared.profile, axis)
            .find(|(output, state)| {
                permit == Permit::Unverified && !has_its_reference(&shared.profile, output, state)
            })
            .map(|(output, _)| format!("output {} does not hold the reference position yet", output.name));
        let troubled = troubled.or(displaced);
        if decision.tripped {
            return "its model asked for more than the error level".to_owned();
        }
        match (permit, troubled, decision.lacks) {
            (Permit::Unverified | Permit::Held | Permit::Off, Some(words), _) => words,
            (_, _, Some(lacks)) => self.lacks(shared, lacks),
            (Permit::Off, None, None) if shared.profile.arm == Arm::Manual => "waits to be armed".to_owned(),
            _ => match &decision.extrapolating {
                Some(found) if !decision.state.is_following() => extrapolation::words(&shared.profile, found),
                _ => String::new(),
            },
        }
    }

    fn lacks(&self, shared: &Shared, lacks: Unusable) -> String {
        let name = |id: SignalId| &shared.profile.signal(id).name;
        match lacks {
            Unusable::Signal(id) => {
                let seen = self.board.seen().get(id.0);
                format!("{}: {}", name(id), seen.map_or(String::new(), |reading| reading.quality.to_string()))
            }
            Unusable::Reference(id) if self.compensation.machine().on_time(shared.clock.now()).is_none() => {
                format!(
                    "the machine has not been seen running yet, which is what {} is counted from",
                    name(id)
                )
            }
            Unusable::Reference(id) => format!("the reference of {} is not captured yet", name(id)),
            Unusable::MachineOff => "the machine has not been seen running yet".to_owned(),
            Unusable::NotANumber => "the model's result is not a number".to_owned(),
        }
    }
}
