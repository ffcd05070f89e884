//! Model around one output: register, operator, line, disk, and time in whole seconds.

use std::time::Duration;

use isotherm_core::output::{
    Account, Action, ArmState, Condition, Controller, Demand, Event, Fact, Input, Mode, OutputDecision,
    OutputHealth, Promise, Rule, SavedOutput, Settings, Slots, State, Trouble, Verify, Who,
};
use isotherm_core::quantity::{Counts, Moment};

use super::budget::Budget;
use super::moves::SinceRead;

/// Present time, which is constant. Passing time moves everything else into the past.
pub(crate) const NOW: Moment = Moment::from_nanos(1_000_000_000_000);
const SECOND: Duration = Duration::from_secs(1);

/// Write that has been sent and may arrive later.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Held {
    pub(crate) value: Counts,
    pub(crate) age: u64,
    /// Whether the CNC restarted, or the operator corrected the register, since the read before the write. The
    /// resulting value cannot be promised then.
    pub(crate) is_excused: bool,
    /// Whether its change may exceed a step for that reason. This ends with the next write, which must be near this
    /// one.
    pub(crate) may_jump: bool,
}

/// Result of a check: the violated property.
pub(crate) type Broken = Result<(), String>;

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct World {
    pub(crate) gateway: Option<Controller>,
    /// Who has armed the axis.
    pub(crate) armed: Option<Who>,
    pub(crate) interlock: Condition,
    pub(crate) disk: Option<SavedOutput>,
    pub(crate) register: Counts,
    /// Operator offset as the operator knows it. For a whole register, the bias.
    pub(crate) his: Counts,
    /// Operator offset before a restart of the CNC that the gateway has not read. A write restores it.
    pub(crate) lost: Option<Counts>,
    pub(crate) held: [Option<Held>; 2],
    pub(crate) wanted: Counts,
    /// Target of the last decision.
    pub(crate) target: Counts,
    /// Mode of the axis at its decision.
    pub(crate) mode: Mode,
    /// Value that the control applies, and seconds until it applies the register value.
    pub(crate) applied: (Counts, u64),
    /// Last decision of the guard, if there is a guard.
    pub(crate) guard: Option<Counts>,
    /// Seconds for which the latest decision may still be carried out. `None` without a decision.
    pub(crate) order: Option<u64>,
    pub(crate) since_read: SinceRead,
    /// Whether the CNC has restarted, and that is not on disk yet.
    pub(crate) is_restarted: bool,
    /// Whether another client has ever changed the register.
    pub(crate) is_touched: bool,
    pub(crate) left: Budget,
}

impl World {
    pub(crate) fn new(settings: &Settings, left: Budget) -> World {
        let kept = SavedOutput {
            in_order: true,
            account: settings.is_shared.then_some(Account { base: settings.bias, ..Account::default() }),
            stood: Some(settings.bias),
            ..SavedOutput::default()
        };
        let mut world = World {
            gateway: None,
            armed: None,
            interlock: Condition::Met,
            disk: Some(kept),
            register: settings.bias,
            his: settings.bias,
            lost: None,
            held: [None; 2],
            wanted: settings.limit + Counts(1),
            target: Counts::ZERO,
            mode: Mode::Follow,
            applied: (settings.bias, 0),
            guard: left.has_guard.then_some(Counts::ZERO),
            order: None,
            since_read: SinceRead::default(),
            is_restarted: false,
            is_touched: false,
            left,
        };
        world.start(settings);
        world
    }

    pub(crate) fn start(&mut self, settings: &Settings) {
        let state = State::new(settings, self.disk.as_ref(), NOW);
        let mut gateway = Controller::new(settings, state, 0, NOW);
        gateway.step(settings, Fact::Look.into(), NOW);
        self.gateway = Some(gateway);
        (self.order, self.armed) = (None, None);
    }

    /// Returns the pending action of the gateway.
    pub(crate) fn action(&self) -> Action {
        self.gateway.map_or(Action::Nothing { until: NOW }, |gateway| gateway.action())
    }

    /// Returns the state of the register, as the gateway knows it.
    pub(crate) fn shown(&self, settings: &Settings) -> Option<isotherm_core::output::OutputView> {
        self.gateway.map(|gateway| gateway.state().shown(settings))
    }

