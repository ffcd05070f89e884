//! What is known of the register of one output: what has happened elsewhere goes in as facts, what is to be done next
//! comes out. Single registers and the members of a set are the same here.

use std::time::Duration;

use super::applied::AppliedOffset;
use super::interlock::Interlock;
use super::order::Order;
use super::trouble::{Access, Trouble, Troubles};
use super::{DISK_PATIENCE, LineTurn, REMEMBERED, report};
use crate::fieldbus::error::{CallerFault, Fault, Outcome};
use crate::fieldbus::explain::advised_on;
use crate::gateway::blamed::of_an_output;
use crate::gateway::ledger::{Keeping, Kept};
use crate::gateway::line_handle::LineHandle;
use crate::gateway::storage::Stepped;
use crate::gateway::store::WHAT;
use crate::gateway::units::Units;
use crate::observe::asker::Way;
use crate::observe::events::Event;
use isotherm_core::codec::Encoded;
use isotherm_core::output::{
    self, Action, Copies, Fact, Rules, Settings, Standing, State, Verify, Who, step,
};
use isotherm_core::quantity::{Counts, Moment};
use isotherm_profile::{Output, OutputId, Share, Writes};

#[derive(Debug)]
pub(super) struct Register {
    pub(super) id: OutputId,
    pub(super) units: Units,
    pub(super) settings: Settings,
    pub(super) state: State,
    /// What it takes and asks for is logged.
    is_logged: bool,
    pub(super) action: Action,
    pub(super) heard: Heard,
    pub(super) interlock: Interlock,
    pub(super) applied: AppliedOffset,
    pub(super) troubles: Troubles,
    /// What may still appear in the register, where that was given to the disk.
    on_disk: Option<Copies>,
    /// What is being put on disk, and since when.
    keeping: Option<(u64, Moment)>,
    /// It goes on from what stands there, which is not what was decided.
    goes_on_from_there: bool,
    /// The control was restarted since it last did.
    was_restarted: bool,
    is_saturated: bool,
    /// What stood there when its axis began to hold something else.
    held_at: Option<Counts>,
    /// The operator was asked how the register value divides into operator offset and gateway share.
    has_asked: bool,
    /// The gateway reports the division of the register value as soon as that is on disk.
    opens: bool,
    /// What was decided in this turn is to change the register.
    pub(super) is_to_be_changed: bool,
    /// A change waits for what may still arrive.
    is_waiting: bool,
    /// Its turn came too late for what was decided last.
    pub(super) is_late: bool,
    /// What was sent with it is not taken yet: nothing else may be sent.
    pub(super) is_bound: bool,
    /// The control does not apply yet what stands there: nothing else is sent.
    pub(super) is_unapplied: bool,
}

#[derive(Debug, Default)]
pub(super) struct Heard {
    restarts: u64,
    pauses: u64,
    pub(super) is_armed: bool,
    decided: Moment,
}

impl Register {
    pub(super) fn new(shared: &LineHandle, id: OutputId, now: Moment) -> Register {
        let output = shared.profile.output(id);
        let units = Units::of(&shared.profile, output);
        let settings = settings(shared, output, &units);
        let before = shared.core().registers[id.0];
        let kept = shared.ledger.at_start(output);
        let state = before.map(|state| taken_up(state, &settings, now));
        let state = state.unwrap_or_else(|| State::new(&settings, kept.as_ref(), now));
        let mut heard = Heard { pauses: shared.pauses(), ..Heard::default() };
        if before.is_some() {
            heard.restarts = shared.core().restarts.of(id);
            heard.is_armed = state.shown(&settings).standing == Standing::Armed;
        }
        let interlock = Interlock::held(state.is_interlocked());
        Register {
            id,
            units,
            settings,
            state,
            is_logged: shared.core().storage.outputs.is_kept(),
            action: Action::Nothing { until: now },
            heard,
            interlock,
            applied: AppliedOffset::default(),
            troubles: Troubles::default(),
            on_disk: None,
            keeping: None,
            goes_on_from_there: false,
            was_restarted: false,
            is_saturated: false,
            held_at: None,
            has_asked: false,
            opens: false,
            is_to_be_changed: false,
            is_waiting: false,
            is_late: false,
            is_bound: false,
            is_unapplied: false,
        }
    }

