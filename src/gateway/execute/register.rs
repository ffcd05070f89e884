//! Executes the actions of the controller of one output, and gives it the results. Single registers and the members of a set are the
//! same here.

use std::time::Duration;

use super::demand::{Decision, OutputDemand};
use super::failures::{Access, Failures};
use super::{DISK_PATIENCE, LineTurn, REMEMBERED, report};
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{CallerFault, Fault, Outcome};
use crate::fieldbus::explain::advised_on;
use crate::fieldbus::wire::Request;
use crate::gateway::blamed::of_an_output;
use crate::gateway::ledger::{Keeping, Kept};
use crate::gateway::line_handle::LineHandle;
use crate::gateway::storage::Stepped;
use crate::gateway::store::WHAT;
use crate::gateway::units::Units;
use crate::observe::asker::Way;
use crate::observe::events::Event;
use isotherm_core::codec::Encoded;
use isotherm_core::explained::Explained;
use isotherm_core::output::{
    self, Action, AppliedSettings, Cause, Controller, Copies, Demand, Demanded, Fact, Input, NotSent, Rules,
    SetCommit, Settings, State, Trouble, Verify,
};
use isotherm_core::quantity::{Counts, Moment};
use isotherm_profile::{Output, OutputId, Share, Writes};

/// Register of one output.
#[derive(Debug)]
pub(super) struct Register {
    pub(super) id: OutputId,
    pub(super) units: Units,
    pub(super) settings: Settings,
    pub(super) controller: Controller,
    failures: Failures,
    /// Values that may still appear in the register, as they were given to the disk.
    on_disk: Option<Copies>,
    /// Version of the ledger that is being put on disk, and since when.
    keeping: Option<(u64, Moment)>,
}

impl Register {
    pub(super) fn new(shared: &LineHandle, id: OutputId, now: Moment) -> Register {
        let output = shared.profile.output(id);
        let units = Units::of(&shared.profile, output);
        let settings = settings(shared, output, &units);
        let before = shared.core().registers[id.0];
        let controller = match before {
            // The task before this one ended in the middle of something.
            Some(mut controller) => {
                controller.interrupted(&settings, now);
                controller
            }
            None => {
                let state = State::new(&settings, shared.ledger.at_start(output).as_ref(), now);
                Controller::new(&settings, state, shared.pauses(), now)
            }
        };
        let failures = Failures::default();
        Register { id, units, settings, controller, failures, on_disk: None, keeping: None }
    }

    /// The turn begins: gives the controller what is demanded now.
    pub(super) fn begins_turn(&mut self, shared: &LineHandle, demand: &OutputDemand, now: Moment) {
        let demand = self.demand(shared, demand);
        self.step(shared, Input::Demand(demand), now);
    }

    fn demand(&self, shared: &LineHandle, demand: &OutputDemand) -> Demand {
        let output = shared.profile.output(self.id);
        let decision = match demand.decision {
            Decision::Off | Decision::Outdated => None,
            Decision::Current(mode) => Some(mode),
        };
        let decision = decision.map(|mode| {
            let (offset, target) =
                match (output.writes, shared.profile.axis(output.axis).settings.intercept_slope) {
                    // A reference position is no correction, and goes to its value at once.
                    (Writes::Reference, Some(line)) => (self.units.counts(line.reference.get()), None),
                    (Writes::Reference, None) => (self.units.offset(demand.cz), None),
                    _ => (self.units.offset(demand.cz), Some(self.units.offset(demand.target))),
                };
            Demanded { offset, target, at: demand.decided, not_after: demand.not_after, mode }
        });
        Demand {
            armed: demand.armed.filter(|_| !shared.dry_run),
            interlock: demand.interlock,
            decision,
            restarts: demand.restarts,
            pauses: demand.pauses,
        }
    }

    /// Returns whether a value that was sent before is in the register, or can be sent once more: near enough, and on readings that
    /// are good now. Of an output that is not driven nothing is demanded.
    pub(super) fn can_hold_again(&self, value: Counts, demand: &OutputDemand, now: Moment) -> bool {
        if !self.controller.is_driven() || value == self.held() {
            return true;
        }
        let is_near = value.abs_diff(self.held()) <= self.settings.step.unsigned_abs();
        is_near && demand.decision != Decision::Off && now <= demand.not_after
    }

