//! Outputs that land together: read as one, written as one, taken as one ([`Transaction`]).
//!
//! Whenever one of them is to be written, all of them are; where nothing is to change, that is what was just read there.
//! So a heartbeat and a control word in the set go on in every state, and only where somebody else writes to a member in
//! that very moment, that is lost.

use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{Fault, Outcome};
use crate::gateway::line_handle::LineHandle;
use crate::gateway::output::Wait;
use crate::gateway::storage::Steady;
use isotherm_core::codec::Encoded;
use isotherm_core::compensation::AxisState;
use isotherm_core::output::{Action, Attempt, Fact, Follow, Input, Member, SetCommit, Taking, Transaction};
use isotherm_core::quantity::{Counts, Moment};
use isotherm_profile::{Control, OutputSet, Profile, SetId};

use super::demand::OutputDemand;
use super::failures::Access;
use super::register::Register;
use super::strobe::{Stands, Strobe, Waited};
use super::together::{self, Found, Own};
use super::{LineTurn, RETRY, cells};

/// Owns the outputs of one set, and its strobe.
#[derive(Debug)]
pub(in crate::gateway) struct Set {
    id: SetId,
    registers: Vec<Register>,
    strobe: Strobe,
    transaction: Transaction,
    /// How often its control was restarted, as far as it has heard.
    restarts: u64,
    /// The count of its writes, as it stands in the register.
    beat: u16,
    /// The control word that was sent last.
    sent_control: Option<u16>,
    written_at: Moment,
    /// Nothing is sent for its own sake before this.
    tries_from: Moment,
    /// When it wants to be called again, if nothing else happens.
    pub(in crate::gateway) due: Moment,
}

/// How far an exchange has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Went {
    /// To its end.
    Well,
    /// It goes on in a later turn, or is tried again in one.
    NoFurther,
}

impl Set {
    pub(in crate::gateway) fn new(shared: &LineHandle, id: SetId, now: Moment) -> Set {
        let outputs = &shared.profile.set(id).outputs;
        // The task before this one ended in the middle of an exchange.
        let was_up = outputs.iter().any(|id| shared.core().outputs[id.0].handshake.strobe_up);
        let stands = if was_up { Stands::Up } else { Stands::Unknown };
        let is_second = outputs.iter().any(|id| shared.core().registers[id.0].is_some());
        let mut registers: Vec<_> =
            outputs.iter().map(|id| Register::new(shared, *id, now).in_a_set()).collect();
        let was_in_order = !is_second && registers.iter().all(|one| one.state().is_settled());
        let set = shared.profile.set(id);
        let has_number = set.sequence.is_some();
        let taking = taken_by(&shared.profile, set);
        let (transaction, commit) = Transaction::new(taking, has_number, was_in_order);
        registers.iter_mut().for_each(|one| one.commits(shared, commit, now));
        Set {
            id,
            transaction,
            registers,
            strobe: Strobe::new(shared, id, stands),
            restarts: 0,
            beat: 0,
            sent_control: None,
            written_at: Moment::default(),
            tries_from: now,
            due: now,
        }
    }

    /// When the acknowledge is to be asked for again.
    pub(in crate::gateway) fn asks(&self) -> Option<Moment> {
        self.strobe.waits.map(|(.., ask)| ask)
    }

    /// The turn of one of its members came too late for what was decided.
    pub(in crate::gateway) fn is_late(&self) -> bool {
        self.registers.iter().any(|register| register.controller.follow() == Follow::Late)
    }

    fn members(&self) -> Vec<Member> {
        let member = |one: &Register| {
            let (is_driven, is_bound) = (one.controller.is_driven(), one.controller.is_bound());
            Member { held: one.held(), is_driven, is_bound }
        };
        self.registers.iter().map(member).collect()
    }

    /// Values of the registers in counts. A server may keep a number with fewer digits than it was sent with: that is the same count.
    fn counts(&self, values: &[Encoded]) -> Vec<Counts> {
        self.registers.iter().zip(values).map(|(one, value)| one.units.found(value.registers())).collect()
    }

    /// Gives the members what the control has made of the set.
    fn commit(&mut self, shared: &LineHandle, commit: Option<SetCommit>, now: Moment) {
        for register in self.registers.iter_mut() {
            commit.into_iter().for_each(|commit| register.commits(shared, commit, now));
        }
    }

    fn is_bound(&self) -> bool {
        self.registers.iter().any(|register| register.controller.is_bound())
    }

