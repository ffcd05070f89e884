//! State of the gateway that a lock protects, and the step of the axes (calculation of their Cz). A step includes
//! arming, decisions, reports, and the row in the log.

use std::time::Duration;

use super::lock::LockTimes;
use crate::gateway::state::arming::{Arming, ArmingState, Attempt};
use crate::gateway::state::causes::{BEYOND_ERROR, CauseInputs, WHEN_FOUND};
use crate::gateway::state::continuity::Devices;
use crate::gateway::state::dependents::RunConfig;
use crate::gateway::state::device_health::DeviceHealth;
use crate::gateway::state::dirty_vec::DirtyVec;
use crate::gateway::state::learning::AxisLearning;
use crate::gateway::state::output::{OutputState, Outputs, RegisterHealth};
use crate::gateway::state::pause::Pauses;
use crate::gateway::state::probing::{Probing, acting};
use crate::gateway::state::reported_conditions::ReportedConditions;
use crate::gateway::state::restart::Restarts;
use crate::gateway::state::run_phase::RunPhase;
use crate::gateway::state::sign::SignCheck;
use crate::gateway::state::signal_table::SignalTable;
use crate::gateway::state::units::part;
use crate::gateway::store::places::Moves;
use crate::gateway::store::release::Releases;
use crate::gateway::store::storage::Storage;
use crate::observe::events::Event;
use crate::observe::requester::Channel;
use isotherm_core::compensation::reference::Reference;
use isotherm_core::compensation::settings::OnFault;
use isotherm_core::compensation::{
    AxisState, Compensation, Control, Decision, Remembered, ReturnTo, Snapshot,
};
use isotherm_core::continuity::{Continuity, sentence};
use isotherm_core::explained::Explained;
use isotherm_core::output::{Who, farthest_behind};
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::duration_text;
use isotherm_profile::{Arm, AxisId, OnStop, Output, OutputId, Profile, Writes};

mod reports;

/// Minimum time between two reports of the condition for which an axis waits before it is armed.
const WAITING_REPORTED_EVERY: Duration = Duration::from_secs(10);

/// State of the gateway that one lock protects. The tasks of all bus lines use this state.
pub(in crate::gateway) struct GatewayState {
    pub(in crate::gateway) given: RunConfig,
    pub(in crate::gateway) board: SignalTable,
    pub(in crate::gateway) compensation: Compensation,
    pub(in crate::gateway) arming: DirtyVec<Arming>,
    pub(in crate::gateway) probing: DirtyVec<Probing>,
    /// Candidate (proposed learned model) of each axis, and the last reports about the candidate.
    pub(in crate::gateway) learning: Vec<AxisLearning>,
    pub(in crate::gateway) outputs: Outputs,
    /// Controller of the register of each output, as the line task has stored it. `None` for an output that writes a
    /// position plus Cz.
    pub(in crate::gateway) registers: Vec<Option<isotherm_core::output::Controller>>,
    pub(in crate::gateway) device_health: DeviceHealth,
    pub(in crate::gateway) devices: Devices,
    pub(in crate::gateway) places: Moves,
    pub(in crate::gateway) releases: Releases,
    pub(in crate::gateway) storage: Storage,
    pub(in crate::gateway) restarts: Restarts,
    /// Latest time at which a change of the last decision of each axis may be sent. After this time, the readings of
    /// the decision are too old.
    pub(in crate::gateway) not_after: Vec<Moment>,
    pub(in crate::gateway) pauses: Pauses,
    pub(in crate::gateway) phase: RunPhase,
    /// Whether an axis has been armed since the start.
    pub(in crate::gateway) was_armed: bool,
    /// Whether each axis has an output in which an earlier run left a verified offset. `false` after the first arming
    /// of the axis in this run.
    pub(in crate::gateway) was_driven: Vec<bool>,
    /// Whether an axis has had a model with usable readings at any time since the start.
    pub(super) has_read: bool,
    pub(super) stepped_at: Moment,
    /// Time of the next check whether the clock of the computer was set to another time.
    pub(super) day_due: Moment,
    /// Time at which the next axis is due. Without an axis: time of the next report of signals. `None` before the
    /// first such report, and during a stop that moves no axis.
    pub(in crate::gateway) next_due: Option<Moment>,
    /// Requester of the replacement by another program, as a phrase in a sentence. Empty if no replacement was
    /// requested.
    pub(in crate::gateway) replaced_by: String,
    /// Whether an internal fault has occurred. The process then ends with an error after the fault actions.
    pub(in crate::gateway) failed: bool,
    controls: Vec<Control>,
    /// Events that were added under the lock. They are reported when the lock is free again.
    pub(in crate::gateway) events: Vec<Event>,
    pub(in crate::gateway) lock_times: LockTimes,
    pub(in crate::gateway) reported: Vec<ReportedConditions>,
}

