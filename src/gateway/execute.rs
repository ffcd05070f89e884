//! Carries out what [`output::step`](crate::output::step) asks for, and tells it what came of that.
//!
//! One [`Executor`] for each offset in a register of its own, owned by the task of the register's line. What has happened
//! elsewhere since its last turn (armed, switched off, restarted, stood still, decided) comes in as facts; then each
//! action is one exchange, whose end is the next fact, until there is nothing to do.

use std::time::Duration;

use super::apply::Order;
use super::saver::Kept;
use super::shared::Shared;
use super::words::can_be_read;
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{CallerFault, Fault, Outcome};
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::{Answer, Request};
use crate::observe::events::Event;
use crate::output::{Action, Copies, Fact, Rules, Settings, Standing, State, Verify, Who, step};
use crate::profile::{Output, OutputId, Profile};
use crate::quantity::Moment;

mod report;
mod units;

use units::Units;

/// An output is done after fewer exchanges than this; whatever happens, its line goes on then.
const MOST_EXCHANGES: usize = 12;
/// A value whose answer never came is recognised for so many times as long as it may take to arrive.
const REMEMBERED: u32 = 10;
/// A disk that has not answered for this long is a fault.
const DISK_PATIENCE: Duration = Duration::from_secs(5);

/// Owns one output.
#[derive(Debug)]
pub(super) struct Executor {
    id: OutputId,
    units: Units,
    settings: Settings,
    state: State,
    /// What is to be done next.
    action: Action,
    heard: Heard,
    /// What may still appear in the register, where that was given to the disk.
    on_disk: Option<Copies>,
    /// What is being put on disk, and since when.
    keeping: Option<(u64, Moment)>,
    trouble: Option<Trouble>,
    /// What failed and was told, until it does not fail any more.
    told: Option<Asked>,
    /// It goes on from what stands there, which is not what was decided.
    goes_on_from_there: bool,
    /// A write was acknowledged that no read has shown yet.
    is_to_be_seen: bool,
    /// At the end of the last turn its register had not taken what was written.
    was_untaken: bool,
    is_saturated: bool,
    /// What stood there when its axis began to hold something else.
    held_at: Option<i64>,
    /// What was decided in this turn is to change the register.
    is_to_be_changed: bool,
    /// A change waits for what may still arrive.
    is_waiting: bool,
    /// Its turn came too late for what was decided last.
    is_late: bool,
    /// When it wants to be called again.
    due: Moment,
}

/// What was taken note of.
#[derive(Debug, Default)]
struct Heard {
    restarts: u64,
    pauses: u64,
    is_armed: bool,
    /// Its interlock kept it from being written, or could not be known.
    is_held: bool,
    /// That was told.
    is_interlocked: bool,
    decided: Moment,
}

/// Why the register is not what was decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    /// The device did not answer.
    Link,
    /// It did not answer a write, and nothing was written since.
    Unanswered,
    /// It answered, and did not do what it was told.
    Untaken,
    /// What must be on disk is not.
    Disk,
}

/// What a device was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Asked {
    Read,
    Write,
}

impl Executor {
    pub(super) fn new(shared: &Shared, id: OutputId, now: Moment) -> Executor {
        let profile = &shared.profile;
        let output = profile.output(id);
        let units = Units::of(profile, output);
        let (step, limit, bias) = units.bounds(profile, output);
        let is_read = can_be_read(shared, output);
        let settings = Settings { step, limit, bias, ..times(profile, output, is_read) };
        let before = shared.core().registers[id.0];
        let kept = shared.promises.at_start(profile, output);
        let state = before.map(|state| taken_up(state, &settings, now));
        let state = state.unwrap_or_else(|| State::new(&settings, kept.as_ref(), now));
        let mut heard = Heard { pauses: shared.pauses(), ..Heard::default() };
        if before.is_some() {
            heard.restarts = shared.core().restarts.of(id);
            heard.is_armed = state.shown(&settings).standing == Standing::Armed;
        }
        Executor {
            id,
            units,
            settings,
            state,
            action: Action::Nothing { until: now },
            heard,
            on_disk: None,
            keeping: None,
            trouble: None,
            told: None,
            goes_on_from_there: false,
            is_to_be_seen: false,
            was_untaken: false,
            is_saturated: false,
            held_at: None,
            is_to_be_changed: false,
            is_waiting: false,
            is_late: false,
            due: now,
        }
    }

    /// When it wants to be called again, if nothing else happens.
    pub(super) fn due(&self) -> Moment {
        self.due
    }

    /// Its turn came too late for what was decided last.
    pub(super) fn is_late(&self) -> bool {
        self.is_late
    }

