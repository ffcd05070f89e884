//! Outputs that land together: read as one, written as one, taken as one.
//!
//! Whenever one of them is to be written, all of them are; where nothing is to change, that is what was just read there.
//! So a heartbeat and a control word in the set go on in every state, and only where somebody else writes to a member in
//! that very moment, that is lost.
//!
//! A control takes a set when its sequence changes or its strobe rises. Where that is not one with the values (several
//! requests, or a handshake), values can stand in the registers that were not taken. What was taken is at most a step from
//! them; so until the control has taken what stands there, nothing else is sent than just that. The next run begins with
//! it, if this one does not end in order.

use crate::fieldbus::error::{Fault, Outcome};
use crate::fieldbus::line::DeviceLine;
use crate::gateway::line_handle::LineHandle;
use crate::gateway::output::Wait;
use crate::gateway::storage::Steady;
use isotherm_core::codec::Register as Place;
use isotherm_core::compensation::AxisState;
use isotherm_core::output::{Action, Fact};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Control, Output, Profile, SetId};

use super::applied::AppliedOffset;
use super::cells::{self, Cells, Own};
use super::order::Order;
use super::register::Register;
use super::requests;
use super::sequence::Sequence;
use super::strobe::{Stands, Strobe, Waited};
use super::{Asked, RETRY, Words};