    /// Gives the gateway an input. If it requests nothing then, its turn ends.
    pub(crate) fn give(&mut self, settings: &Settings, input: impl Into<Input>) -> Broken {
        self.take(settings, input.into())?;
        if let Some(gateway) = self.gateway
            && matches!(self.action(), Action::Nothing { .. })
        {
            if gateway.applied_due(settings) <= NOW {
                let found = Some(self.applied.0.0 * 1000);
                self.take(settings, Input::Applied { found, asked: NOW })?;
            }
            self.take(settings, Input::TurnEnds)?;
        }
        self.arm_by_policy(settings)
    }

    /// Gives the gateway an input. If it disarms the axis, it must report why.
    fn take(&mut self, settings: &Settings, input: Input) -> Broken {
        let Some(gateway) = &mut self.gateway else { return Ok(()) };
        let before = gateway.state().shown(settings).standing;
        gateway.step(settings, input, NOW);
        let shown = gateway.state().shown(settings);
        let (events, action) = (gateway.take_events(), gateway.action());
        let is_verified = gateway.health(settings, self.interlock) == Some(OutputHealth::Verified);
        let keeps_order = match input {
            Input::Fact(fact) => {
                matches!(
                    fact,
                    Fact::Read { .. } | Fact::Done { .. } | Fact::Kept | Fact::Look | Fact::PiggybackAsked
                )
            }
            Input::NotSent(_) => false,
            _ => true,
        };
        if !keeps_order {
            self.order = None;
        }
        let is_switched_off = matches!(input, Input::Demand(Demand { armed: None, .. }));
        if before == ArmState::Armed && shown.standing != ArmState::Armed && !is_switched_off {
            let is_reported = events.iter().any(|event| event.switches_off());
            is_reported.then_some(()).ok_or("switched off without a reason reported")?;
        }
        let blames = |event: &Event| event.switches_off() || matches!(event, Event::OperatorChanged { .. });
        if let Some(event) = events.iter().find(|event| blames(event) && !self.is_touched) {
            return Err(format!("nobody has touched the register, but it says {event:?}"));
        }
        for event in events.iter() {
            match event {
                Event::ForeignValue { .. } | Event::Question => self.armed = None,
                Event::TakeOver { .. } => self.takes_over(settings),
                _ => {}
            }
        }
        if input == Input::TurnEnds && action == (Action::Nothing { until: NOW.min(self.wakes()) }) {
            return Err("it is to be called again at once, for nothing".to_owned());
        }
        let has_ended = input == Input::TurnEnds && settings.applied.is_some() && self.armed.is_some();
        if has_ended && is_verified && shown.is_untaken {
            return Err("it is shown as verified, and the register does not take what is written".to_owned());
        }
        let longest = NOW.after(settings.late);
        let is_short = shown.waits_until.is_none_or(|until| until <= longest);
        is_short.then_some(()).ok_or_else(|| "it waits longer than a write can be late".to_owned())
    }

    /// Returns the time of the next call.
    fn wakes(&self) -> Moment {
        match self.action() {
            Action::Nothing { until } => until,
            _ => Moment::END,
        }
    }

    /// Returns the present demand on the output.
    pub(crate) fn demand(&self, decision: Option<OutputDecision>) -> Input {
        Input::Demand(Demand {
            armed: self.armed,
            interlock: self.interlock,
            decision,
            restarts: 0,
            pauses: 0,
        })
    }

    /// Arms as `arm = "auto"` does: after the first read of the register, if its value is within the limit.
    fn arm_by_policy(&mut self, settings: &Settings) -> Broken {
        let Some(shown) = self.shown(settings) else { return Ok(()) };
        let inside = |value: Counts| settings.is_shared || (value - settings.bias).abs() <= settings.limit;
        let is_known = shown.verified.is_some_and(|seen| inside(seen.value));
        let is_idle = matches!(self.action(), Action::Nothing { .. });
        if shown.standing == ArmState::Off && is_known && is_idle && self.armed.is_none() {
            self.takes_over(settings);
            self.armed = Some(Who::Policy);
            return self.give(settings, self.demand(None));
        }
        Ok(())
    }