    /// What has happened elsewhere since the last turn.
    pub(super) fn hear(&mut self, shared: &LineHandle, order: &Order, now: Moment) {
        if std::mem::replace(&mut self.heard.pauses, order.pauses) != order.pauses {
            self.step(shared, Fact::Paused, now);
        }
        if std::mem::replace(&mut self.heard.restarts, order.restarts) != order.restarts {
            self.step(shared, Fact::Restarted, now);
        }
        let is_armed = order.armed && !shared.dry_run;
        if std::mem::replace(&mut self.heard.is_armed, is_armed) != is_armed {
            let axis = shared.profile.output(self.id).axis.0;
            let by = if shared.core().arming[axis].by_person { Who::Person } else { Who::Policy };
            self.has_asked &= !is_armed;
            // A device that does not answer is still one.
            self.troubles.now = self.troubles.now.filter(|trouble| *trouble == Trouble::Link);
            self.step(shared, if is_armed { Fact::Armed { by } } else { Fact::Off }, now);
        }
        // Whatever happened while its interlock was open, the axis goes on from what stands there then.
        if self.interlock.hear(shared, self.id, self.heard.is_armed, order.allowed) {
            let is_held = self.interlock.is_held;
            self.step(shared, if is_held { Fact::Interlocked } else { Fact::Released }, now);
            self.goes_on_from_there |= !is_held;
        }
        self.is_to_be_changed = false;
        // Until it decides again, it is the first in turn then.
        self.is_late &= is_armed;
        let decides = is_armed
            && !self.is_bound
            && !self.is_unapplied
            && !order.off
            && !order.outdated
            && order.allowed == Some(true);
        if decides && std::mem::replace(&mut self.heard.decided, order.decided) != order.decided {
            self.decide(shared, order, now);
        }
        self.step(shared, Fact::Look, now);
    }

    /// Another decision. An axis that holds decides nothing: it goes on from what stands there.
    fn decide(&mut self, shared: &LineHandle, order: &Order, now: Moment) {
        self.is_late = false;
        let output = shared.profile.output(self.id);
        // A reference position is a constant.
        let offset = match (output.writes, shared.profile.axis(output.axis).settings.intercept_slope) {
            (Writes::Reference, Some(line)) => self.units.counts(line.reference.get()),
            _ => self.units.offset(order.cz),
        };
        self.report_saturated(shared, output, offset);
        let stands = self.state.shown(&self.settings).verified.map(|seen| seen.value);
        let is_changed = !self.state.is_at(&self.settings, offset);
        // What it holds while its register does not take it is tried again.
        if is_changed
            && order.holds
            && output.writes != Writes::Reference
            && self.troubles.now != Some(Trouble::Untaken)
        {
            self.goes_on_from_there |= std::mem::replace(&mut self.held_at, stands) != stands;
            return;
        }
        self.held_at = None;
        if self.troubles.now == Some(Trouble::Disk) {
            // When that is over, the axis goes on from what stands there.
            return;
        }
        if is_changed && now > order.not_after {
            return self.lapsed(shared, order);
        }
        self.is_to_be_changed = is_changed;
        // A reference position is no correction, and goes to its value at once.
        let target = (output.writes != Writes::Reference).then(|| self.units.offset(order.target));
        self.step(shared, Fact::Decided { offset, target, not_after: order.not_after }, now);
    }

    /// What was sent before stands there, or can be sent once more: near enough, and on readings that are good now; of one
    /// that is not driven nothing is wanted.
    pub(super) fn can_hold_again(&self, value: Counts, order: &Order, now: Moment) -> bool {
        if !self.is_driven() || value == self.stands() {
            return true;
        }
        let is_near = value.abs_diff(self.stands()) <= self.settings.step.unsigned_abs();
        is_near && !order.off && now <= order.not_after
    }

    /// What was sent before is wanted once more, where it does not stand there.
    pub(super) fn wants_again(&mut self, shared: &LineHandle, value: Counts, order: &Order, now: Moment) {
        if !self.is_driven() || value == self.stands() {
            return;
        }
        let offset = value - self.settings.bias;
        self.step(shared, Fact::Decided { offset, target: None, not_after: order.not_after }, now);
    }

    /// The register holds less than is wanted.
    fn report_saturated(&mut self, shared: &LineHandle, output: &Output, offset: Counts) {
        let account = self.state.shown(&self.settings).account;
        let value = account.map_or(self.settings.bias, |account| account.base) + offset;
        let (lowest, highest) = self.settings.range;
        let fits = (lowest..=highest).contains(&value);
        if !fits && !self.is_saturated {
            let wanted = self.units.value(value);
            shared.report(&Event::Saturated { output: output.name.clone(), wanted });
        }
        self.is_saturated = !fits;
    }