/// Owns the outputs of one set, and its strobe.
#[derive(Debug)]
pub(in crate::gateway) struct Set {
    id: SetId,
    registers: Vec<Register>,
    applied: Vec<AppliedOffset>,
    strobe: Strobe,
    /// What was sent and is to be taken.
    sent: Option<Vec<Words>>,
    /// What its outputs held when the control took them last.
    taken: Option<Vec<Words>>,
    /// The last run ended in order: what stands there first was taken.
    was_in_order: bool,
    sequence: Sequence,
    /// How often its control was restarted, as far as it has heard.
    restarts: u64,
    /// What is sent next may bear the number that the control took last: a run before this one may have sent it.
    may_bear_an_old_number: bool,
    /// The count of its writes, as it stands in the register.
    beat: u16,
    /// The control word that was sent last.
    told_control: Option<u16>,
    /// What stands in the control word may say that every axis is armed.
    may_say_enabled: bool,
    written_at: Moment,
    /// Nothing is sent for its own sake before this.
    tries_from: Moment,
    /// When it wants to be called again.
    due: Moment,
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
        let was_in_order = !is_second && registers.iter().all(|one| one.state.is_settled());
        let has_numbers = shared.profile.set(id).sequence.is_some();
        let is_bound = !was_in_order && (has_numbers || !is_taken_at_once(&shared.profile, id));
        registers.iter_mut().for_each(|register| register.is_bound = is_bound);
        Set {
            id,
            was_in_order,
            applied: registers.iter().map(|_| AppliedOffset::default()).collect(),
            registers,
            strobe: Strobe::new(id, stands),
            sent: None,
            taken: None,
            sequence: Sequence::default(),
            restarts: 0,
            may_bear_an_old_number: is_bound && has_numbers,
            beat: 0,
            told_control: None,
            may_say_enabled: false,
            written_at: Moment::default(),
            tries_from: now,
            due: now,
        }
    }

    /// When it wants to be called again, if nothing else happens.
    pub(in crate::gateway) fn due(&self) -> Moment {
        self.due
    }

    /// When the acknowledge is to be asked for again.
    pub(in crate::gateway) fn asks(&self) -> Option<Moment> {
        self.strobe.waits.map(|(.., ask)| ask)
    }

    /// The turn of one of its members came too late for what was decided.
    pub(in crate::gateway) fn is_late(&self) -> bool {
        self.registers.iter().any(|register| register.is_late)
    }

    /// Goes on with an exchange, or begins one where there is something to do. Never waits for the control.
    pub(in crate::gateway) async fn turn(&mut self, line: &mut DeviceLine, shared: &LineHandle, now: Moment) {
        let orders = self.orders(shared, now);
        if shared.core().leaving {
            self.strobe.leaves();
        }
        let went = self.go_on(line, shared, now).await;
        if went == Went::Well {
            self.begin(line, shared, &orders, now).await;
        }
        let profile = &shared.profile;
        let is_waiting = self.strobe.waits.is_some();
        let mut looks_again = Moment::END;
        let registers = self.registers.iter_mut().zip(&mut self.applied);
        for ((register, applied), output) in registers.zip(members(profile, self.id)).filter(|_| !is_waiting)
        {
            looks_again = looks_again.min(applied.look(line, shared, output, register).await);
        }
        for ((register, output), order) in
            self.registers.iter_mut().zip(members(profile, self.id)).zip(&orders)
        {
            if is_waiting {
                register.publish(shared, output, order);
            } else {
                register.ends_turn(line, shared, output, order);
            }
        }
        let is_untaken = self.registers.iter().any(|register| register.is_bound);
        self.strobe.show(shared, self.may_say_enabled, is_untaken);
        self.due = self.next_turn(shared, line.looked()).min(looks_again);
    }

    fn orders(&self, shared: &LineHandle, now: Moment) -> Vec<Order> {
        let core = shared.core();
        self.registers.iter().map(|register| Order::of(shared, &core, register.id, now)).collect()
    }

    /// Goes on with a handshake; one that failed, or that a gateway before this one left, has its strobe dropped.
    async fn go_on(&mut self, line: &mut DeviceLine, shared: &LineHandle, now: Moment) -> Went {
        while let Some((wait, ..)) = self.strobe.waits {
            match (self.strobe.wait(line, shared).await, wait) {
                (Waited::Still, _) => return Went::NoFurther,
                (Waited::Failed, _) => {
                    self.doubt(shared);
                    return Went::NoFurther;
                }
                (Waited::Over, Wait::Clear) => {}
                (Waited::Over, Wait::Acknowledge) => {
                    if !self.strobe.lower(line, shared).await {
                        self.doubt(shared);
                        return Went::NoFurther;
                    }
                    let timeout = shared.profile.set(self.id).handshake.map(|handshake| handshake.timeout);
                    self.strobe.wait_for(shared, Wait::Release, timeout.unwrap_or_default());
                }
                (Waited::Over, Wait::Release) => self.is_taken(shared),
            }
        }
        if self.strobe.stands == Stands::Up {
            let may_try = now >= self.tries_from || shared.core().leaving;
            if !may_try {
                return Went::NoFurther;
            }
            if !self.strobe.lower(line, shared).await {
                self.doubt(shared);
                return Went::NoFurther;
            }
        }
        Went::Well
    }

    async fn begin(&mut self, line: &mut DeviceLine, shared: &LineHandle, orders: &[Order], now: Moment) {
        let profile = &shared.profile;
        let restarts = orders.iter().map(|order| order.restarts).max().unwrap_or_default();
        if std::mem::replace(&mut self.restarts, restarts) != restarts {
            self.sequence.forget();
        }
        for ((register, output), order) in
            self.registers.iter_mut().zip(members(profile, self.id)).zip(orders)
        {
            register.hear(shared, output, order, now);
        }
        self.keep(line, shared, now).await;
        for register in self.registers.iter_mut().filter(|register| register.is_writing()) {
            // It was asked for after a read of another turn.
            register.comes_of(line, shared, profile.output(register.id), Fact::NotSent);
        }
        self.want_again_what_was_sent(shared, orders, now);
        let sends = self.sends_anyway(shared, now);
        let changes = self.registers.iter().any(|register| register.may_write(now));
        let reads = self.registers.iter().any(|register| register.action == Action::Read);
        if (sends || changes) && self.is_clear(line, shared).await == Went::NoFurther {
            return;
        }
        if !(sends || changes || reads) {
            return;
        }
        let Some(found) = self.read(line, shared).await else {
            self.tries_from = line.looked().after(RETRY);
            return;
        };
        self.keep(line, shared, now).await;
        self.wait_for_each_other(line, shared);
        let writes = self.registers.iter().any(|register| matches!(register.action, Action::Write { .. }));
        if !(writes || sends) {
            return;
        }
        if !(sends || changes) && profile.set(self.id).handshake.is_some() {
            // Whether the acknowledge is down was not asked: the next turn does.
            return;
        }
        if self.send(line, shared, orders, &found).await == Went::NoFurther {
            return;
        }
        let Some(stands) = self.read(line, shared).await else { return };
        self.keep(line, shared, now).await;
        if self.sent.as_ref() != Some(&stands) || shared.core().leaving {
            return;
        }
        match shared.profile.set(self.id).handshake {
            None => self.is_taken(shared),
            Some(_) if self.strobe.raise(line, shared).await => {
                let _ = self.go_on(line, shared, now).await;
            }
            Some(_) => self.doubt(shared),
        }
    }

    /// What was sent, where some of it stands there and some does not.
    fn half_sent(&self, profile: &Profile) -> Option<Vec<i64>> {
        let sent = self.sent.as_ref().filter(|_| self.registers.iter().any(|register| register.is_bound))?;
        let values = members(profile, self.id).zip(&self.registers).zip(sent);
        let values: Vec<i64> = values
            .map(|((output, register), sent)| register.units.found(&output.encoding, sent.words()))
            .collect();
        let is_new = |place: usize| self.taken.as_ref().is_none_or(|taken| taken[place] != sent[place]);
        let mut has = (false, false);
        for (place, (register, value)) in self.registers.iter().zip(&values).enumerate() {
            if register.is_driven() && is_new(place) {
                let stands = register.stands() == *value;
                has = (has.0 || stands, has.1 || !stands);
            }
        }
        (has == (true, true)).then_some(values)
    }

    /// No half of what was sent is taken. So the rest of it is wanted once more; but not after something else has happened to
    /// it, and not on readings that have died.
    fn want_again_what_was_sent(&mut self, shared: &LineHandle, orders: &[Order], now: Moment) {
        let Some(values) = self.half_sent(&shared.profile) else { return };
        let each = || self.registers.iter().zip(&values).zip(orders);
        if !each().all(|((register, value), order)| register.can_hold_again(*value, order, now)) {
            self.sent = None;
            return;
        }
        for ((register, value), order) in self.registers.iter_mut().zip(values).zip(orders) {
            register.wants_again(shared, value, order, now);
        }
    }

    /// It is to be sent, whether or not one of its members is to be written: because it is refreshed, because its control
    /// word says something else now, or because the control has not taken what stands there.
    fn sends_anyway(&self, shared: &LineHandle, now: Moment) -> bool {
        if now < self.tries_from {
            return false;
        }
        let set = shared.profile.set(self.id);
        let has_own_words = (set.heartbeat.is_some() || set.control.is_some()) && shared.may_beat();
        let is_driven = self.registers.iter().any(|one| one.is_driven());
        let is_due = self.refreshes(&shared.profile).is_some_and(|refresh| now >= refresh);
        let has_news = set.control.is_some() && self.told_control != Some(self.control(shared));
        let is_untaken = self.registers.iter().any(|one| one.is_bound)
            && (has_own_words || self.registers.iter().all(|one| one.state.is_settled()));
        (has_own_words && (is_due || has_news)) || (is_driven && (is_due || is_untaken))
    }

    /// What lands together moves together: where a late write forbids one of them its next step, all wait.
    fn wait_for_each_other(&mut self, line: &mut DeviceLine, shared: &LineHandle) {
        let waits = |register: &Register| register.heard.is_armed && register.is_waiting_for_late();
        if !self.registers.iter().any(waits) {
            return;
        }
        for register in &mut self.registers {
            if let Action::Write { is_repeat: false, .. } = register.action {
                register.comes_of(line, shared, shared.profile.output(register.id), Fact::NotSent);
            }
        }
    }

    /// When it is to be sent again though nothing is to change.
    fn refreshes(&self, profile: &Profile) -> Option<Moment> {
        let refresh = members(profile, self.id).filter_map(|output| output.refresh).min();
        refresh.map(|refresh| self.written_at.after(refresh))
    }

    /// The acknowledge is down, so that the next one answers the next strobe.
    async fn is_clear(&mut self, line: &mut DeviceLine, shared: &LineHandle) -> Went {
        let Some(handshake) = shared.profile.set(self.id).handshake else { return Went::Well };
        if shared.core().leaving {
            return Went::Well;
        }
        let is_down = self.strobe.stands != Stands::Unknown || self.strobe.lower(line, shared).await;
        if is_down {
            self.strobe.wait_for(shared, Wait::Clear, handshake.timeout);
        }
        match if is_down { self.strobe.wait(line, shared).await } else { Waited::Failed } {
            Waited::Over => Went::Well,
            Waited::Still => Went::NoFurther,
            Waited::Failed => {
                self.doubt(shared);
                Went::NoFurther
            }
        }
    }

    /// Every register of the set as it stands now. Each member learns what it holds; one behind an interlock does not: what
    /// is there may be off, or starting.
    async fn read(&mut self, line: &mut DeviceLine, shared: &LineHandle) -> Option<Vec<Words>> {
        let set = shared.profile.set(self.id);
        let mut cells = Cells::new();
        let read = requests::read(line, &shared.profile, set, &mut cells).await;
        let values: Vec<Words> = set.members(&shared.profile).map(|output| held(output, &cells)).collect();
        for ((register, output), words) in
            self.registers.iter_mut().zip(members(&shared.profile, self.id)).zip(&values)
        {
            match read {
                Err(fault) if register.action == Action::Read => {
                    register.fail(shared, output, fault, Asked::Read);
                    register.comes_of(line, shared, output, Fact::NoAnswer);
                }
                Ok(asked) if register.may_hear_a_read() => {
                    let found = register.units.found(&output.encoding, words.words());
                    register.comes_of(line, shared, output, Fact::Read { found, asked });
                }
                _ => {}
            }
        }
        read.ok()?;
        let word = |at: Option<Place>| at.and_then(|at| cells.get(&at.offset)).copied();
        let late = self.registers.iter().map(|register| register.settings.late).max().unwrap_or_default();
        let number = word(set.sequence);
        let has_come_late =
            number.is_some_and(|number| self.sequence.stands(number, &values, line.looked(), late));
        self.beat = word(set.heartbeat).unwrap_or(self.beat);
        self.bind(shared, &values, has_come_late);
        Some(values)
    }

    /// What stands there and was not taken is to be taken before anything else is sent.
    fn bind(&mut self, shared: &LineHandle, values: &[Words], has_come_late: bool) {
        if std::mem::take(&mut self.was_in_order) {
            self.taken = Some(values.to_vec());
        }
        let is_at_once = is_taken_at_once(&shared.profile, self.id);
        if has_come_late && is_at_once {
            self.sent = None;
        }
        let is_untaken = self.taken.as_deref() != Some(values);
        for register in &mut self.registers {
            register.is_bound = if is_at_once { register.is_bound || has_come_late } else { is_untaken };
        }
    }

    /// Writes the values, and where all of them have arrived, the sequence. Whether all of it was answered as done.
    async fn send(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        orders: &[Order],
        found: &[Words],
    ) -> Went {
        let set = shared.profile.set(self.id);
        let now = line.looked();
        let Some((values, not_after)) = self.values(line, shared, found, now).await else {
            self.tries_from = now.after(RETRY);
            for register in self.registers.iter_mut().filter(|register| register.is_writing()) {
                register.comes_of(line, shared, shared.profile.output(register.id), Fact::NotSent);
            }
            return Went::NoFurther;
        };
        let sequence = set.sequence.map(|_| self.sequence.next());
        let heartbeat = if shared.head_lives(now) { cells::next_beat(self.beat) } else { self.beat };
        let control = self.control(shared);
        let own = Own { sequence, heartbeat, control };
        let cells = cells::cells(&shared.profile, set, &values, own);
        let fault = requests::write(line, &shared.profile, set, &cells, not_after).await.err();
        let left = line.looked();
        let profile = &shared.profile;
        for (place, ((register, output), order)) in
            self.registers.iter_mut().zip(members(profile, self.id)).zip(orders).enumerate()
        {
            if !register.is_writing() {
                if fault.is_none_or(|(_, outcome)| outcome != Outcome::NotDone) {
                    let words = &values[place];
                    let value = register.units.found(&output.encoding, words.words());
                    register.step(shared, Fact::WentAlong { value, left, is_done: fault.is_none() }, left);
                }
                continue;
            }
            let fact = match fault {
                None => Fact::Done { left },
                Some((fault, outcome)) => register.failed(shared, output, order, (fault, outcome), left),
            };
            register.comes_of(line, shared, output, fact);
        }
        if fault.is_none_or(|(_, outcome)| outcome != Outcome::NotDone) {
            (self.beat, self.written_at) = (heartbeat, left);
            self.told_control = fault.is_none().then_some(control);
            let says_enabled = control & Control::ENABLE != 0;
            self.may_say_enabled = says_enabled || (self.may_say_enabled && fault.is_some());
            self.sent = Some(values);
        }
        self.log_own_words(shared, fault.map(|(fault, _)| fault), left);
        if fault.is_some() {
            self.tries_from = left.after(RETRY);
            let is_bound = !is_taken_at_once(profile, self.id);
            self.registers.iter_mut().for_each(|register| register.is_bound |= is_bound);
            return Went::NoFurther;
        }
        Went::Well
    }

    /// A heartbeat and a control word are only counted.
    fn log_own_words(&self, shared: &LineHandle, fault: Option<Fault>, now: Moment) {
        let set = shared.profile.set(self.id);
        if set.heartbeat.is_none() && set.control.is_none() {
            return;
        }
        let storage = &mut shared.core().storage;
        match fault {
            None => storage.wrote(Steady::Set(self.id), None, now),
            Some(fault) => storage.not_written(Steady::Set(self.id), &fault, now),
        }
    }

    /// What every member shall hold, and the last moment for that; `None` where one of them may not even go along now, or
    /// where it were half of what was sent before.
    async fn values(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        found: &[Words],
        now: Moment,
    ) -> Option<(Vec<Words>, Moment)> {
        let mut values = Vec::new();
        let mut last = Moment::END;
        for (register, &stands) in self.registers.iter_mut().zip(found) {
            let output = shared.profile.output(register.id);
            if register.interlock.is_held && !register.is_writing() {
                // Behind an interlock it stays as it is, whatever that is.
                values.push(stands);
                continue;
            }
            if !register.is_writing() {
                register.step(shared, Fact::GoesAlong, now);
                if register.action == Action::Keep {
                    let fact = register.keep(line, shared, output, now).await?;
                    register.comes_of(line, shared, output, fact);
                    register.step(shared, Fact::GoesAlong, now);
                }
            }
            let is_as_known = register.units.found(&output.encoding, stands.words()) == register.stands();
            values.push(match register.action {
                Action::Write { value, not_after, is_repeat: false } => {
                    last = last.min(not_after);
                    register.is_to_be_changed = false;
                    Words::of(register.units.registers(&output.encoding, value).words())
                }
                Action::Write { .. } if is_as_known => stands,
                _ => return None,
            });
        }
        // Where what was sent before is there by half, all of it is sent, or nothing.
        let half = self.half_sent(&shared.profile);
        let is_whole = half.is_none_or(|_| {
            let sent = self.sent.iter().flatten();
            let mut each = self.registers.iter().zip(&values).zip(sent);
            each.all(|((register, value), sent)| value == sent || !register.is_driven())
        });
        is_whole.then_some((values, last))
    }

    /// The control has taken what stands there, but for a number that it may know: then the same is sent with the next.
    fn is_taken(&mut self, shared: &LineHandle) {
        self.strobe.succeeded(shared);
        if std::mem::take(&mut self.may_bear_an_old_number) {
            return;
        }
        self.taken = self.sent.take();
        for (register, output) in self.registers.iter_mut().zip(members(&shared.profile, self.id)) {
            register.is_bound = false;
            register.recover(shared, output);
        }
    }

    /// The control has not taken what was sent, or nobody knows.
    fn doubt(&mut self, shared: &LineHandle) {
        self.tries_from = shared.clock.now().after(RETRY);
        self.taken = None;
        for register in &mut self.registers {
            register.is_bound |= register.is_driven();
            register.is_not_taken(shared);
        }
    }

    /// What the gateway does with the axes of this set, in bits.
    fn control(&self, shared: &LineHandle) -> u16 {
        let core = shared.core();
        let mut control = if core.leaving { 0 } else { Control::ENABLE };
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

    async fn keep(&mut self, line: &mut DeviceLine, shared: &LineHandle, now: Moment) {
        for register in &mut self.registers {
            let output = shared.profile.output(register.id);
            if register.action == Action::Keep
                && let Some(fact) = register.keep(line, shared, output, now).await
            {
                register.comes_of(line, shared, output, fact);
            }
        }
    }

    fn next_turn(&self, shared: &LineHandle, now: Moment) -> Moment {
        let wants = self.registers.iter().map(|register| match register.action {
            Action::Nothing { until } => until,
            _ => now,
        });
        let is_unfinished = self.strobe.stands == Stands::Up || self.registers.iter().any(|one| one.is_bound);
        let tries = is_unfinished.then_some(self.tries_from.max(now));
        let refreshes = self.refreshes(&shared.profile).map(|at| at.max(self.tries_from));
        wants.chain(tries).chain(refreshes).min().unwrap_or(Moment::END)
    }
}

/// What its registers hold is what the control has taken: it comes with the sequence, or the control takes what it finds.
fn is_taken_at_once(profile: &Profile, id: SetId) -> bool {
    let set = profile.set(id);
    set.handshake.is_none() && (set.sequence.is_none() || cells::stretches(profile, set).len() == 1)
}

fn members(profile: &Profile, id: SetId) -> impl Iterator<Item = &Output> {
    profile.set(id).members(profile)
}

fn held(output: &Output, found: &Cells) -> Words {
    let count = output.encoding.data_type.registers();
    let first = output.address.register();
    first.map_or(Words::of(&[]), |first| cells::value(found, first.offset, count))
}