impl GatewayState {
    /// Creates the state before the first reading, with the saved state of the previous run.
    pub(in crate::gateway) fn new(
        given: RunConfig,
        remembered: Remembered,
        storage: Storage,
        start: Moment,
    ) -> Self {
        let profile = &given.profile;
        let axes = profile.axes.iter().map(|axis| axis.settings.clone()).collect();
        let compensation = Compensation::new(profile.machine.clone(), axes, remembered);
        GatewayState {
            board: SignalTable::new(profile),
            next_due: compensation.next_due(),
            learning: (0..profile.axes.len())
                .map(|axis| AxisLearning::begin(compensation.preference(axis)))
                .collect(),
            compensation,
            arming: DirtyVec::new(vec![Arming::default(); profile.axes.len()]),
            probing: DirtyVec::new(vec![Probing::default(); profile.axes.len()]),
            outputs: Outputs::new(profile),
            registers: vec![None; profile.outputs.len()],
            device_health: DeviceHealth::new(profile),
            devices: Devices::new(profile, start),
            places: Moves::default(),
            releases: Releases::default(),
            storage,
            restarts: Restarts::new(profile),
            not_after: vec![Moment::default(); profile.axes.len()],
            pauses: Pauses::default(),
            phase: RunPhase::default(),
            was_armed: false,
            was_driven: vec![false; profile.axes.len()],
            has_read: false,
            stepped_at: Moment::default(),
            day_due: Moment::default(),
            replaced_by: String::new(),
            failed: false,
            events: Vec::new(),
            lock_times: LockTimes::default(),
            controls: vec![Control::default(); profile.axes.len()],
            reported: vec![ReportedConditions::default(); profile.axes.len()],
            given,
        }
    }

    /// Steps (calculates) each axis that is due or has a new input. Returns whether an axis was stepped. If the
    /// profile has no axis, reports the changes of the signals when such a report is due.
    pub(in crate::gateway) fn advance(&mut self, now: Moment) -> bool {
        let given = &self.given.clone();
        let RunConfig { profile, dependents, .. } = given;
        // During a stop that keeps the registers, earlier decisions are executed and nothing is decided.
        if self.phase.stop() == Some(OnStop::Hold) {
            return false;
        }
        if let Some(every) = dependents.reports_every {
            self.report_without_axes(profile, every, now);
            return false;
        }
        // If time has gone back, every axis is due.
        let due = self.next_due.is_some_and(|due| now >= due) || now < self.stepped_at;
        if due {
            self.board.check(now);
            self.arm_where_possible(now);
            // The line on which the signals of a probing cycle are read may be idle.
            for axis in &dependents.probed {
                self.take_probing(*axis, now);
            }
        }
        let is_urgent = self.refresh_controls(given, now);
        if !due && !is_urgent && !self.would_notice(now) {
            return false;
        }
        if !due {
            self.board.check(now);
        }
        for axis in 0..self.controls.len() {
            if self.compensation.is_due(axis, now, &self.controls[axis]) {
                self.controls[axis].behind = self.behind(axis);
            }
        }
        self.storage.prepare(now, &self.compensation);
        let snapshot = Snapshot::new(now, self.board.seen());
        let stepped = self.compensation.step(&snapshot, &self.controls);
        if !stepped.anything {
            return false;
        }
        (self.stepped_at, self.next_due) = (now, self.compensation.next_due());
        let has_model = |axis| self.compensation.has_usable_model(axis, &snapshot);
        // The model of an axis that releases a register needs no reading.
        self.has_read = self.has_read || (0..profile.compensated()).any(has_model);
        self.storage.record(&snapshot, &self.controls, &self.compensation);
        for axis in 0..self.arming.len() {
            if let Some(decision) = self.compensation.decision(axis).filter(|decision| decision.at == now) {
                if self.controls[axis].takes_over() {
                    (self.arming[axis].take_over, self.arming[axis].take_over_slope) = (None, None);
                }
                if self.controls[axis].trust {
                    self.arming[axis].trust = false;
                }
                let soon = now.after(profile.axes[axis].settings.every);
                let live_until = |model: usize| {
                    let until = dependents.inputs[axis][model].iter().map(|id| {
                        let Some(others) = self.compensation.predictors(axis, model, *id) else {
                            return self.board.usable_until(*id);
                        };
                        // A mean of one minute stays usable if a single reading is missing.
                        others.map(|id| self.board.usable_until(id)).min().unwrap_or(soon).max(soon)
                    });
                    until.min().unwrap_or(Moment::END)
                };
                self.not_after[axis] = match (decision.model, decision.state) {
                    (Some(model), state) if state.is_following() => live_until(model),
                    // The value to which the axis returns depends on no reading.
                    (_, AxisState::Holding(_)) if self.controls[axis].return_to.is_some() => soon,
                    // Without usable readings, the axis holds: the earlier limit of its decision still applies. With
                    // usable readings, it holds because of its output: the limit is that of the readings.
                    (_, AxisState::Holding(_)) => {
                        let usable = self.compensation.model_value(axis, &snapshot);
                        usable.map_or(self.not_after[axis], |(model, _)| soon.min(live_until(model)))
                    }
                    // A fault action depends on no reading.
                    _ => soon,
                };
            }
        }
        self.disarm_tripped(profile);
        let has_learned = self.report_probings(profile, now);
        let is_adopted = self.report_preferred(profile);
        let is_urgent = self.notes_driven() | has_learned | is_adopted | self.moves_a_position();
        let of_profile = (profile, &self.places.places);
        let seen = (&self.board, self.outputs.states());
        self.storage.remember((now, is_urgent), &self.compensation, of_profile, seen);
        if stepped.noticed.started {
            self.devices.forget_held(profile, Reference::Start);
            self.events.push(Event::MachineStarted);
        }
        if stepped.noticed.zeroed {
            self.devices.forget_held(profile, Reference::Zero);
            self.events.push(Event::Zeroed);
        }
        self.report_signals(profile, now);
        self.report_axes(profile, now);
        true
    }