    /// Its turn has come too late: what was decided rests on readings that are too old now. The next decision is carried
    /// out, and people hear that the line is too slow.
    fn lapsed(&mut self, shared: &LineHandle, order: &Order) {
        self.is_late = order.follows;
        if order.follows {
            shared.order_lapsed(self.id, order.not_after);
        } else {
            self.goes_on_from_there = true;
        }
    }

    /// Passes a fact to the output step and keeps the action that it returns, unless one is already open. The new state
    /// outlives this task. The log gets the fact and the action.
    pub(super) fn step(&mut self, shared: &LineHandle, fact: Fact, now: Moment) {
        let was_open = self.is_open();
        let before = self.is_logged.then_some(self.state);
        let action = step(&mut self.state, &self.settings, fact, now);
        self.opens |= self.is_open() && !was_open;
        if matches!(self.action, Action::Nothing { .. }) {
            self.action = action;
        }
        self.report_events(shared);
        let mut core = shared.core();
        let known = &mut core.registers[self.id.0];
        let goes_on = before.is_some() && *known == before;
        *known = Some(self.state);
        let Some(before) = before else { return };
        let (settings, after) = (&self.settings, &self.state);
        let stepped = Stepped { id: self.id, settings, before: &before, goes_on, fact, action, after };
        core.storage.outputs.stepped(&stepped, now);
    }

    /// Reports what the step has found out; what switches off does that here.
    fn report_events(&mut self, shared: &LineHandle) {
        let output = shared.profile.output(self.id);
        let mut has_restarted = false;
        for event in self.state.take_events().iter() {
            let is_foreign = matches!(event, output::Event::ForeignValue { .. });
            if !(has_restarted && is_foreign)
                && let Some(event) = report::event(self, output, *event, &shared.clock)
            {
                shared.report(&event);
            }
            match *event {
                output::Event::OwnWriteArrivedLate { .. } | output::Event::PerhapsFromBefore { .. } => {
                    self.goes_on_from_there = true;
                }
                output::Event::CncRestarted { .. } => {
                    (has_restarted, self.goes_on_from_there, self.was_restarted) = (true, true, true);
                }
                output::Event::ForeignValue { expected, found } => {
                    self.goes_on_from_there = false;
                    self.heard.is_armed = false;
                    shared.core().disarm(output.axis, &report::why_foreign(self, output, expected, found));
                }
                _ => {}
            }
        }
    }

    /// Whether operator offset and gateway share of a shared register are known without a doubt.
    fn is_open(&self) -> bool {
        self.state.shown(&self.settings).account.is_some_and(|account| account.doubt.is_none())
    }

    /// The set that it is in is refreshed as a whole.
    pub(super) fn in_a_set(mut self) -> Register {
        self.settings.refresh = None;
        self
    }

    pub(super) fn is_known(&self) -> bool {
        self.state.shown(&self.settings).verified.is_some()
    }

    /// Its axis is armed, and its interlock closed.
    pub(super) fn is_driven(&self) -> bool {
        self.heard.is_armed && !self.interlock.is_held
    }

    /// Whether a read of the whole set may go to the output step. An open interlock rejects every value, and another
    /// action of the step may still be open.
    pub(super) fn may_hear_a_read(&self) -> bool {
        match self.action {
            Action::Read => true,
            Action::Nothing { .. } => !self.interlock.is_held,
            Action::Keep | Action::Write { .. } => false,
        }
    }

    pub(super) fn is_writing(&self) -> bool {
        matches!(self.action, Action::Write { .. })
    }

    /// After the next read it asks for a write, if that shows nothing new.
    pub(super) fn may_write(&self, now: Moment) -> bool {
        self.state.may_write(&self.settings, now)
    }

    /// Its next step waits for what may still arrive.
    pub(super) fn is_waiting_for_late(&self) -> bool {
        self.state.shown(&self.settings).waits_until.is_some()
    }

    /// What it holds as last verified.
    pub(super) fn stands(&self) -> Counts {
        self.state.shown(&self.settings).verified.map_or(self.settings.bias, |seen| seen.value)
    }