    /// Returns the value of the requested write. A change must be based on a decision that is still valid.
    pub(crate) fn write(&self, settings: &Settings) -> Result<Option<Counts>, String> {
        let Action::Write { value, not_after, is_repeat } = self.action() else { return Ok(None) };
        if self.interlock != Condition::Met {
            return Err(format!("{value} is sent although the interlock does not allow it"));
        }
        if !is_repeat && self.order.is_none() {
            return Err(format!("{value} is sent on readings that are too old"));
        }
        if not_after < NOW {
            return Err(format!("{value} is sent after its last moment"));
        }
        if !is_repeat && self.mode == Mode::Hold && self.guard.is_some() {
            return Err(format!("{value} is sent although the axis holds"));
        }
        if !is_repeat {
            self.leads_to_target(settings, value)?;
            self.is_applied(settings, value)?;
        }
        Ok(Some(value))
    }

    /// Checks that no new value is sent before the control applies the register value.
    fn is_applied(&self, settings: &Settings, value: Counts) -> Broken {
        let Some(seen) = self.shown(settings).and_then(|shown| shown.verified) else { return Ok(()) };
        let is_changed = self.since_read != SinceRead::default();
        if settings.applied.is_none() || self.applied.0 == seen.value || is_changed {
            return Ok(());
        }
        Err(format!(
            "{value} is sent: the register holds {}, and the control applies {}",
            seen.value, self.applied.0
        ))
    }

    /// Checks rule R11: a value is between the known register value and the target.
    fn leads_to_target(&self, settings: &Settings, value: Counts) -> Broken {
        let Some(shown) = self.shown(settings) else { return Ok(()) };
        let Some(seen) = shown.verified else { return Ok(()) };
        let centre = shown.account.map_or(settings.bias, |account| account.base);
        let (lowest, highest) = settings.range;
        let target = (centre + self.target.clamp(-settings.limit, settings.limit)).clamp(lowest, highest);
        let is_avoided = settings.is_shared && settings.is_zero(target) && target != centre;
        let beyond = Counts(i64::from(is_avoided));
        let (low, high) = (seen.value.min(target - beyond), seen.value.max(target + beyond));
        if (low..=high).contains(&value) {
            return Ok(());
        }
        Err(format!("{value} leads away from the target {target}: the register holds {}", seen.value))
    }

    /// Returns the decision: the target, or one step nearer to it. While the register waits, the guard stays within one
    /// step of it.
    fn decides(&mut self, settings: &Settings) -> Counts {
        let Some(guard) = self.guard else { return self.wanted };
        let shown = self.shown(settings);
        let centre = shown.and_then(|shown| shown.account).map_or(settings.bias, |account| account.base);
        let stands = shown.and_then(|shown| shown.verified).map(|seen| seen.value - centre);
        let change = self.wanted.clamp(-settings.limit, settings.limit) - guard;
        let decided = guard + change.clamp(-settings.step, settings.step);
        let near = |stands: Counts| decided.clamp(stands - settings.step, stands + settings.step);
        let decided = stands.filter(|_| settings.rules.has(Rule::NoWindup)).map_or(decided, near);
        self.guard = Some(decided);
        decided
    }

    /// Starts an armed axis from its register value.
    fn takes_over(&mut self, settings: &Settings) {
        let Some(shown) = self.shown(settings) else { return };
        let centre = shown.account.map_or(settings.bias, |account| account.base);
        let stands = shown.verified.map_or(Counts::ZERO, |seen| seen.value - centre);
        self.guard = self.guard.map(|_| stands.clamp(-settings.limit, settings.limit));
    }