    /// Records the outputs to which the gateway may write from now on. Returns whether one of these outputs
    /// is new, which means that the gateway has only read its register before.
    fn notes_driven(&mut self) -> bool {
        let GatewayState { places, arming, outputs, given, .. } = self;
        let is_driven = |id: OutputId| {
            let arming = &arming[given.profile.output(id).axis.0];
            arming.is_armed() || arming.sign.is_some() || outputs[id.0].writes > 0
        };
        !given.dry_run && places.drive(&given.profile, is_driven)
    }

    /// Returns whether a new decision changes a corrected position (position plus Cz) by more than one step. The Cz
    /// of the decision is compared with the saved Cz of the output.
    fn moves_a_position(&self) -> bool {
        let profile = &self.given.profile;
        let is_about_to = |axis: usize| {
            let Some(decision) = self.compensation.decision(axis) else { return false };
            let step = profile.axes[axis].settings.guard.step;
            self.outputs.ids(axis).iter().any(|id| {
                let written =
                    self.outputs[id.0].cz.filter(|_| profile.output(*id).writes.position().is_some());
                written.is_some_and(|cz| !self.storage.is_within_a_step(*id, (cz, decision.cz), step))
            })
        };
        (0..profile.axes.len()).any(is_about_to)
    }

    /// Returns whether the gateway is stopping and its axes run their fault actions.
    pub(in crate::gateway) fn runs_fault_actions(&self) -> bool {
        self.phase.stop() == Some(OnStop::FaultAction)
    }

    /// Updates the control inputs of each axis after a change of its output, arming or probing. Returns whether such
    /// an axis must be stepped at once.
    fn refresh_controls(&mut self, given: &RunConfig, now: Moment) -> bool {
        let RunConfig { profile, dry_run, .. } = given;
        let mut is_urgent = false;
        loop {
            let output = self.outputs.next_changed().map(|id| profile.output(id).axis.0);
            let axis = output.or_else(|| self.arming.next_changed()).or_else(|| self.probing.next_changed());
            let Some(axis) = axis else { return is_urgent };
            let arming = &self.arming[axis];
            let permit = arming.permit(profile, axis, &self.outputs, self.runs_fault_actions(), *dry_run);
            let Arming { take_over, take_over_slope, trust, return_to, .. } = *arming;
            let sign = arming.sign.as_ref().and_then(SignCheck::target);
            let Probing { forget, measured, .. } = self.probing[axis];
            let plain = Control { permit, take_over, take_over_slope, sign, trust, ..Control::default() };
            self.controls[axis] = Control { forget, measured, return_to, ..plain };
            is_urgent |= self.compensation.is_due(axis, now, &self.controls[axis]);
        }
    }