    /// Demands a value once more that was sent before, if the register does not hold it.
    pub(super) fn demand_again(
        &mut self,
        shared: &LineHandle,
        value: Counts,
        demand: &OutputDemand,
        now: Moment,
    ) {
        if !self.controller.is_driven() || value == self.held() {
            return;
        }
        let offset = value - self.settings.bias;
        let fact = Fact::Decided { offset, target: None, not_after: demand.not_after };
        self.step(shared, Input::Fact(fact), now);
    }

    /// Gives the controller an input, and reports its events. The new state outlives this task. The log gets input and action.
    /// Returns why the axis is to resume from the register value, if it is.
    pub(super) fn step(&mut self, shared: &LineHandle, input: Input, now: Moment) -> Option<Cause> {
        let before = self.controller;
        let action = self.controller.step(&self.settings, input, now);
        let resumes = self.report_events(shared);
        let mut core = shared.core();
        let known = &mut core.registers[self.id.0];
        let known = known.replace(self.controller);
        if core.storage.outputs.is_kept() {
            let goes_on = known == Some(before);
            let (settings, after) = (&self.settings, &self.controller);
            let stepped = Stepped { id: self.id, settings, before: &before, goes_on, input, action, after };
            core.storage.outputs.stepped(&stepped, now);
        }
        resumes
    }

    fn report_events(&mut self, shared: &LineHandle) -> Option<Cause> {
        let output = shared.profile.output(self.id);
        let (mut resumes, mut has_restarted) = (None, false);
        for event in self.controller.take_events().iter() {
            let is_foreign = matches!(event, output::Event::ForeignValue { .. });
            if !(has_restarted && is_foreign)
                && let Some(event) = report::event(self, output, *event, &shared.clock)
            {
                shared.report(&event);
            }
            match *event {
                output::Event::CncRestarted { .. } => has_restarted = true,
                output::Event::ForeignValue { expected, found } => {
                    shared.core().disarm(output.axis, report::why_foreign(self, output, expected, found));
                }
                output::Event::Late { not_after } => shared.order_lapsed(self.id, not_after),
                output::Event::Written => shared.core().outputs[self.id.0].writes += 1,
                output::Event::StillUntaken => shared.core().outputs[self.id.0].failures += 1,
                output::Event::Recovered { was_untaken } => self.recovered(shared, output, was_untaken),
                output::Event::NotApplied => report::not_applied(self, shared, output),
                output::Event::Question if !shared.dry_run => {
                    shared.report(&report::question(self, &output.name));
                    let hint = "do what the alarm of its output says, then arm it";
                    let why = Explained::new("what of its register is ours is in question", hint);
                    shared.core().disarm(output.axis, why);
                }
                output::Event::TakeOver { cause } => resumes = Some(cause),
                _ => {}
            }
        }
        resumes
    }

    fn recovered(&self, shared: &LineHandle, output: &Output, was_untaken: bool) {
        let mut core = shared.core();
        let failures = std::mem::take(&mut core.outputs[self.id.0].failures);
        if was_untaken {
            core.events.push(Event::Verified { output: output.name.clone(), failures });
        }
    }

    /// The set that it is in is refreshed as a whole.
    pub(super) fn in_a_set(mut self) -> Register {
        self.settings.refresh = None;
        self
    }

    /// The control has taken what its registers hold, or has not.
    pub(super) fn commits(&mut self, shared: &LineHandle, commit: SetCommit, now: Moment) {
        if self.controller.is_bound() != (commit != SetCommit::Taken) {
            self.step(shared, Input::Set(commit), now);
        }
    }

    pub(super) fn state(&self) -> &State {
        self.controller.state()
    }

    pub(super) fn action(&self) -> Action {
        self.controller.action()
    }

    /// Whether a read of the whole set may go to the output step. An open interlock rejects every value, and another
    /// action of the step may still be open.
    pub(super) fn may_hear_a_read(&self) -> bool {
        match self.action() {
            Action::Read => true,
            Action::Nothing { .. } => !self.state().is_interlocked(),
            Action::Keep | Action::Write { .. } => false,
        }
    }

    pub(super) fn is_writing(&self) -> bool {
        matches!(self.action(), Action::Write { .. })
    }

