//! What is known of the register of one output: what has happened elsewhere goes in as facts, what is to be done next
//! comes out. Single registers and the members of a set are the same here.

use std::time::Duration;

use super::interlock::Interlock;
use super::order::Order;
use super::units::Units;
use super::{Asked, DISK_PATIENCE, REMEMBERED, Trouble};
use crate::fieldbus::error::{CallerFault, Fault, Outcome};
use crate::fieldbus::line::DeviceLine;
use crate::gateway::ledger::Keeping;
use crate::gateway::line_handle::LineHandle;
use crate::gateway::saver::Kept;
use crate::gateway::storage::Stepped;
use crate::gateway::words::can_be_read;
use crate::observe::events::Event;
use isotherm_core::output::{Action, Copies, Fact, Rules, Settings, Standing, State, Verify, Who, step};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Output, OutputId, Share, Writes};

/// The register of one output.
#[derive(Debug)]
pub(super) struct Register {
    pub(super) id: OutputId,
    pub(super) units: Units,
    pub(super) settings: Settings,
    pub(super) state: State,
    /// What it takes and asks for is logged.
    is_logged: bool,
    /// What is to be done next.
    pub(super) action: Action,
    pub(super) heard: Heard,
    pub(super) interlock: Interlock,
    /// What may still appear in the register, where that was given to the disk.
    pub(super) on_disk: Option<Copies>,
    /// What is being put on disk, and since when.
    keeping: Option<(u64, Moment)>,
    pub(super) trouble: Option<Trouble>,
    /// What failed and was told, until it does not fail any more.
    pub(super) told: Option<Asked>,
    /// Writes that failed since the last one that was answered.
    pub(super) failed_writes: u64,
    /// The last read was answered.
    pub(super) is_read: bool,
    /// It goes on from what stands there, which is not what was decided.
    pub(super) goes_on_from_there: bool,
    /// A write was acknowledged that no read has shown yet.
    pub(super) is_to_be_seen: bool,
    /// At the end of the last turn its register had not taken what was written.
    pub(super) was_untaken: bool,
    is_saturated: bool,
    /// What stood there when its axis began to hold something else.
    held_at: Option<i64>,
    /// What is asked of a person was told.
    pub(super) has_asked: bool,
    /// It is to be told whose part is what, as soon as that is on disk.
    pub(super) opens: bool,
    /// What was decided in this turn is to change the register.
    pub(super) is_to_be_changed: bool,
    /// A change waits for what may still arrive.
    pub(super) is_waiting: bool,
    /// Its turn came too late for what was decided last.
    pub(super) is_late: bool,
    /// What was sent with it is not taken yet: nothing else may be sent.
    pub(super) is_bound: bool,
    /// The control does not apply yet what stands there: nothing else is sent.
    pub(super) is_unapplied: bool,
}

/// What was taken note of.
#[derive(Debug, Default)]
pub(super) struct Heard {
    restarts: u64,
    pauses: u64,
    pub(super) is_armed: bool,
    decided: Moment,
}

impl Register {
    pub(super) fn new(shared: &LineHandle, id: OutputId, now: Moment) -> Register {
        let profile = &shared.profile;
        let output = profile.output(id);
        let units = Units::of(profile, output);
        let settings = settings(shared, output, units);
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
            is_logged: shared.core().storage.logs_outputs(),
            action: Action::Nothing { until: now },
            heard,
            interlock,
            on_disk: None,
            keeping: None,
            trouble: None,
            told: None,
            failed_writes: 0,
            is_read: false,
            goes_on_from_there: false,
            is_to_be_seen: false,
            was_untaken: false,
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
    pub(super) fn hear(&mut self, shared: &LineHandle, output: &Output, order: &Order, now: Moment) {
        if std::mem::replace(&mut self.heard.pauses, order.pauses) != order.pauses {
            self.step(shared, Fact::Paused, now);
        }
        if std::mem::replace(&mut self.heard.restarts, order.restarts) != order.restarts {
            self.step(shared, Fact::Restarted, now);
        }
        let is_armed = order.armed && !shared.dry_run;
        if std::mem::replace(&mut self.heard.is_armed, is_armed) != is_armed {
            let fact = if is_armed { Fact::Armed { by: who(shared, output) } } else { Fact::Off };
            self.has_asked &= !is_armed;
            // A device that does not answer is still one.
            self.trouble = self.trouble.filter(|trouble| *trouble == Trouble::Link);
            self.step(shared, fact, now);
        }
        self.hear_interlock(shared, output, order, now);
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
            self.decide(shared, output, order, now);
        }
        self.step(shared, Fact::Look, now);
    }