    /// Returns whether the axes must be stepped because of an event of the whole machine: the machine has started to
    /// run, or an operator has captured zero.
    fn would_notice(&self, now: Moment) -> bool {
        let value = |id| self.board.value(id, now);
        self.compensation.would_notice(value, || self.board.has_usable(now))
    }

    pub(in crate::gateway) fn arm_where_possible(&mut self, now: Moment) {
        let profile = &*self.given.profile.clone();
        if self.phase.is_stopping() {
            return;
        }
        self.end_requests(now);
        for axis in 0..self.arming.len() {
            if self.arming[axis].is_armed() {
                continue;
            }
            let snapshot = Snapshot::new(now, self.board.seen());
            let found = self.devices.of_axis(axis);
            let has_value =
                !profile.axes[axis].has_model() || self.compensation.has_usable_model(axis, &snapshot);
            let ready = *found == Continuity::Confirmed && has_value;
            let beyond = self.compensation.beyond_error(axis, &snapshot);
            let name = &profile.axes[axis].settings.name;
            let attempt = match found {
                Continuity::Changed(differences) if self.arming[axis].is_wanted(profile, axis) => {
                    Attempt::Refused(sentence(differences).into())
                }
                _ => self.arming[axis].attempt(profile, axis, &self.outputs, ready, beyond),
            };
            match self.releases.assess(AxisId(axis), attempt, |id| self.outputs[id.0].shares) {
                Attempt::NotYet => {}
                Attempt::From(from, take_over_slope) => {
                    let was_driven = std::mem::take(&mut self.was_driven[axis]);
                    let by = self.arming[axis].asked.take().map(|asked| asked.by);
                    let by_person = by.as_ref().is_some_and(|by| by.way != Channel::Restart);
                    let (way, who) = match by {
                        Some(by) => (by.way, by.who.clone()),
                        None if was_driven => (Channel::Restart, "armed before, arm = \"auto\"".to_owned()),
                        None => (Channel::Auto, "arm = \"auto\"".to_owned()),
                    };
                    let trust = self.arming[axis].trust;
                    // A sign check may wait for the axis.
                    let sign = self.arming[axis].sign.take();
                    self.arming[axis] = Arming {
                        state: ArmingState::Armed(if by_person { Who::Person } else { Who::Policy }),
                        take_over: Some(from),
                        take_over_slope,
                        trust,
                        sign,
                        ..Arming::default()
                    };
                    for place in 0..self.outputs.ids(axis).len() {
                        let id = self.outputs.ids(axis)[place];
                        if self.outputs[id.0].standing == RegisterHealth::Foreign {
                            self.outputs[id.0].standing = RegisterHealth::Verified;
                        }
                    }
                    self.was_armed |= !profile.is_release(AxisId(axis));
                    let slope = take_over_slope.unwrap_or(Micron::ZERO);
                    self.devices.armed(axis, ReturnTo { cz: from, slope });
                    if by_person {
                        self.storage.answered();
                    }
                    self.events.push(Event::Armed { axis: name.clone(), from, way, who });
                    if by_person && !self.given.dry_run {
                        let confirmed = self.places.confirm(name, profile);
                        if !confirmed.is_empty() {
                            self.storage.remember_soon();
                        }
                        self.events.extend(confirmed);
                    }
                }
                Attempt::Refused(why) => {
                    if self.arming[axis].refusal.as_ref() != Some(&why) {
                        self.events.push(Event::ArmRefused { axis: name.clone(), why: why.clone() });
                        self.arming[axis].refusal = Some(why.clone());
                    }
                    if self.arming[axis].asked.is_some() {
                        self.end_request(axis, why);
                    }
                }
            }
            self.report_what_it_waits_for(axis, now);
        }
    }