    /// Does what there is to do.
    pub(super) async fn turn(&mut self, line: &mut DeviceLine, shared: &Shared, now: Moment) {
        let output = shared.profile.output(self.id);
        let order = Order::of(shared, &shared.core(), self.id, now);
        self.hear(shared, output, &order, now);
        for _ in 0..MOST_EXCHANGES {
            let fact = match self.action {
                Action::Nothing { until } => {
                    self.due = until;
                    break;
                }
                Action::Read => self.read(line, shared, output).await,
                Action::Keep => match self.keep(line, shared, output, now).await {
                    Some(fact) => fact,
                    None => {
                        self.due = now;
                        break;
                    }
                },
                Action::Write { value, not_after, .. } => {
                    self.is_to_be_changed = false;
                    self.write(line, shared, output, value, not_after, &order).await
                }
            };
            let now = line.looked();
            if line.has_stood_still() {
                self.step(shared, Fact::Paused, now);
            }
            self.action = Action::Nothing { until: now };
            self.step(shared, fact, now);
            self.look_back(shared, output, fact);
        }
        // What was begun after a read goes on in this turn or not at all.
        let given_up = match self.action {
            Action::Nothing { .. } | Action::Keep => None,
            Action::Read => Some(Fact::NoAnswer),
            Action::Write { .. } => Some(Fact::NotSent),
        };
        if let Some(fact) = given_up {
            self.action = Action::Nothing { until: now };
            self.step(shared, fact, line.looked());
        }
        if self.is_to_be_changed && line.looked() > order.not_after {
            // Its moment has passed while the register was read.
            self.lapsed(shared, &order);
        }
        self.publish(shared, output, &order);
    }

    /// What has happened elsewhere since the last turn.
    fn hear(&mut self, shared: &Shared, output: &Output, order: &Order, now: Moment) {
        if std::mem::replace(&mut self.heard.pauses, order.pauses) != order.pauses {
            self.step(shared, Fact::Paused, now);
        }
        if std::mem::replace(&mut self.heard.restarts, order.restarts) != order.restarts {
            self.step(shared, Fact::Restarted, now);
        }
        let is_armed = order.armed && !shared.dry_run;
        if std::mem::replace(&mut self.heard.is_armed, is_armed) != is_armed {
            let fact = if is_armed { Fact::Armed { by: who(shared, output) } } else { Fact::Off };
            // A device that does not answer is still one.
            self.trouble = self.trouble.filter(|trouble| *trouble == Trouble::Link);
            self.step(shared, fact, now);
        }
        self.hear_interlock(shared, output, order, now);
        (self.is_late, self.is_to_be_changed) = (false, false);
        let decides = is_armed && !order.off && !order.outdated && order.allowed == Some(true);
        if decides && std::mem::replace(&mut self.heard.decided, order.decided) != order.decided {
            self.decide(shared, output, order, now);
        }
        self.step(shared, Fact::Look, now);
    }

    /// Another decision. An axis that holds decides nothing: it goes on from what stands there.
    fn decide(&mut self, shared: &Shared, output: &Output, order: &Order, now: Moment) {
        let fits = self.units.fits(&output.encoding, order.cz);
        if !fits && !self.is_saturated {
            let wanted = order.cz.get();
            shared.tell(&Event::Saturated { output: output.name.clone(), wanted });
        }
        self.is_saturated = !fits;
        let offset = self.units.offset(&output.encoding, order.cz);
        let stands = self.state.shown(&self.settings).verified.map(|seen| seen.value);
        let is_changed = stands != Some(offset.saturating_add(self.settings.bias));
        // What it holds while its register does not take it is tried again.
        if is_changed && order.holds && self.trouble != Some(Trouble::Untaken) {
            self.goes_on_from_there |= std::mem::replace(&mut self.held_at, stands) != stands;
            return;
        }
        self.held_at = None;
        if is_changed && now > order.not_after {
            return self.lapsed(shared, order);
        }
        self.is_to_be_changed = is_changed;
        self.step(shared, Fact::Decided { offset, not_after: order.not_after }, now);
    }

    /// Its turn has come too late: what was decided rests on readings that are too old now. The next decision is carried
    /// out, and people are told that the line is too slow.
    fn lapsed(&mut self, shared: &Shared, order: &Order) {
        self.is_late = order.follows;
        if order.follows {
            shared.order_lapsed(self.id, order.not_after);
        } else {
            self.goes_on_from_there = true;
        }
    }

    /// Whether the interlock keeps it from being written now. Where its condition cannot be known that is a fault, which
    /// the lost signal has told.
    fn hear_interlock(&mut self, shared: &Shared, output: &Output, order: &Order, now: Moment) {
        let is_held = self.heard.is_armed && order.allowed != Some(true);
        let is_interlocked = is_held && order.allowed == Some(false);
        if is_interlocked && !std::mem::replace(&mut self.heard.is_interlocked, true) {
            let when = output.when.as_ref().map_or(String::new(), |when| when.text.clone());
            shared.tell(&Event::Interlocked { output: output.name.clone(), when });
        }
        if !is_held && std::mem::take(&mut self.heard.is_interlocked) && self.heard.is_armed {
            shared.tell(&Event::Released { output: output.name.clone() });
        }
        if std::mem::replace(&mut self.heard.is_held, is_held) != is_held {
            self.step(shared, if is_held { Fact::Interlocked } else { Fact::Released }, now);
            // Whatever happened meanwhile, the axis goes on from what stands there now.
            self.goes_on_from_there |= !is_held;
        }
    }

