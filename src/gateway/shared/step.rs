//! One step of the axes with everything around it: arming, controls, the log, what is told.

use super::{Core, Shared};
use crate::gateway::arming::{Arming, Attempt};
use crate::gateway::commissioning::Fit;
use crate::gateway::output::{OutputState, Standing};
use crate::gateway::probing::Probing;
use crate::gateway::words::part;
use crate::observe::events::Event;
use isotherm_core::compensation::{AxisState, Control, Snapshot};
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{AxisId, BusId, Output, OutputId, Profile, Writes};

impl Core {
    pub(super) fn advance(&mut self, shared: &Shared, now: Moment) -> bool {
        let profile = &shared.profile;
        // Where time went back, every axis is due.
        let due = self.next_due.is_some_and(|due| now >= due) || now < self.stepped_at;
        if due {
            self.board.look(profile, now);
            self.arm_where_possible(shared, now);
        }
        let is_urgent = self.refresh_controls(shared, now);
        if !due && !is_urgent && !self.would_notice(profile, now) {
            return false;
        }
        if !due {
            self.board.look(profile, now);
        }
        self.keeper.prepare(now, &self.compensation);
        let snapshot = Snapshot { now, readings: self.board.seen() };
        let stepped = self.compensation.step(&snapshot, &self.controls);
        if !stepped.anything {
            return false;
        }
        (self.stepped_at, self.next_due) = (now, self.compensation.next_due());
        let has_model = |axis| self.compensation.has_usable_model(axis, &snapshot);
        self.has_read = self.has_read || (0..profile.axes.len()).any(has_model);
        self.keeper.record(&snapshot, &self.controls, &self.compensation);
        for axis in 0..self.arming.len() {
            if let Some(decision) = self.compensation.decision(axis).filter(|decision| decision.at == now) {
                if self.controls[axis].takes_over() {
                    (self.arming[axis].take_over, self.arming[axis].take_over_slope) = (None, None);
                }
                let live_until = |model: usize| {
                    let inputs = &shared.dependents.inputs[axis][model];
                    let until = inputs.iter().map(|id| self.board.usable_until(profile, *id));
                    until.min().unwrap_or(Moment::END)
                };
                let soon = now.after(profile.axes[axis].settings.every);
                self.not_after[axis] = match (decision.model, decision.state) {
                    (Some(model), state) if state.is_following() => live_until(model),
                    // It holds because its readings have died: what it decided may go out as long as it might have then.
                    // One whose output is in trouble holds on good ones, as long as they are that.
                    (_, AxisState::Holding(_)) => {
                        let usable = self.compensation.model_value(axis, &snapshot);
                        usable.map_or(self.not_after[axis], |(model, _)| soon.min(live_until(model)))
                    }
                    // A fault action rests on no reading.
                    _ => soon,
                };
            }
        }
        self.disarm_tripped(shared);
        if self.tell_probings(profile, now) {
            self.keeper.remember_now(now, &self.compensation, profile, self.outputs.states());
        }
        self.keeper.remember(now, &self.compensation, profile, self.outputs.states());
        if stepped.noticed.started {
            self.untold.push(Event::MachineStarted);
        }
        if stepped.noticed.zeroed {
            self.untold.push(Event::Zeroed);
        }
        self.tell_signals(shared, now);
        self.tell_axes(shared);
        true
    }

    /// The lines on which something of what was decided at this moment is written, each once.
    pub(super) fn lines_of_decisions(&self, shared: &Shared, now: Moment) -> Vec<BusId> {
        let decided = self.compensation.decisions().zip(&shared.dependents.written_on);
        let decided = decided.filter(|(decision, _)| decision.at == now);
        let mut lines: Vec<BusId> = decided.flat_map(|(_, lines)| lines).copied().collect();
        lines.sort_unstable();
        lines.dedup();
        lines
    }

    /// What the world outside tells each axis, worked out again where it may have changed; whether one of them is to be
    /// stepped for that at once.
    fn refresh_controls(&mut self, shared: &Shared, now: Moment) -> bool {
        let mut is_urgent = false;
        loop {
            let output = self.outputs.next_changed().map(|id| shared.profile.output(id).axis.0);
            let axis = output.or_else(|| self.arming.next_changed()).or_else(|| self.probing.next_changed());
            let Some(axis) = axis else { return is_urgent };
            let arming = &self.arming[axis];
            let permit = arming.permit(&shared.profile, axis, &self.outputs, self.stopping, shared.dry_run);
            let Arming { take_over, take_over_slope, .. } = *arming;
            let Probing { forget, measured, .. } = self.probing[axis];
            self.controls[axis] = Control { permit, take_over, take_over_slope, forget, measured };
            is_urgent |= self.compensation.is_due(axis, now, &self.controls[axis]);
        }
    }

    /// Whether something was read that concerns the machine as a whole: that it runs, or a command to zero.
    fn would_notice(&self, profile: &Profile, now: Moment) -> bool {
        let value = |id| self.board.value(profile, id, now);
        self.compensation.would_notice(value, || self.board.has_usable(profile, now))
    }