    /// Cancels each request to arm that has expired, or whose requester has disconnected.
    pub(in crate::gateway) fn end_requests(&mut self, now: Moment) {
        for axis in 0..self.arming.len() {
            let Some(asked) = &self.arming[axis].asked else { continue };
            let why = if asked.by.has_left() {
                format!("cancelled: the client that requested to arm has disconnected ({:?})", asked.by)
                    .into()
            } else if now >= asked.until {
                let timeout = duration_text(self.given.profile.arm_timeout);
                let expired = |why: &str| format!("the request to arm has expired after {timeout}: {why}");
                self.why(axis, now).within(expired)
            } else {
                continue;
            };
            self.cancel(axis, why);
        }
    }

    /// Cancels a request to arm, and reports this.
    pub(in crate::gateway) fn cancel(&mut self, axis: usize, why: Explained) {
        let name = self.given.profile.axes[axis].settings.name.clone();
        self.events.push(Event::ArmEnded { axis: name, why: why.clone() });
        self.end_request(axis, why);
    }

    /// Removes a request to arm, for the reason `why`. Until a new request, the axis is armed only if the profile
    /// sets `arm = "auto"`.
    fn end_request(&mut self, axis: usize, why: Explained) {
        let arms_itself = self.given.profile.arm == Arm::Auto && !self.arming[axis].is_latched();
        self.arming[axis].end_request(arms_itself, why);
    }

    /// Reports the condition for which an axis waits before it is armed. Reports only a changed condition, and only
    /// if the last report is long enough ago.
    fn report_what_it_waits_for(&mut self, axis: usize, now: Moment) {
        let Some(asked) = &self.arming[axis].asked else { return };
        if now.since(asked.reported.1) < WAITING_REPORTED_EVERY {
            return;
        }
        let why = self.why(axis, now);
        if why.cause == asked.reported.0 {
            return;
        }
        let name = self.given.profile.axes[axis].settings.name.clone();
        self.events.push(Event::WaitsToArm { axis: name, why: why.clone() });
        if let Some(asked) = &mut self.arming[axis].asked {
            asked.reported = (why.cause, now);
        }
    }

    /// Returns cause and hint for the present state of an axis; empty if there is nothing to explain.
    pub(in crate::gateway) fn why(&self, axis: usize, now: Moment) -> Explained {
        self.reasons(axis, now).map_or_else(Explained::default, |reasons| reasons.explained())
    }

    /// Returns whether the registers of an axis hold its last decision. Also `true` if waiting for the registers has
    /// no effect, for example in a dry run, or while an interlock forbids writes.
    pub(in crate::gateway) fn has_arrived(&self, axis: usize) -> bool {
        let RunConfig { profile, dry_run, .. } = &self.given;
        let Some(decision) = self.compensation.decision(axis) else { return true };
        if decision.state == AxisState::Off || *dry_run {
            return true;
        }
        let is_held =
            |id: &OutputId| self.registers[id.0].is_some() && matches!(decision.state, AxisState::Holding(_));
        self.outputs.ids(axis).iter().all(|id| {
            let (output, state) = (profile.output(*id), &self.outputs[id.0]);
            match state.standing {
                // While its axis holds, no decision changes the register.
                RegisterHealth::Verified if is_held(id) => true,
                RegisterHealth::Verified => {
                    state.cz.is_some_and(|cz| self.is_there(decision, output, state, cz))
                }
                // Waiting does not help an interlocked output, or a corrected position that is not read.
                RegisterHealth::Interlocked => true,
                _ => !output.writes.is_scheduled(),
            }
        })
    }

    /// Returns the verified Cz of the register that differs most from the last decision of the axis. `None` if all
    /// registers hold the decision. Two kinds of registers are ignored: those of a device that does not answer, and
    /// corrected positions, which are written again within milliseconds.
    fn behind(&self, axis: usize) -> Option<Micron> {
        let RunConfig { profile, dry_run, .. } = &self.given;
        let decision = self.compensation.decision(axis).filter(|_| !dry_run)?;
        let waits = |id: &OutputId| {
            let (output, state) = (profile.output(*id), &self.outputs[id.0]);
            let takes_cz =
                output.writes.is_scheduled() && !matches!(output.writes, Writes::Slope | Writes::Reference);
            let cz = state.cz.filter(|_| takes_cz && state.standing == RegisterHealth::Verified)?;
            (!self.is_there(decision, output, state, cz)).then_some(cz)
        };
        farthest_behind(decision.cz, self.outputs.ids(axis).iter().filter_map(waits))
    }