    /// Goes on with an exchange, or begins one where there is something to do. Never waits for the control.
    pub(in crate::gateway) async fn turn(&mut self, turn: &mut LineTurn<'_>) {
        let shared = turn.shared;
        let demands: Vec<OutputDemand> = {
            let core = shared.core();
            self.registers.iter().map(|one| OutputDemand::of(shared, &core, one.id, turn.now)).collect()
        };
        if shared.core().leaving {
            self.strobe.leaves();
        }
        if self.go_on(turn).await == Went::Well {
            self.begin(turn, &demands).await;
        }
        let is_waiting = self.strobe.waits.is_some();
        let mut looks_again = Moment::END;
        for register in self.registers.iter_mut().filter(|_| !is_waiting) {
            looks_again = looks_again.min(register.read_applied(turn).await);
        }
        for (register, demand) in self.registers.iter_mut().zip(&demands) {
            if is_waiting {
                register.publish(shared, demand, None);
            } else {
                register.ends_turn(turn, demand);
            }
        }
        self.strobe.is_untaken = self.is_bound();
        self.strobe.publish(shared);
        self.due = self.next_turn(&shared.profile, turn.line.looked()).min(looks_again);
    }

    /// Goes on with a handshake; one that failed, or that a gateway before this one left, has its strobe dropped.
    async fn go_on(&mut self, turn: &mut LineTurn<'_>) -> Went {
        while let Some((wait, ..)) = self.strobe.waits {
            match (self.strobe.wait(turn).await, wait) {
                (Waited::Still, _) => return Went::NoFurther,
                (Waited::Missing, Wait::Acknowledge) => {
                    self.transaction.attempt(Attempt::Refused);
                    return self.doubt(turn.shared);
                }
                (Waited::Failed, Wait::Acknowledge) => {
                    self.transaction.attempt(Attempt::Unknown);
                    return self.doubt(turn.shared);
                }
                (Waited::Failed | Waited::Missing, _) => return self.doubt(turn.shared),
                (Waited::Over, Wait::Clear) => {}
                (Waited::Over, Wait::Acknowledge) => {
                    self.transaction.attempt(Attempt::Acknowledged);
                    if !self.strobe.lower(turn).await {
                        return self.doubt(turn.shared);
                    }
                    let handshake = &turn.shared.profile.set(self.id).handshake;
                    let timeout = handshake.as_ref().map(|handshake| handshake.timeout);
                    self.strobe.wait_for(turn.shared, Wait::Release, timeout.unwrap_or_default());
                }
                (Waited::Over, Wait::Release) => self.is_taken(turn.shared),
            }
        }
        if self.strobe.stands == Stands::Up {
            let may_try = turn.now >= self.tries_from || turn.shared.core().leaving;
            if !may_try {
                return Went::NoFurther;
            }
            if !self.strobe.lower(turn).await {
                return self.doubt(turn.shared);
            }
        }
        Went::Well
    }

    async fn begin(&mut self, turn: &mut LineTurn<'_>, demands: &[OutputDemand]) {
        let (shared, now) = (turn.shared, turn.now);
        let restarts = demands.iter().map(|demand| demand.restarts).max().unwrap_or_default();
        if std::mem::replace(&mut self.restarts, restarts) != restarts {
            self.transaction.forget_number();
        }
        for (register, demand) in self.registers.iter_mut().zip(demands) {
            register.begins_turn(shared, demand, now);
        }
        self.keep(turn).await;
        // What is to be written now was asked for after a read of another turn.
        self.give_up_writing(turn);
        let (registers, members) = (&self.registers, self.members());
        let can_hold = |place: usize, value| registers[place].can_hold_again(value, &demands[place], now);
        let again = self.transaction.demanded_again(&members, can_hold).into_iter().flatten();
        for ((register, demand), value) in self.registers.iter_mut().zip(demands).zip(again) {
            register.demand_again(shared, value, demand, now);
        }
        let sends = self.sends_anyway(shared, now);
        let changes = self.registers.iter().any(|register| register.may_write(now));
        let reads = self.registers.iter().any(|register| register.action() == Action::Read);
        if (sends || changes) && self.is_clear(turn).await == Went::NoFurther {
            return;
        }
        if !(sends || changes || reads) {
            return;
        }
        let Some(found) = self.read(turn).await else {
            self.tries_from = turn.line.looked().after(RETRY);
            return;
        };
        self.keep(turn).await;
        self.wait_for_each_other(turn);
        let writes = self.registers.iter().any(Register::is_writing);
        if !(writes || sends) {
            return;
        }
        if !(sends || changes) && shared.profile.set(self.id).handshake.is_some() {
            // Whether the acknowledge is down was not asked: the next turn does.
            return;
        }
        if self.send(turn, &found).await == Went::NoFurther {
            return;
        }
        let Some(stands) = self.read(turn).await else { return };
        self.keep(turn).await;
        if !self.transaction.is_sent(&self.counts(&stands)) || shared.core().leaving {
            return;
        }
        if shared.profile.set(self.id).handshake.is_none() {
            self.is_taken(shared);
        } else if self.strobe.raise(turn).await {
            let _ = self.go_on(turn).await;
        } else {
            self.doubt(shared);
        }
    }