    pub(super) fn arm_where_possible(&mut self, shared: &Shared, now: Moment) {
        if self.stopping {
            return;
        }
        for axis in 0..self.arming.len() {
            if self.arming[axis].armed {
                continue;
            }
            let snapshot = Snapshot { now, readings: self.board.seen() };
            let fit = self.commissioning.of_axis(axis);
            let ready = fit == Fit::Yes && self.compensation.has_usable_model(axis, &snapshot);
            let beyond = self.compensation.beyond_error(axis, &snapshot);
            let name = &shared.profile.axes[axis].settings.name;
            let attempt = match fit {
                Fit::No(why) if self.arming[axis].is_wanted(&shared.profile) => Attempt::Refused(why),
                _ => self.arming[axis].attempt(&shared.profile, axis, &self.outputs, ready, beyond),
            };
            match attempt {
                Attempt::NotYet => {}
                Attempt::From(from, take_over_slope) => {
                    let take_over = Some(from);
                    let by_person = self.arming[axis].asked;
                    self.arming[axis] =
                        Arming { armed: true, by_person, take_over, take_over_slope, ..Arming::default() };
                    for place in 0..self.outputs.ids(axis).len() {
                        let id = self.outputs.ids(axis)[place];
                        if self.outputs[id.0].standing == Standing::Foreign {
                            self.outputs[id.0].standing = Standing::Verified;
                        }
                    }
                    self.was_armed = true;
                    self.untold.push(Event::Armed { axis: name.clone(), from });
                }
                Attempt::Refused(why) => {
                    if self.arming[axis].refusal.as_ref() != Some(&why) {
                        self.untold.push(Event::ArmRefused { axis: name.clone(), why: why.clone() });
                        self.arming[axis].refusal = Some(why);
                    }
                }
            }
        }
    }

    /// What an axis decided last stands in its registers, or never will.
    pub(in crate::gateway) fn has_arrived(&self, profile: &Profile, axis: usize, dry_run: bool) -> bool {
        let Some(decision) = self.compensation.decision(axis) else { return true };
        if decision.state == AxisState::Off || dry_run {
            return true;
        }
        let settings = &profile.axes[axis].settings;
        let grain = |output: &Output| match (output.writes, settings.apart) {
            (Writes::Slope, Some(apart)) => apart.count.unwrap_or(Micron::ZERO),
            // A floating-point register is written in thousandths of a step.
            _ => settings
                .guard
                .count
                .or_else(|| Micron::new(settings.guard.step.get() * 1e-3))
                .unwrap_or_default(),
        };
        // What is nearest is at most half a count away; beside an operator's part, whose sum is never made zero, one.
        let slack =
            |state: &OutputState| if state.shares.is_some_and(|(base, _)| base != 0.0) { 1.1 } else { 0.6 };
        let is_there = |output: &Output, state: &OutputState, cz: Micron| {
            let distance = (cz - part(decision, output.writes)).abs().get();
            output.writes == Writes::Reference || distance <= slack(state) * grain(output).get()
        };
        let is_held =
            |id: &OutputId| self.registers[id.0].is_some() && matches!(decision.state, AxisState::Holding(_));
        self.outputs.ids(axis).iter().all(|id| {
            let (output, state) = (profile.output(*id), &self.outputs[id.0]);
            match state.standing {
                // While its axis holds, nothing changes it any more.
                Standing::Verified if is_held(id) => true,
                Standing::Verified => state.cz.is_some_and(|cz| is_there(output, state, cz)),
                // It cannot be written, however long one waits; a position that is not read is not corrected.
                Standing::Interlocked => true,
                _ => !output.writes.is_scheduled(),
            }
        })
    }

    /// Switches an axis off until a person arms it again; what is to be told of that.
    pub(in crate::gateway) fn disarm(&mut self, axis: AxisId, name: &str, why: &str) -> Option<Event> {
        let latched = Arming { latched: true, why: why.to_owned(), ..Arming::default() };
        let was = std::mem::replace(&mut self.arming[axis.0], latched);
        was.armed.then(|| Event::Disarmed { axis: name.to_owned(), why: why.to_owned() })
    }

    /// The same for an axis that is armed; one that is off keeps waiting to be.
    pub(in crate::gateway) fn disarm_unless_off(
        &mut self,
        axis: AxisId,
        name: &str,
        why: &str,
    ) -> Option<Event> {
        if self.arming[axis.0].armed { self.disarm(axis, name, why) } else { None }
    }

    /// An output's register was found to hold this much Cz after it had not been known: the axis goes on from there.
    pub(in crate::gateway) fn found(&mut self, profile: &Profile, id: OutputId, cz: Micron) {
        let axis = profile.output(id).axis.0;
        let writes = profile.output(id).writes;
        let first = self.outputs.ids(axis).iter().find(|id| profile.output(**id).writes == writes);
        if !self.arming[axis].armed || first != Some(&id) {
            return;
        }
        if writes == Writes::Slope {
            self.arming[axis].take_over_slope = Some(cz);
        } else if writes.is_cz() {
            self.arming[axis].take_over = Some(cz);
        }
    }
}