    /// After the next read it asks for a write, if that shows nothing new.
    pub(super) fn may_write(&self, now: Moment) -> bool {
        self.state().may_write(&self.settings, now)
    }

    /// Its next step waits for what may still arrive.
    pub(super) fn is_waiting_for_late(&self) -> bool {
        self.state().shown(&self.settings).waits_until.is_some()
    }

    /// Register value as last verified.
    pub(super) fn held(&self) -> Counts {
        self.controller.held(&self.settings)
    }

    /// The registers that hold this value. `None` if the control would read something else, or more than the limit: its
    /// axis is off then, until a person arms it.
    pub(super) fn admitted(&self, shared: &LineHandle, value: Counts) -> Option<Encoded> {
        let base = self.state().shown(&self.settings).account.map(|account| account.base);
        let encoded = self.units.admitted(value, base, self.held());
        encoded.map_err(|why| report::not_sent(shared, self.id, why)).ok()
    }

    /// Gives the controller the result of an exchange.
    pub(super) fn result(&mut self, turn: &LineTurn<'_>, input: Input) {
        let (shared, now) = (turn.shared, turn.line.looked());
        if turn.line.departure.has_stood_still() {
            self.step(shared, Input::Fact(Fact::Paused), now);
        }
        self.failures.result(input);
        self.step(shared, input, now);
    }

    /// A request of the register failed. A write that failed while the axis is off only went along with others.
    pub(super) fn fail(&mut self, shared: &LineHandle, fault: Fault, access: Access) {
        if access == Access::Write && !self.controller.is_armed() {
            return;
        }
        let in_words = || of_an_output(&shared.profile, self.id, fault);
        let reported = self.failures.fails(fault, access, in_words);
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        (state.failures, state.cause) = (state.failures + 1, Some(fault));
        let output = || shared.profile.output(self.id).name.clone();
        let device = shared.profile.device(shared.profile.output(self.id).device);
        let transport = shared.profile.bus(device.bus).transport;
        core.events.extend(reported.map(|words| advised_on(transport, fault, words)).map(
            |fault| match access {
                Access::Read => Event::ReadFailed { output: output(), fault },
                Access::Write => Event::WriteFailed { output: output(), fault },
            },
        ));
    }

    /// Result of a write that was not answered as done.
    pub(super) fn failed(
        &mut self,
        shared: &LineHandle,
        (fault, outcome): (Fault, Outcome),
        left: Moment,
    ) -> Input {
        if fault.has_lapsed() && outcome == Outcome::NotDone {
            return match fault {
                Fault::Caller(CallerFault::TooLate) => Input::NotSent(NotSent::TooLate),
                _ => Input::Fact(Fact::NotSent),
            };
        }
        self.fail(shared, fault, Access::Write);
        match outcome {
            Outcome::NotDone if fault.is_refusal() => Input::Fact(Fact::Refused),
            Outcome::NotDone if fault.spoils_connection() => Input::NotSent(NotSent::Unreachable),
            Outcome::NotDone => Input::NotSent(NotSent::Rejected),
            _ => Input::Fact(Fact::Unknown { left }),
        }
    }

    /// Asks the control what it applies, if that is due. Returns when it is due again.
    pub(super) async fn read_applied(&mut self, turn: &mut LineTurn<'_>) -> Moment {
        let output = turn.shared.profile.output(self.id);
        let asked = turn.line.looked();
        if let Some(applied) = &output.applied
            && asked >= self.controller.applied_due(&self.settings)
        {
            let request =
                Request::Read { from: applied.address, count: applied.encoding.data_type.registers() };
            let input = match turn.line.request(output.device, request, Leave::Whenever).await {
                Ok(answered) => {
                    let found = applied.encoding.decode(answered.answer.registers()).ok();
                    turn.shared.core().outputs[self.id.0].applied =
                        found.map(|found| (found, answered.asked));
                    Input::Applied { found: found.and_then(|found| self.units.thousandths(found)), asked }
                }
                Err(fault) => {
                    self.fail(turn.shared, fault, Access::Read);
                    Input::AppliedNoAnswer { asked }
                }
            };
            self.step(turn.shared, input, turn.line.looked());
        }
        self.controller.applied_due(&self.settings)
    }