    /// It is to be sent, whether or not one of its members is to be written: because it is refreshed, because its control
    /// word says something else now, or because the control has not taken what stands there.
    fn sends_anyway(&self, shared: &LineHandle, now: Moment) -> bool {
        if now < self.tries_from {
            return false;
        }
        let set = shared.profile.set(self.id);
        let has_own_registers = (set.heartbeat.is_some() || set.control.is_some()) && shared.may_beat();
        let is_driven = self.registers.iter().any(|one| one.controller.is_driven());
        let is_due = self.refreshes(&shared.profile).is_some_and(|refresh| now >= refresh);
        let has_news = set.control.is_some() && self.sent_control != Some(self.control(shared));
        let is_untaken = self.is_bound()
            && (has_own_registers || self.registers.iter().all(|one| one.state().is_settled()));
        (has_own_registers && (is_due || has_news)) || (is_driven && (is_due || is_untaken))
    }

    /// What lands together moves together: where a late write forbids one of them its next step, all wait.
    fn wait_for_each_other(&mut self, turn: &LineTurn<'_>) {
        let waits = |register: &Register| register.controller.is_armed() && register.is_waiting_for_late();
        if !self.registers.iter().any(waits) {
            return;
        }
        for register in &mut self.registers {
            if let Action::Write { is_repeat: false, .. } = register.action() {
                register.result(turn, Input::Fact(Fact::NotSent));
            }
        }
    }

    fn give_up_writing(&mut self, turn: &LineTurn<'_>) {
        for register in self.registers.iter_mut().filter(|register| register.is_writing()) {
            register.result(turn, Input::Fact(Fact::NotSent));
        }
    }

    /// When it is to be sent again though nothing is to change.
    fn refreshes(&self, profile: &Profile) -> Option<Moment> {
        let refresh = profile.set(self.id).members(profile).filter_map(|output| output.refresh).min();
        refresh.map(|refresh| self.written_at.after(refresh))
    }

    /// The acknowledge is down, so that the next one answers the next strobe.
    async fn is_clear(&mut self, turn: &mut LineTurn<'_>) -> Went {
        let shared = turn.shared;
        let Some(handshake) = &shared.profile.set(self.id).handshake else { return Went::Well };
        if turn.shared.core().leaving {
            return Went::Well;
        }
        let is_down = self.strobe.stands != Stands::Unknown || self.strobe.lower(turn).await;
        if is_down {
            self.strobe.wait_for(turn.shared, Wait::Clear, handshake.timeout);
        }
        match if is_down { self.strobe.wait(turn).await } else { Waited::Failed } {
            Waited::Over => Went::Well,
            Waited::Still => Went::NoFurther,
            Waited::Failed | Waited::Missing => self.doubt(turn.shared),
        }
    }

    /// Every register of the set as it stands now. Each member learns what it holds; one behind an interlock does not: what
    /// is there may be off, or starting.
    async fn read(&mut self, turn: &mut LineTurn<'_>) -> Option<Vec<Encoded>> {
        let profile = &turn.shared.profile;
        let set = profile.set(self.id);
        let Found { values, sequence, heartbeat, asked } = match together::read(turn, set).await {
            Ok(found) => found,
            Err(fault) => {
                for register in self.registers.iter_mut().filter(|one| one.action() == Action::Read) {
                    register.fail(turn.shared, fault, Access::Read);
                    register.result(turn, Input::Fact(Fact::NoAnswer));
                }
                return None;
            }
        };
        for (register, found) in self.registers.iter_mut().zip(&values) {
            if register.may_hear_a_read() {
                let found = register.units.found(found.registers());
                register.result(turn, Input::Fact(Fact::Read { found, asked }));
            }
        }
        self.beat = heartbeat.unwrap_or(self.beat);
        let now = turn.line.looked();
        let late = self.registers.iter().map(|one| one.settings.late).max().unwrap_or_default();
        let commit = self.transaction.read(sequence, &self.counts(&values), late, now);
        self.commit(turn.shared, commit, now);
        Some(values)
    }