    /// Delivers a write of the gateway to the register.
    pub(crate) fn deliver(
        &mut self,
        settings: &Settings,
        value: Counts,
        (is_excused, may_jump): (bool, bool),
    ) -> Broken {
        if !holds(settings, value) {
            return Err(format!("the register cannot hold {value}"));
        }
        let before = std::mem::replace(&mut self.register, value);
        if self.applied.1 == 0 {
            self.applied.0 = value;
        }
        self.his = self.lost.take().unwrap_or(self.his);
        let jump = (value - before).abs();
        if jump > settings.step && !may_jump {
            return Err(format!("a jump of {jump}: {before} to {value}"));
        }
        if !may_jump {
            self.held.iter_mut().flatten().for_each(|held| held.may_jump = false);
        }
        if is_excused {
            return Ok(());
        }
        let distance = |sum: Counts| (sum - self.his).abs();
        if distance(value) > settings.limit && distance(value) > distance(before) {
            return Err(format!("{value} is beyond the limit, with {} of the operator's", self.his));
        }
        Ok(())
    }

    /// Stores the state that the gateway writes to disk. Times are only for messages, and are cleared.
    pub(crate) fn keep(&mut self, settings: &Settings, kept: Option<SavedOutput>) {
        let Some(kept) = kept else { return };
        let mut promises = Slots::default();
        for promise in kept.promises.iter() {
            assert!(promises.push(Promise { at: Moment::default(), ..*promise }));
        }
        self.disk = Some(SavedOutput { promises, ..kept });
        self.notices_restart(settings);
    }

    /// Lets a second pass, without a step of the gateway.
    pub(crate) fn pass(&mut self, settings: &Settings) {
        for slot in &mut self.held {
            *slot = slot.map(|held| Held { age: held.age + 1, ..held });
            *slot = slot.filter(|held| Duration::from_secs(held.age) <= settings.late);
        }
        self.held.sort_by_key(|held| held.map(|held| (held.value, held.age)));
        self.order = self.order.and_then(|order| order.checked_sub(1));
        let past = |moment: Moment| if moment == Moment::END { moment } else { moment.before(SECOND) };
        self.gateway = self.gateway.map(|gateway| gateway.moved(past, Moment::default()));
        self.applied.1 = self.applied.1.saturating_sub(1);
        if self.applied.1 == 0 {
            self.applied.0 = self.register;
        }
    }

    /// Returns the world in a form in which equal worlds behave equally.
    pub(crate) fn canonical(&self, settings: &Settings) -> World {
        let span = settings.late + settings.remembered + settings.every * 3;
        let oldest = NOW.before(span);
        let gateway = self.gateway.map(|gateway| gateway.moved(|moment| moment.max(oldest), NOW));
        World { gateway, ..self.clone() }
    }

    pub(crate) fn put_on_hold(&mut self, value: Counts) -> bool {
        let Some(slot) = self.held.iter_mut().find(|held| held.is_none()) else { return false };
        let is_moved = self.since_read.is_moved;
        *slot = Some(Held { value, age: 0, is_excused: is_moved, may_jump: is_moved });
        self.held.sort_by_key(|held| held.map(|held| (held.value, held.age)));
        true
    }

    /// Reads the set that contains the output, and sends it with the value that was read.
    pub(crate) fn goes_along(&mut self, settings: &Settings) -> Broken {
        self.answer_read(settings)?;
        match self.action() {
            Action::Nothing { .. } if self.interlock == Condition::Met => {
                self.give(settings, Fact::PiggybackAsked)
            }
            _ => Ok(()),
        }
    }

    /// Records a change of the register that is not by the gateway.
    pub(crate) fn is_moved_by_others(&mut self) {
        (self.since_read.is_moved, self.is_touched) = (true, true);
        let held = self.held.iter_mut().flatten();
        held.for_each(|held| (held.is_excused, held.may_jump) = (true, true));
    }

    /// Returns whether the register holds its final value.
    pub(crate) fn is_at_rest(&self, settings: &Settings) -> bool {
        let offset = self.wanted.clamp(-settings.limit, settings.limit);
        let sum = (self.his + offset).clamp(settings.range.0, settings.range.1);
        let is_avoided = settings.is_shared && settings.is_zero(sum) && self.his != sum;
        self.register == sum || (is_avoided && (self.register - sum).abs() == Counts(1))
    }