    /// The turn ends.
    pub(super) fn ends_turn(&mut self, turn: &LineTurn<'_>, demand: &OutputDemand) {
        let resumes = self.step(turn.shared, Input::TurnEnds, turn.line.looked());
        self.publish(turn.shared, demand, resumes);
    }

    /// Shows the register to the axes and to people, and lets the axis resume from its value.
    pub(super) fn publish(&mut self, shared: &LineHandle, demand: &OutputDemand, resumes: Option<Cause>) {
        let output = shared.profile.output(self.id);
        let copies = *self.state().copies();
        let is_open = report::has_unanswered(self.state()) || copies.lately().next().is_some();
        let open = is_open.then_some(copies);
        let is_known = self.state().shown(&self.settings).verified.is_some();
        if is_known && std::mem::replace(&mut self.on_disk, open) != open {
            // In time for the next start, however this run ends. No line waits for it.
            let _ = shared.ledger.keep(output, self.state().kept(), false);
        }
        let mut core = shared.core();
        let Some(cz) = report::show(self, demand, &mut core.outputs[self.id.0]) else { return };
        let Some(cause) = resumes else { return };
        if core.found(self.id, cz) && cause == Cause::Restart {
            let axis = shared.profile.axis(output.axis).settings.name.clone();
            core.events.push(Event::GoesOn { axis, from: cz, way: Way::Restart });
        }
        drop(core);
        shared.wake_others(shared.profile.device(output.device).bus);
    }

    /// Has what is known put on disk. `None` if the disk has not answered: the next turn asks it again.
    pub(super) async fn keep(&mut self, turn: &mut LineTurn<'_>) -> Option<Input> {
        let (shared, now) = (turn.shared, turn.line.looked());
        if shared.dry_run {
            return Some(Input::Fact(Fact::Kept));
        }
        let output = shared.profile.output(self.id);
        let is_new = self.keeping.is_none();
        let (version, since) = match self.keeping {
            Some(keeping) => keeping,
            None => {
                // What is only noted is on disk before the next promise is.
                match shared.ledger.keep(
                    output,
                    self.state().kept(),
                    self.controller.must_keep(&self.settings),
                ) {
                    Keeping::Version(version) => (version, now),
                    Keeping::Needless => return Some(Input::Fact(Fact::Kept)),
                    Keeping::Impossible => return Some(Input::Fact(Fact::NotKept)),
                }
            }
        };
        self.keeping = Some((version, since));
        let timeout = shared.profile.bus(shared.profile.device(output.device).bus).timeout;
        let span = if is_new { timeout } else { Duration::ZERO };
        turn.line.departure.away_for(span);
        let kept = shared.ledger.kept(version, span).await;
        let now = turn.line.look();
        if kept == Kept::NotYet && now.since(since) < DISK_PATIENCE {
            return None;
        }
        self.keeping = None;
        if kept == Kept::Yes {
            return Some(Input::OnDisk);
        }
        if kept == Kept::NotYet && self.controller.trouble() != Some(Trouble::Disk) {
            let why = Explained::new(
                format!("the disk has not answered for {} s", DISK_PATIENCE.as_secs()),
                "is it full, slow or broken?",
            );
            shared.report(&Event::NotKept { what: WHAT.to_owned(), why });
        }
        Some(Input::Fact(Fact::NotKept))
    }
}

fn settings(shared: &LineHandle, output: &Output, units: &Units) -> Settings {
    let profile = &shared.profile;
    let device = profile.device(output.device);
    // A constant may arrive whenever it likes.
    let is_constant = output.writes == Writes::Reference;
    let late = if is_constant { Duration::ZERO } else { profile.bus(device.bus).late };
    let can_be_read = device.functions.reads_at(&output.reads_at());
    let (step, limit, bias) = units.bounds(profile, output);
    let applied = output.applied.as_ref().map(|applied| AppliedSettings {
        tolerance: units.thousandths_of(applied.tolerance),
        settle: applied.settle,
    });
    Settings {
        step,
        limit,
        bias,
        range: units.range(),
        late,
        remembered: late.saturating_mul(REMEMBERED),
        every: profile.axis(output.axis).settings.every,
        refresh: output.refresh,
        is_shared: output.share == Share::Ledger,
        verify: if can_be_read { Verify::Reading } else { Verify::Echo },
        applied,
        rules: Rules::default(),
    }
}