    /// Takes a fact in: what is to be done next, unless something is to be done already. What is known afterwards outlives
    /// this task.
    fn step(&mut self, shared: &Shared, fact: Fact, now: Moment) {
        let action = step(&mut self.state, &self.settings, fact, now);
        if matches!(self.action, Action::Nothing { .. }) {
            self.action = action;
        }
        self.report(shared);
        shared.core().registers[self.id.0] = Some(self.state);
    }

    async fn read(&mut self, line: &mut DeviceLine, shared: &Shared, output: &Output) -> Fact {
        let request = Request::read(&output.reads_at(), output.encoding.data_type);
        let read = match request {
            Some(request) => line.request(output.device, request, Leave::Whenever).await,
            None => Err(Fault::Caller(CallerFault::Function)),
        };
        match read {
            Ok(answered) => {
                let found = match &answered.answer {
                    Answer::Words(words) => self.units.found(&output.encoding, words),
                    Answer::Bits(_) | Answer::Done => self.units.found(&output.encoding, &[]),
                };
                Fact::Read { found, asked: answered.asked }
            }
            Err(fault) => {
                self.fail(shared, output, fault, Asked::Read);
                Fact::NoAnswer
            }
        }
    }

    async fn write(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        output: &Output,
        value: i64,
        not_after: Moment,
        order: &Order,
    ) -> Fact {
        if line.is_resting(output.device, line.looked()) {
            self.trouble = self.trouble.or(Some(Trouble::Link));
            return Fact::NotSent;
        }
        let registers = self.units.registers(&output.encoding, value);
        let functions = shared.profile.device(output.device).functions;
        let request = Request::write(&output.address, registers.words(), functions);
        let leave = match self.settings.verify {
            Verify::Reading => Leave::Here(not_after),
            Verify::Echo => Leave::By(not_after),
        };
        let sent = line.request(output.device, request, leave).await;
        // Looked at after its last byte: it left no later than that.
        let left = line.looked();
        let Err(fault) = sent else { return Fact::Done { left } };
        if fault.has_lapsed() {
            if fault == Fault::Caller(CallerFault::TooLate) {
                self.lapsed(shared, order);
            }
            return Fact::NotSent;
        }
        self.fail(shared, output, fault, Asked::Write);
        match fault.outcome() {
            Outcome::NotDone if matches!(fault, Fault::Exception(_) | Fault::Aborted(_)) => Fact::Refused,
            Outcome::NotDone => Fact::NotSent,
            _ => Fact::Unknown { left },
        }
    }

    /// Has what is known put on disk. `None` where the disk has not answered: it is looked at again in the next turn.
    async fn keep(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        output: &Output,
        now: Moment,
    ) -> Option<Fact> {
        if shared.dry_run {
            return Some(Fact::Kept);
        }
        if self.settings.verify == Verify::Reading && shared.promises.is_unmarked() {
            return Some(Fact::Kept);
        }
        let is_new = self.keeping.is_none();
        let (version, since) = match self.keeping {
            Some(keeping) => keeping,
            None => match shared.promises.keep(&shared.profile, output, self.state.kept()) {
                Some(version) => (version, now),
                None => return Some(Fact::Kept),
            },
        };
        self.keeping = Some((version, since));
        let timeout = shared.profile.bus(shared.profile.device(output.device).bus).timeout;
        let span = if is_new { timeout } else { Duration::ZERO };
        line.away_for(span);
        let kept = shared.promises.kept(version, span).await;
        let now = line.look();
        if kept == Kept::NotYet && now.since(since) < DISK_PATIENCE {
            return None;
        }
        self.keeping = None;
        if kept == Kept::Yes {
            self.goes_on_from_there |= self.trouble == Some(Trouble::Disk);
            self.trouble = self.trouble.filter(|trouble| *trouble != Trouble::Disk);
            return Some(Fact::Kept);
        }
        self.trouble = self.trouble.or(Some(Trouble::Disk));
        Some(Fact::NotKept)
    }
}

fn times(profile: &Profile, output: &Output, is_read: bool) -> Settings {
    let late = profile.bus(profile.device(output.device).bus).late;
    Settings {
        step: 1,
        limit: 0,
        bias: 0,
        late,
        remembered: late.saturating_mul(REMEMBERED),
        every: profile.axis(output.axis).settings.every,
        refresh: output.refresh,
        is_shared: false,
        verify: if is_read { Verify::Reading } else { Verify::Echo },
        rules: Rules::default(),
    }
}

/// What the task before this one knew, which ended in the middle of something.
fn taken_up(mut state: State, settings: &Settings, now: Moment) -> State {
    let ends = [Fact::Paused, Fact::Unknown { left: now }, Fact::NotKept, Fact::NoAnswer];
    for fact in ends {
        let _ = step(&mut state, settings, fact, now);
    }
    state
}

/// Who has armed its axis.
fn who(shared: &Shared, output: &Output) -> Who {
    if shared.core().arming[output.axis.0].by_person { Who::Person } else { Who::Policy }
}