    /// Writes the values, and where all of them have arrived, the sequence. Whether all of it was answered as done.
    async fn send(&mut self, turn: &mut LineTurn<'_>, found: &[Encoded]) -> Went {
        let (shared, now) = (turn.shared, turn.line.looked());
        let Some((values, not_after)) = self.values(turn, found).await else {
            self.give_up_writing(turn);
            self.send_own_alone(turn).await;
            let refresh = self.refreshes(&shared.profile).filter(|refresh| *refresh > now);
            self.tries_from = now.after(RETRY).min(refresh.unwrap_or(Moment::END));
            return Went::NoFurther;
        };
        let set = shared.profile.set(self.id);
        let own = self.own(shared, now);
        let Own { heartbeat, control, .. } = own;
        let sent = together::write(turn, set, &values, own, Leave::Here(not_after)).await;
        let fault = sent.err();
        let left = turn.line.looked();
        let may_have_arrived = fault.is_none_or(|(_, outcome)| outcome != Outcome::NotDone);
        for (register, value) in self.registers.iter_mut().zip(&values) {
            if !register.is_writing() {
                if may_have_arrived {
                    let value = register.units.found(value.registers());
                    let fact = Fact::WentAlong { value, left, is_done: fault.is_none() };
                    register.step(shared, Input::Fact(fact), left);
                }
                continue;
            }
            let result = match fault {
                None => Input::Fact(Fact::Done { left }),
                Some(fault) => register.failed(shared, fault, left),
            };
            register.result(turn, result);
        }
        if may_have_arrived {
            (self.beat, self.written_at) = (heartbeat, left);
            self.sent_control = fault.is_none().then_some(control);
            let says_enabled = control & Control::ENABLE != 0;
            self.strobe.says_enabled = says_enabled || (self.strobe.says_enabled && fault.is_some());
            let counts = self.counts(&values);
            self.transaction.sends(counts);
        }
        self.log_own_registers(shared, fault.map(|(fault, _)| fault), left);
        if fault.is_some() {
            self.tries_from = left.after(RETRY);
            let commit = self.transaction.is_not_done();
            self.commit(shared, commit, left);
            return Went::NoFurther;
        }
        Went::Well
    }

    /// The words of the set that are no value of an output.
    fn own(&self, shared: &LineHandle, now: Moment) -> Own {
        let sequence = shared.profile.set(self.id).sequence.map(|_| self.transaction.next_number());
        let heartbeat = if shared.head_lives(now) { together::next_beat(self.beat) } else { self.beat };
        Own { sequence, heartbeat, control: self.control(shared) }
    }

    /// While a late write forbids the members, heartbeat and control word continue without them. Not in a set whose control takes
    /// all of it or nothing: there they wait, too.
    async fn send_own_alone(&mut self, turn: &mut LineTurn<'_>) {
        let (shared, now) = (turn.shared, turn.line.looked());
        let set = shared.profile.set(self.id);
        let is_due = self.refreshes(&shared.profile).is_some_and(|refresh| now >= refresh)
            || (set.control.is_some() && self.sent_control != Some(self.control(shared)));
        if !set.has_own_words_apart() || !shared.may_beat() || !is_due {
            return;
        }
        let own = self.own(shared, now);
        let fault = together::write_own(turn, set, own).await.err();
        let left = turn.line.looked();
        if fault.is_none_or(|(_, outcome)| outcome != Outcome::NotDone) {
            (self.beat, self.written_at) = (own.heartbeat, left);
            self.sent_control = fault.is_none().then_some(own.control);
        }
        self.log_own_registers(shared, fault.map(|(fault, _)| fault), left);
    }

    /// A heartbeat and a control word are only counted.
    fn log_own_registers(&self, shared: &LineHandle, fault: Option<Fault>, now: Moment) {
        let set = shared.profile.set(self.id);
        if set.heartbeat.is_none() && set.control.is_none() {
            return;
        }
        let log = &mut shared.core().storage.outputs;
        match fault {
            None => log.wrote(Steady::Set(self.id), None, now),
            Some(fault) => log.not_written(Steady::Set(self.id), &fault, now),
        }
    }