    /// Returns the seconds until the register permanently holds the correct value, if there are no more faults.
    pub(crate) fn runs_out(&self, settings: &Settings) -> Result<u64, String> {
        let mut world = self.clone();
        world.held = [None; 2];
        world.interlock = Condition::Met;
        let mut rested = 0;
        let longest = 2 * settings.late.as_secs() + 2 * settings.limit.unsigned_abs() + 16;
        for second in 0..longest {
            for _ in 0..40 {
                if !world.serve(settings)? {
                    break;
                }
            }
            if !world.is_at_rest(settings) {
                rested = second + 1;
            }
            world.second(settings, true)?;
        }
        let account = world.shown(settings).and_then(|shown| shown.account);
        if rested == longest {
            return Err(format!("it never comes to rest: {} stands there, {world:?}", world.register));
        }
        if world.shown(settings).is_some_and(|shown| shown.is_untaken) {
            return Err(
                "what is wanted stands there, and it is said that the register does not take it".to_owned()
            );
        }
        if account.is_some_and(|account| account.base != world.his) {
            return Err(format!("the operator's part is {}, the ledger says {account:?}", world.his));
        }
        Ok(rested)
    }

    /// Executes the pending action correctly, including those of the operator. Returns whether there was one.
    fn serve(&mut self, settings: &Settings) -> Result<bool, String> {
        if self.gateway.is_none() {
            self.start(settings);
        }
        match self.action() {
            Action::Read => self.answer_read(settings)?,
            Action::Keep => {
                self.keep(settings, self.gateway.map(|gateway| gateway.state().kept()));
                self.give(settings, Input::OnDisk)?;
            }
            Action::Write { .. } => {
                let value = self.write(settings)?.unwrap_or_default();
                self.deliver(settings, value, (self.since_read.is_moved, self.since_read.is_moved))?;
                self.give(settings, Fact::Done { left: NOW })?;
            }
            Action::Nothing { .. } => return self.persons_turn(settings, false),
        }
        Ok(true)
    }

    pub(crate) fn answer_read(&mut self, settings: &Settings) -> Broken {
        (self.since_read, self.lost) = (SinceRead::default(), None);
        self.give(settings, Fact::Read { found: self.register, asked: NOW })?;
        self.notices_restart(settings);
        Ok(())
    }

    /// Records that the restart was read and is on disk.
    fn notices_restart(&mut self, settings: &Settings) {
        let known = self.gateway.and_then(|gateway| gateway.state().kept().account);
        let is_kept = known == self.disk.and_then(|kept| kept.account);
        self.is_restarted &=
            !(is_kept && known.is_none_or(|account| settings.is_zero(account.base + account.share)));
        self.is_restarted |= self.lost.is_some();
    }

    /// Executes the operator's part if only the operator can decide: corrects the register, and arms when it is shown
    /// correctly. Returns whether anything was done. `at_once` means without waiting until it is shown.
    pub(crate) fn persons_turn(&mut self, settings: &Settings, at_once: bool) -> Result<bool, String> {
        let Some(shown) = self.shown(settings) else { return Ok(false) };
        let stands = shown.verified.map(|seen| seen.value);
        let is_beyond = !settings.is_shared && (self.register - settings.bias).abs() > settings.limit;
        if shown.standing != ArmState::Barred && !(shown.standing == ArmState::Off && is_beyond) {
            return Ok(false);
        }
        let is_on_disk = self.disk.and_then(|kept| kept.account).is_none_or(|one| one.doubt.is_some());
        if settings.is_shared && !is_on_disk {
            return Ok(false);
        }
        let share = shown.account.map_or(Counts::ZERO, |account| account.share);
        if settings.is_shared && share != Counts::ZERO && settings.is_zero(self.his + share) {
            self.his = self.his + Counts(if settings.is_zero(self.his + share + Counts(1)) { 2 } else { 1 });
        }
        let right = match settings.is_shared {
            true => self.his + share,
            false if is_beyond => settings.bias,
            false => self.register,
        };
        if self.register != right {
            self.register = right;
            self.is_moved_by_others();
            if !at_once {
                return Ok(true);
            }
        }
        let is_due = stands == Some(right) || at_once;
        if is_due {
            self.takes_over(settings);
            self.armed = Some(Who::Person);
            self.give(settings, self.demand(None))?;
        }
        Ok(is_due)
    }