    /// Another decision. An axis that holds decides nothing: it goes on from what stands there.
    fn decide(&mut self, shared: &LineHandle, output: &Output, order: &Order, now: Moment) {
        self.is_late = false;
        let offset = self.offset(shared, output, order);
        self.tell_saturated(shared, output, offset);
        let stands = self.state.shown(&self.settings).verified.map(|seen| seen.value);
        let is_changed = !self.state.is_at(&self.settings, offset);
        // What it holds while its register does not take it is tried again.
        if is_changed
            && order.holds
            && output.writes != Writes::Reference
            && self.trouble != Some(Trouble::Untaken)
        {
            self.goes_on_from_there |= std::mem::replace(&mut self.held_at, stands) != stands;
            return;
        }
        self.held_at = None;
        if self.trouble == Some(Trouble::Disk) {
            // When that is over, the axis goes on from what stands there.
            return;
        }
        if is_changed && now > order.not_after {
            return self.lapsed(shared, order);
        }
        self.is_to_be_changed = is_changed;
        self.step(shared, Fact::Decided { offset, not_after: order.not_after }, now);
    }

    /// What is wanted, in counts from the bias. A reference position is a constant.
    fn offset(&self, shared: &LineHandle, output: &Output, order: &Order) -> i64 {
        match (output.writes, shared.profile.axis(output.axis).settings.intercept_slope) {
            (Writes::Reference, Some(line)) => self.units.counts(&output.encoding, line.reference.get()),
            _ => self.units.offset(&output.encoding, order.cz),
        }
    }

    /// What was sent before stands there, or can be sent once more: near enough, and on readings that are good now; of one
    /// that is not driven nothing is wanted.
    pub(super) fn can_hold_again(&self, value: i64, order: &Order, now: Moment) -> bool {
        if !self.is_driven() || value == self.stands() {
            return true;
        }
        let is_near = value.abs_diff(self.stands()) <= self.settings.step.unsigned_abs();
        is_near && !order.off && now <= order.not_after
    }

    /// What was sent before is wanted once more, where it does not stand there.
    pub(super) fn wants_again(&mut self, shared: &LineHandle, value: i64, order: &Order, now: Moment) {
        if !self.is_driven() || value == self.stands() {
            return;
        }
        let offset = value.saturating_sub(self.settings.bias);
        self.step(shared, Fact::Decided { offset, not_after: order.not_after }, now);
    }

    /// The register holds less than is wanted.
    fn tell_saturated(&mut self, shared: &LineHandle, output: &Output, offset: i64) {
        let account = self.state.shown(&self.settings).account;
        let value = account.map_or(self.settings.bias, |account| account.base).saturating_add(offset);
        let (lowest, highest) = self.settings.range;
        let fits = (lowest..=highest).contains(&value);
        if !fits && !self.is_saturated {
            let wanted = self.units.value(&output.encoding, value);
            shared.report(&Event::Saturated { output: output.name.clone(), wanted });
        }
        self.is_saturated = !fits;
    }

    /// Its turn has come too late: what was decided rests on readings that are too old now. The next decision is carried
    /// out, and people are told that the line is too slow.
    pub(super) fn lapsed(&mut self, shared: &LineHandle, order: &Order) {
        self.is_late = order.follows;
        if order.follows {
            shared.order_lapsed(self.id, order.not_after);
        } else {
            self.goes_on_from_there = true;
        }
    }