    /// The registers that hold this value. `None` if the control would read something else, or more than the limit: its
    /// axis is off then, until a person arms it.
    pub(super) fn admitted(&self, shared: &LineHandle, value: Counts) -> Option<Encoded> {
        let base = self.state.shown(&self.settings).account.map(|account| account.base);
        let encoded = self.units.admitted(value, base, self.stands());
        encoded.map_err(|why| report::not_sent(shared, self.id, why)).ok()
    }

    /// An exchange has come to its end with this.
    pub(super) fn comes_of(&mut self, turn: &LineTurn<'_>, fact: Fact) {
        let (shared, now) = (turn.shared, turn.line.looked());
        if turn.line.departure.has_stood_still() {
            self.step(shared, Fact::Paused, now);
        }
        self.action = Action::Nothing { until: now };
        self.step(shared, fact, now);
        self.look_back(shared, fact);
    }

    /// A request of its own has failed.
    pub(super) fn fail(&mut self, shared: &LineHandle, fault: Fault, access: Access) {
        if access == Access::Write && !self.heard.is_armed {
            // It only went along.
            return;
        }
        let in_words = || of_an_output(&shared.profile, self.id, fault);
        let reported = self.troubles.fails(fault, access, in_words);
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

    /// What an exchange that has come to its end says of the trouble before it.
    fn look_back(&mut self, shared: &LineHandle, fact: Fact) {
        let is_untaken = self.state.shown(&self.settings).is_untaken;
        let written = self.troubles.comes_of(fact, self.settings.verify, self.heard.is_armed, is_untaken);
        let Some(is_written) = written else { return };
        if is_untaken {
            let again = self.troubles.is_untaken();
            shared.core().outputs[self.id.0].failures += u64::from(again);
            return;
        }
        shared.core().outputs[self.id.0].writes += u64::from(is_written);
        if !self.is_bound && !self.is_unapplied {
            self.recover(shared);
        }
    }

    /// The control did not take what it holds.
    pub(super) fn is_not_taken(&mut self, shared: &LineHandle) {
        if self.is_driven() {
            self.troubles.now = Some(Trouble::Untaken);
            shared.core().outputs[self.id.0].failures += 1;
        }
    }

    /// It holds what it should, and can be written again.
    pub(super) fn recover(&mut self, shared: &LineHandle) {
        if matches!(self.troubles.now, None | Some(Trouble::Disk)) {
            return;
        }
        let mut core = shared.core();
        let failures = std::mem::take(&mut core.outputs[self.id.0].failures);
        if self.troubles.now.take() == Some(Trouble::Untaken) && self.troubles.was_untaken {
            let output = shared.profile.output(self.id).name.clone();
            core.events.push(Event::Verified { output, failures });
        }
        self.goes_on_from_there = true;
    }

    /// What a write that was not answered as done has come to.
    pub(super) fn failed(
        &mut self,
        shared: &LineHandle,
        order: &Order,
        (fault, outcome): (Fault, Outcome),
        left: Moment,
    ) -> Fact {
        if fault.has_lapsed() && outcome == Outcome::NotDone {
            let is_change = matches!(self.action, Action::Write { is_repeat: false, .. });
            if fault == Fault::Caller(CallerFault::TooLate) && is_change {
                self.lapsed(shared, order);
            }
            return Fact::NotSent;
        }
        self.fail(shared, fault, Access::Write);
        match outcome {
            Outcome::NotDone if fault.is_refusal() => Fact::Refused,
            Outcome::NotDone => Fact::NotSent,
            _ => Fact::Unknown { left },
        }
    }

    /// The end of a turn: what was begun after a read goes on in this turn or not at all.
    pub(super) fn ends_turn(&mut self, turn: &LineTurn<'_>, order: &Order) {
        let given_up = match self.action {
            Action::Nothing { .. } | Action::Keep => None,
            Action::Read => Some(Fact::NoAnswer),
            Action::Write { .. } => Some(Fact::NotSent),
        };
        let now = turn.line.looked();
        if let Some(fact) = given_up {
            self.action = Action::Nothing { until: now };
            self.step(turn.shared, fact, now);
        }
        if self.is_to_be_changed && now > order.not_after {
            // Its moment has passed while the register was read.
            self.lapsed(turn.shared, order);
        }
        self.publish(turn.shared, order);
    }

    pub(super) fn publish(&mut self, shared: &LineHandle, order: &Order) {
        self.ask(shared);
        let output = shared.profile.output(self.id);
        let shown = self.state.shown(&self.settings);
        let copies = *self.state.copies();
        self.troubles.was_untaken = self.troubles.now == Some(Trouble::Untaken);
        let was_waiting = std::mem::replace(&mut self.is_waiting, shown.waits_until.is_some());
        self.goes_on_from_there |= was_waiting && !self.is_waiting;
        let is_open = report::has_unanswered(&self.state) || copies.lately().next().is_some();
        let open = is_open.then_some(copies);
        if shown.verified.is_some() && std::mem::replace(&mut self.on_disk, open) != open {
            // In time for the next start, however this run ends; nobody waits for it.
            let _ = shared.ledger.keep(output, self.state.kept(), false);
        }
        let mut core = shared.core();
        let Some(cz) = report::show(self, order, &mut core.outputs[self.id.0]) else { return };
        let goes_on = std::mem::take(&mut self.goes_on_from_there) && self.heard.is_armed;
        if goes_on && self.troubles.now.is_none() {
            let is_taken_over = core.found(self.id, cz);
            if std::mem::take(&mut self.was_restarted) && is_taken_over {
                let axis = shared.profile.axis(output.axis).settings.name.clone();
                core.events.push(Event::GoesOn { axis, from: cz, way: Way::Restart });
            }
            drop(core);
            shared.wake_others(shared.profile.device(output.device).bus);
        }
    }

    /// Only a person can say what of the register is whose: the axis is off until one arms it, and the register stays.
    fn ask(&mut self, shared: &LineHandle) {
        let output = shared.profile.output(self.id);
        let shown = self.state.shown(&self.settings);
        let is_asked = self.settings.is_shared && shown.standing == Standing::Barred;
        let Some(verified) = shown.verified.filter(|_| is_asked && !shared.dry_run) else { return };
        if std::mem::replace(&mut self.has_asked, true) {
            // The person who arms it next must not be overruled.
            return;
        }
        shared.report(&report::question(self, &output.name, verified.value, shown.account));
        self.heard.is_armed = false;
        shared.core().disarm(output.axis, "what of its register is ours is in question");
    }

    /// Has what is known put on disk. `None` where the disk has not answered: it is looked at again in the next turn.
    pub(super) async fn keep(&mut self, turn: &mut LineTurn<'_>) -> Option<Fact> {
        let (shared, now) = (turn.shared, turn.line.looked());
        if shared.dry_run {
            return Some(Fact::Kept);
        }
        let output = shared.profile.output(self.id);
        let is_new = self.keeping.is_none();
        let (version, since) = match self.keeping {
            Some(keeping) => keeping,
            None => {
                // What is only noted is on disk before the next promise is.
                let is_needed = self.settings.promises() && (self.state.is_promising() || self.opens);
                match shared.ledger.keep(output, self.state.kept(), is_needed) {
                    Keeping::Version(version) => (version, now),
                    Keeping::Needless => return Some(Fact::Kept),
                    Keeping::Impossible => {
                        self.troubles.now = self.troubles.now.or(Some(Trouble::Disk));
                        return Some(Fact::NotKept);
                    }
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
            self.goes_on_from_there |= self.troubles.now == Some(Trouble::Disk);
            self.troubles.now = self.troubles.now.filter(|trouble| *trouble != Trouble::Disk);
            // The ledger is on disk: the division may be reported.
            if let Some(account) = self.state.shown(&self.settings).account
                && std::mem::take(&mut self.opens)
            {
                shared.report(&report::opened(self, &output.name, account));
            }
            return Some(Fact::Kept);
        }
        if kept == Kept::NotYet && self.troubles.now != Some(Trouble::Disk) {
            let why = format!("the disk has not answered for {} s", DISK_PATIENCE.as_secs());
            shared.report(&Event::NotKept { what: WHAT.to_owned(), why });
        }
        self.troubles.now = self.troubles.now.or(Some(Trouble::Disk));
        Some(Fact::NotKept)
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
        rules: Rules::default(),
    }
}

/// What the task before this one knew, which ended in the middle of something.
fn taken_up(mut state: State, settings: &Settings, now: Moment) -> State {
    let ends = [Fact::Paused, Fact::Unknown { left: now }, Fact::NoAnswer, Fact::NotKept, Fact::NoAnswer];
    for fact in ends {
        let _ = step(&mut state, settings, fact, now);
    }
    debug_assert!(!state.is_asking(), "every open action has ended");
    state
}