    /// Begins the next second with a decision, or without one if the readings are stale.
    pub(crate) fn second(&mut self, settings: &Settings, is_fresh: bool) -> Broken {
        self.pass(settings);
        if self.gateway.is_none() {
            return Ok(());
        }
        let mode = self.mode(settings, is_fresh);
        if mode == Mode::Follow {
            self.guard_is_near(settings)?;
        }
        let decision = match mode {
            Mode::Follow => Some((self.decides(settings), self.wanted)),
            // Without a guard, nothing is decided while the readings are stale.
            Mode::Hold | Mode::Finish => self.guard.map(|guard| (guard, guard)),
        };
        self.decided(settings, decision, (mode, is_fresh))
    }

    /// Checks that a deciding axis has resumed from the register value: its Cz is within two steps of it. A late write
    /// may have moved the register by one step since.
    fn guard_is_near(&self, settings: &Settings) -> Broken {
        let (Some(guard), Some(gateway)) = (self.guard, self.gateway) else {
            return Ok(());
        };
        let shown = gateway.state().shown(settings);
        let is_verified = gateway.health(settings, self.interlock) == Some(OutputHealth::Verified);
        let Some(seen) = shown.verified.filter(|_| is_verified && self.armed.is_some()) else {
            return Ok(());
        };
        let centre = shown.account.map_or(settings.bias, |account| account.base);
        let held = (seen.value - centre).clamp(-settings.limit, settings.limit);
        if (guard - held).abs() <= settings.step + settings.step || !settings.rules.has(Rule::NoWindup) {
            return Ok(());
        }
        Err(format!("the axis decides from {guard}, and the register holds {held}"))
    }

    /// Passes the decision of the axis to the gateway, if there is one.
    pub(crate) fn decided(
        &mut self,
        settings: &Settings,
        decision: Option<(Counts, Counts)>,
        (mode, is_fresh): (Mode, bool),
    ) -> Broken {
        if is_fresh {
            self.order = Some(1);
        }
        let until = |left| NOW.after(SECOND * u32::try_from(left).unwrap());
        let not_after = self.order.map_or(NOW.before(SECOND), until);
        let trouble = self.gateway.and_then(|gateway| gateway.trouble());
        // An offset that the register did not take is sent again, even if the axis holds it.
        let is_untaken = matches!(trouble, Some(Trouble::Untaken | Trouble::StillUntaken));
        self.mode = if is_untaken { Mode::Finish } else { mode };
        self.target = decision.map_or(self.target, |(_, target)| target);
        let decision = decision.map(|(offset, target)| OutputDecision {
            offset,
            target: Some(target),
            at: NOW,
            not_after,
            mode,
        });
        let is_due = decision.is_some() || self.wakes() <= NOW;
        if is_due && matches!(self.action(), Action::Nothing { .. }) {
            return self.give(settings, self.demand(decision));
        }
        Ok(())
    }

    /// Returns the mode of the axis. It holds its offset while its readings are stale, and while its output is in
    /// trouble or locked.
    pub(crate) fn mode(&self, settings: &Settings, is_fresh: bool) -> Mode {
        let health = self.gateway.and_then(|gateway| gateway.health(settings, self.interlock));
        match health {
            _ if !is_fresh => Mode::Hold,
            Some(OutputHealth::Unverified | OutputHealth::Interlocked) if self.guard.is_some() => Mode::Hold,
            _ => Mode::Follow,
        }
    }
}

/// Returns whether the register's type contains this count.
pub(crate) fn holds(settings: &Settings, value: Counts) -> bool {
    let (lowest, highest) = settings.range;
    (lowest..=highest).contains(&value)
}

/// Creates settings with step 1 for a whole register. A shared one has step 2, so that a zero can be skipped.
pub(crate) fn settings(is_shared: bool, limit: i64, late: u64) -> Settings {
    Settings {
        step: Counts(if is_shared { 2 } else { 1 }),
        limit: Counts(limit),
        bias: Counts::ZERO,
        range: (Counts(-200), Counts(200)),
        late: Duration::from_secs(late),
        remembered: Duration::from_secs(2),
        every: SECOND,
        refresh: None,
        is_shared,
        verify: Verify::Reading,
        applied: None,
        rules: isotherm_core::output::Rules::default(),
    }
}