    /// Whatever happened while its interlock was open, the axis goes on from what stands there then.
    fn hear_interlock(&mut self, shared: &LineHandle, output: &Output, order: &Order, now: Moment) {
        if self.interlock.hear(shared, output, self.heard.is_armed, order.allowed) {
            let is_held = self.interlock.is_held;
            self.step(shared, if is_held { Fact::Interlocked } else { Fact::Released }, now);
            self.goes_on_from_there |= !is_held;
        }
    }

    /// Takes a fact in: what is to be done next, unless something is to be done already. What is known afterwards outlives
    /// this task, and what was taken and asked for is logged.
    pub(super) fn step(&mut self, shared: &LineHandle, fact: Fact, now: Moment) {
        let was_open = self.is_open();
        let before = self.is_logged.then_some(self.state);
        let action = step(&mut self.state, &self.settings, fact, now);
        self.opens |= self.is_open() && !was_open;
        if matches!(self.action, Action::Nothing { .. }) {
            self.action = action;
        }
        self.report(shared);
        let mut core = shared.core();
        let known = &mut core.registers[self.id.0];
        let goes_on = before.is_some() && *known == before;
        *known = Some(self.state);
        let Some(before) = before else { return };
        let (settings, after) = (&self.settings, &self.state);
        let stepped = Stepped { id: self.id, settings, before: &before, goes_on, fact, action, after };
        core.storage.stepped(&stepped, now);
    }

    /// Whose part of a shared register is what is known and believed.
    fn is_open(&self) -> bool {
        self.state.shown(&self.settings).account.is_some_and(|account| account.doubt.is_none())
    }

    /// The set that it is in is refreshed as a whole.
    pub(super) fn in_a_set(mut self) -> Register {
        self.settings.refresh = None;
        self
    }

    /// What it holds is known.
    pub(super) fn is_known(&self) -> bool {
        self.state.shown(&self.settings).verified.is_some()
    }

    /// Its axis is armed, and its interlock closed.
    pub(super) fn is_driven(&self) -> bool {
        self.heard.is_armed && !self.interlock.is_held
    }

    /// What a read of all of its set shows is told to it: not behind an interlock, where nothing is believed, and not while
    /// something else that it asked for is open.
    pub(super) fn may_hear_a_read(&self) -> bool {
        match self.action {
            Action::Read => true,
            Action::Nothing { .. } => !self.interlock.is_held,
            Action::Keep | Action::Write { .. } => false,
        }
    }

    /// It asks for a write.
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
    pub(super) fn stands(&self) -> i64 {
        self.state.shown(&self.settings).verified.map_or(self.settings.bias, |seen| seen.value)
    }

    /// An exchange has come to its end with this.
    pub(super) fn comes_of(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        output: &Output,
        fact: Fact,
    ) {
        let now = line.looked();
        if line.has_stood_still() {
            self.step(shared, Fact::Paused, now);
        }
        self.action = Action::Nothing { until: now };
        self.step(shared, fact, now);
        self.look_back(shared, output, fact);
    }

    /// What a write that was not answered as done has come to.
    pub(super) fn failed(
        &mut self,
        shared: &LineHandle,
        output: &Output,
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
        self.fail(shared, output, fault, Asked::Write);
        match outcome {
            Outcome::NotDone if matches!(fault, Fault::Exception(_) | Fault::Aborted(_)) => Fact::Refused,
            Outcome::NotDone => Fact::NotSent,
            _ => Fact::Unknown { left },
        }
    }