    /// Returns whether the verified Cz equals the decided Cz, to half a count of the register. Always `true` for an
    /// output that writes the reference position P0 (position at which a slope has no effect), because P0 is a
    /// constant.
    fn is_there(&self, decision: &Decision, output: &Output, state: &OutputState, cz: Micron) -> bool {
        output.writes == Writes::Reference
            || state.is_near(&self.given.profile, output, cz, part(decision, output.writes))
    }

    /// Switches an axis off until an operator arms it again.
    pub(in crate::gateway) fn disarm(&mut self, axis: AxisId, why: impl Into<Explained>) {
        let (why, trust) = (why.into(), self.arming[axis.0].trust);
        let latched = Arming { state: ArmingState::Latched, why: why.clone(), trust, ..Arming::default() };
        if std::mem::replace(&mut self.arming[axis.0], latched).is_armed() {
            let axis = self.given.profile.axis(axis).settings.name.clone();
            self.events.push(Event::Disarmed { axis, why });
        }
    }

    /// Handles the first read of a register with an unknown value. The register contains the offset `cz`. Returns
    /// whether the axis continues from this offset.
    pub(in crate::gateway) fn found(&mut self, id: OutputId, cz: Micron) -> bool {
        let profile = &self.given.profile;
        let Output { axis: AxisId(axis), writes, .. } = *profile.output(id);
        let first = self.outputs.ids(axis).iter().find(|id| profile.output(**id).writes == writes);
        if !self.arming[axis].is_armed() || first != Some(&id) {
            return false;
        }
        if let Err(why) = self.releases.admit(id, cz, self.outputs[id.0].shares) {
            self.disarm(AxisId(axis), why);
            return false;
        }
        if writes == Writes::Slope {
            self.arming[axis].take_over_slope = Some(cz);
        } else if writes.is_cz() {
            self.arming[axis].take_over = Some(cz);
        }
        writes.is_cz()
    }

    /// Checks whether the probing cycle of an axis has a new result, and stores or refuses the result.
    /// Returns whether there was a new result.
    pub(super) fn take_probing(&mut self, axis: AxisId, now: Moment) -> bool {
        let (profile, place) = (&*self.given.profile, axis.0);
        let axis = profile.axis(axis);
        let Some(input) = &axis.probe_input else { return false };
        let acting = acting(place, &self.outputs, &self.arming[place]);
        let Some(received) = self.probing[place].check(profile, input, &self.board, now, acting) else {
            return false;
        };
        match received {
            Ok(measured) => self.probing[place].measured = Some(measured),
            Err(missed) => self.events.push(Event::ProbeRefused {
                axis: axis.settings.name.clone(),
                error: None,
                why: missed.message().into(),
            }),
        }
        true
    }

    /// Disarms each axis whose model requested more than the error level, when its fault action has ended. Only an
    /// operator may arm the axis again.
    fn disarm_tripped(&mut self, profile: &Profile) {
        for (place, axis) in profile.axes.iter().enumerate() {
            let Some(decision) = self.compensation.decision(place) else { continue };
            let ended = match decision.state {
                AxisState::Zeroed => true,
                AxisState::Holding(_) => axis.settings.on_fault == OnFault::Hold,
                _ => false,
            };
            let is_tripped = self.arming[place].is_armed() && decision.tripped;
            if self.arming[place].is_tripped() != is_tripped {
                self.arming[place].set_tripped(is_tripped);
            }
            if is_tripped && ended && !self.phase.is_stopping() && self.has_arrived(place) {
                let asked = self.arming[place].asked.clone();
                self.disarm(AxisId(place), Explained::new(BEYOND_ERROR, WHEN_FOUND));
                let trust = self.arming[place].trust;
                self.arming[place] =
                    Arming { state: ArmingState::Latched, asked, trust, ..Arming::default() };
            }
        }
    }

    fn reasons(&self, axis: usize, now: Moment) -> Option<CauseInputs<'_>> {
        Some(CauseInputs {
            profile: &self.given.profile,
            axis,
            arming: &self.arming[axis],
            decision: self.compensation.decision(axis)?,
            outputs: &self.outputs,
            device_health: &self.device_health,
            devices: &self.devices,
            seen: self.board.seen(),
            has_run: self.compensation.machine().on_time(now).is_some(),
            stopping: self.runs_fault_actions(),
            dry_run: self.given.dry_run,
        })
    }
}