    /// Value of each member, and the last moment for them. `None` if one of them may not even go along now, or if these values are
    /// only half of what was sent before.
    async fn values(&mut self, turn: &mut LineTurn<'_>, found: &[Encoded]) -> Option<(Vec<Encoded>, Moment)> {
        let (shared, now) = (turn.shared, turn.line.looked());
        // Nothing is begun that would be given up: the next attempt would wait for it.
        let next = self.registers.iter().zip(self.counts(found)).map(|(one, stands)| match one.action() {
            Action::Write { value, is_repeat: false, .. } => value,
            _ => stands,
        });
        let next: Vec<_> = next.collect();
        if !self.transaction.is_whole(&self.members(), &next) {
            return None;
        }
        let mut values = Vec::new();
        let mut last = Moment::END;
        for (register, &stands) in self.registers.iter_mut().zip(found) {
            if register.state().is_interlocked() && !register.is_writing() {
                // Behind an interlock it stays as it is, whatever that is.
                values.push(stands);
                continue;
            }
            if !register.is_writing() {
                register.step(shared, Input::Fact(Fact::GoesAlong), now);
                if register.action() == Action::Keep {
                    let result = register.keep(turn).await?;
                    register.result(turn, result);
                    register.step(shared, Input::Fact(Fact::GoesAlong), now);
                }
            }
            let is_as_known = register.units.found(stands.registers()) == register.held();
            values.push(match register.action() {
                Action::Write { value, not_after, is_repeat: false } => {
                    last = last.min(not_after);
                    Encoded::of(register.admitted(shared, value)?.registers())
                }
                Action::Write { .. } if is_as_known => stands,
                _ => return None,
            });
        }
        Some((values, last))
    }

    /// The control has taken what stands there.
    fn is_taken(&mut self, shared: &LineHandle) {
        self.strobe.succeeded(shared);
        if self.transaction.is_taken() {
            let now = shared.clock.now();
            for register in &mut self.registers {
                register.step(shared, Input::Set(SetCommit::Taken), now);
            }
        }
    }

    /// The control has not taken what was sent, or nobody knows.
    fn doubt(&mut self, shared: &LineHandle) -> Went {
        let now = shared.clock.now();
        self.tries_from = now.after(RETRY);
        self.transaction.doubt();
        for register in self.registers.iter_mut().filter(|one| one.controller.is_driven()) {
            register.step(shared, Input::Set(SetCommit::Failed), now);
        }
        Went::NoFurther
    }

    /// What the gateway does with the axes of this set, in bits.
    fn control(&self, shared: &LineHandle) -> u16 {
        let core = shared.core();
        let mut control = if core.leaving && core.runs_fault_actions() { 0 } else { Control::ENABLE };
        for register in &self.registers {
            let axis = shared.profile.output(register.id).axis.0;
            let state = core.compensation.decision(axis).map(|decision| decision.state);
            if !core.arming[axis].armed {
                control &= !Control::ENABLE;
            }
            control |= match state {
                Some(AxisState::Holding(_)) => Control::HOLD | Control::FAULT,
                Some(AxisState::Ramping | AxisState::Zeroed) => Control::FAULT,
                Some(AxisState::Degraded) => Control::DEGRADED,
                _ => 0,
            };
        }
        control
    }

    async fn keep(&mut self, turn: &mut LineTurn<'_>) {
        for register in &mut self.registers {
            if register.action() == Action::Keep
                && let Some(result) = register.keep(turn).await
            {
                register.result(turn, result);
            }
        }
    }

    fn next_turn(&self, profile: &Profile, now: Moment) -> Moment {
        let wants = self.registers.iter().map(|register| match register.action() {
            Action::Nothing { until } => until,
            _ => now,
        });
        let is_unfinished = self.strobe.stands == Stands::Up || self.is_bound();
        let tries = is_unfinished.then_some(self.tries_from.max(now));
        let refreshes = self.refreshes(profile).map(|at| at.max(self.tries_from));
        wants.chain(tries).chain(refreshes).min().unwrap_or(Moment::END)
    }
}

/// How the control of a set takes it.
fn taken_by(profile: &Profile, set: &OutputSet) -> Taking {
    let is_in_one = set.sequence.is_none() || cells::stretches(profile, set).len() == 1;
    match () {
        () if set.handshake.is_some() => Taking::Strobe,
        () if set.is_in_nodes(profile) => Taking::Nodes,
        () if is_in_one => Taking::AtOnce,
        () => Taking::Number,
    }
}