    /// The end of a turn: what was begun after a read goes on in this turn or not at all.
    pub(super) fn ends_turn(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        output: &Output,
        order: &Order,
    ) {
        let given_up = match self.action {
            Action::Nothing { .. } | Action::Keep => None,
            Action::Read => Some(Fact::NoAnswer),
            Action::Write { .. } => Some(Fact::NotSent),
        };
        let now = line.looked();
        if let Some(fact) = given_up {
            self.action = Action::Nothing { until: now };
            self.step(shared, fact, now);
        }
        if self.is_to_be_changed && now > order.not_after {
            // Its moment has passed while the register was read.
            self.lapsed(shared, order);
        }
        self.publish(shared, output, order);
    }

    /// Has what is known put on disk. `None` where the disk has not answered: it is looked at again in the next turn.
    pub(super) async fn keep(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        output: &Output,
        now: Moment,
    ) -> Option<Fact> {
        if shared.dry_run {
            return Some(Fact::Kept);
        }
        let is_new = self.keeping.is_none();
        let (version, since) = match self.keeping {
            Some(keeping) => keeping,
            None => {
                // What is only noted is on disk before the next promise is.
                let is_needed = self.settings.promises() && (self.state.is_promising() || self.opens);
                match shared.ledger.keep(&shared.profile, output, self.state.kept(), is_needed) {
                    Keeping::Version(version) => (version, now),
                    Keeping::Needless => return Some(Fact::Kept),
                    Keeping::Impossible => {
                        self.trouble = self.trouble.or(Some(Trouble::Disk));
                        return Some(Fact::NotKept);
                    }
                }
            }
        };
        self.keeping = Some((version, since));
        let timeout = shared.profile.bus(shared.profile.device(output.device).bus).timeout;
        let span = if is_new { timeout } else { Duration::ZERO };
        line.away_for(span);
        let kept = shared.ledger.kept(version, span).await;
        let now = line.look();
        if kept == Kept::NotYet && now.since(since) < DISK_PATIENCE {
            return None;
        }
        self.keeping = None;
        if kept == Kept::Yes {
            self.goes_on_from_there |= self.trouble == Some(Trouble::Disk);
            self.trouble = self.trouble.filter(|trouble| *trouble != Trouble::Disk);
            self.tell_opened(shared, output);
            return Some(Fact::Kept);
        }
        if kept == Kept::NotYet && self.trouble != Some(Trouble::Disk) {
            let why = format!("the disk has not answered for {} s", DISK_PATIENCE.as_secs());
            shared.report(&Event::NotKept { what: "the ledger".to_owned(), why });
        }
        self.trouble = self.trouble.or(Some(Trouble::Disk));
        Some(Fact::NotKept)
    }
}

fn settings(shared: &LineHandle, output: &Output, units: Units) -> Settings {
    let profile = &shared.profile;
    // A constant may arrive whenever it likes.
    let is_constant = output.writes == Writes::Reference;
    let late = profile.bus(profile.device(output.device).bus).late;
    let late = if is_constant { Duration::ZERO } else { late };
    let (step, limit, bias) = units.bounds(profile, output);
    Settings {
        step,
        limit,
        bias,
        range: units.range(&output.encoding),
        late,
        remembered: late.saturating_mul(REMEMBERED),
        every: profile.axis(output.axis).settings.every,
        refresh: output.refresh,
        is_shared: output.share == Share::Ledger,
        verify: if can_be_read(&shared.profile, output) { Verify::Reading } else { Verify::Echo },
        rules: Rules::default(),
    }
}

/// What the task before this one knew, which ended in the middle of something.
fn taken_up(mut state: State, settings: &Settings, now: Moment) -> State {
    let ends = [Fact::Paused, Fact::Unknown { left: now }, Fact::NoAnswer, Fact::NotKept, Fact::NoAnswer];
    for fact in ends {
        let _ = step(&mut state, settings, fact, now);
    }
    debug_assert!(!state.is_asking(), "whatever it asked for has come to its end");
    state
}

/// Who has armed its axis.
fn who(shared: &LineHandle, output: &Output) -> Who {
    if shared.core().arming[output.axis.0].by_person { Who::Person } else { Who::Policy }
}
