//! Step of an output: the effect of a fact on its state, and the next action.

use super::event::{Doubt, Event};
use super::in_flight::{InFlightWrite, ReadResult};
use super::interpretation::{self, Meaning};
use super::saved_output::Account;
use super::settings::{Rule, Settings, Verify};
use super::state::{RETRY, State};
use super::state_parts::{ArmState, PendingAction, RequiredRead, Setpoint, TimedValue, WriteFailure};
use super::turns::Turns;
use super::{Action, Fact, Who, plan};
use crate::quantity::{Counts, Moment};

/// Processes a fact and returns the next action. While an action is pending, the result is [`Action::Nothing`].
pub fn step(state: &mut State, settings: &Settings, fact: Fact, now: Moment) -> Action {
    let fresh = take(state, settings, fact, now);
    match fact {
        Fact::PiggybackAsked => plan::piggyback(state, settings, now),
        _ => plan::act(state, settings, fresh, now),
    }
}

/// Changes the state according to a fact. If the fact is a read that showed the expected value, returns the
/// time of the read request; else `None`.
fn take(state: &mut State, settings: &Settings, fact: Fact, now: Moment) -> Option<Moment> {
    state.disk.is_unsaved |= state.copies.expire(now);
    match fact {
        Fact::Look | Fact::PiggybackAsked => {}
        Fact::Piggybacked { value, left, is_done } => {
            let answered = is_done.then_some(now);
            let sent = InFlightWrite { value, at: left, left, answered, other_seen: None, is_pinned: false };
            // If the list of copies is full, this copy is left out. Its value equals the value that was just read.
            let _ = state.copies.add(sent);
        }
        Fact::Decided { offset, target, not_after } => {
            let within = |offset: Counts| {
                if settings.rules.has(Rule::Limit) {
                    offset.clamp(-settings.limit, settings.limit)
                } else {
                    offset
                }
            };
            state.order = Some(Setpoint { offset: within(offset), target: target.map(within), not_after });
        }
        Fact::Read { found, asked }
            if ends(state, PendingAction::Reading) || state.pending_action == PendingAction::Nothing =>
        {
            return read(state, settings, found, asked, now);
        }
        Fact::NoAnswer if ends(state, PendingAction::Reading) => {
            state.reads_from = now.after(RETRY);
            state.drop_order(settings);
        }
        Fact::Done { left } => written(state, settings, Some(now), left, now),
        Fact::Unknown { left } => written(state, settings, None, left, now),
        Fact::Refused => {
            if let Some(value) = not_written(state, settings, now) {
                state.unanswered_change = state.expected().map(|stood| value - stood);
                report_untaken(state, WriteFailure::Refused, Event::WriteRefused { value });
            }
        }
        Fact::NotSent => {
            // If the output cannot be read, only an acknowledged write shows that the device can be reached.
            if not_written(state, settings, now).is_some() && settings.verify == Verify::Echo {
                state.write_failure = Some(WriteFailure::Refused);
            }
        }
        Fact::Kept if ends(state, PendingAction::Keeping) => {
            state.disk.has_begun = true;
            state.reports.disk_keeps();
        }
        Fact::NotKept if ends(state, PendingAction::Keeping) => {
            state.disk.is_unsaved = true;
            state.keeps_from = now.after(RETRY);
            state.drop_order(settings);
            state.reports.report_disk();
        }
        Fact::Lapsed => state.drop_order(settings),
        Fact::Restarted => restarted(state, settings, now),
        Fact::Interlocked => {
            state.is_interlocked = true;
            state.drop_order(settings);
        }
        Fact::Released => {
            let was_interlocked = std::mem::take(&mut state.is_interlocked);
            if was_interlocked && settings.verify == Verify::Reading {
                state.required_read.request();
            }
        }
        Fact::Paused => {
            match settings.verify {
                Verify::Reading => state.required_read.request(),
                Verify::Echo => state.required_read = RequiredRead::None,
            }
            state.drop_order(settings);
        }
        Fact::Armed { by } => arm(state, settings, by),
        Fact::Off => {
            let is_barred = matches!(state.standing, ArmState::Barred | ArmState::Confirming(_));
            switch_off(state, if is_barred { ArmState::Barred } else { ArmState::Off });
        }
        // This exchange was not requested.
        Fact::Read { .. } | Fact::NoAnswer | Fact::Kept | Fact::NotKept => {}
    }
    None
}

fn read(state: &mut State, settings: &Settings, found: Counts, asked: Moment, now: Moment) -> Option<Moment> {
    let meaning = interpretation::meaning(state, settings, found, asked);
    if state.answered.is_some() {
        state.evidence.was_unsteady = matches!(meaning, Meaning::Moved { .. });
    }
    let is_accepted = state.account.is_none_or(|account| account.doubt.is_none());
    if is_accepted {
        follow(state, settings, meaning, (found, asked), now);
    }
    let result = ReadResult {
        found,
        asked,
        late: settings.late,
        remembered: settings.remembered,
        pairs_from: state.pairs_from,
        bias: settings.bias,
    };
    state.disk.is_unsaved |= state.copies.apply_read(result);
    if state.settles_at.is_some_and(|settles| asked > settles) {
        state.settles_at = None;
    }
    state.verified = Some(TimedValue { value: found, asked });
    (state.answered, state.unanswered_change) = (None, None);
    state.required_read = RequiredRead::None;
    confirm(state, settings, found);
    (meaning == Meaning::Same).then_some(asked)
}

fn follow(
    state: &mut State,
    settings: &Settings,
    meaning: Meaning,
    (found, asked): (Counts, Moment),
    now: Moment,
) {
    let expected = state.expected();
    match meaning {
        Meaning::Same => {
            let is_written = state.answered.is_some();
            if is_written {
                state.write_failure = None;
            }
            share_is(state, found);
            if is_written && settings.is_shared {
                state.turns.ours();
                if settings.rules.has(Rule::Doubt) && state.turns.are_two_gateways() {
                    doubt(state, Doubt::SecondGateway, found);
                }
            }
        }
        Meaning::First if settings.is_shared && !settings.is_zero(found) => {
            if state.standing != ArmState::Barred {
                state.reports.report(Event::FirstAccount { found });
            }
            switch_off(state, ArmState::Barred);
        }
        Meaning::First if settings.is_shared => has_nothing_of_ours(state, found),
        Meaning::First => {}
        Meaning::Ours { sent, is_late } => {
            state.drop_order(settings);
            state.write_failure = None;
            share_is(state, found);
            if is_late {
                state.reports.report(Event::OwnWriteArrivedLate { value: found, sent });
            }
        }
        Meaning::FromBefore => {
            state.drop_order(settings);
            state.reports.report(Event::PerhapsFromBefore { value: found });
        }
        Meaning::NotTaken => {
            let event = Event::NotTaken { wrote: expected.unwrap_or(found), found };
            report_untaken(state, WriteFailure::Ignored, event);
            state.writes_from = now.after(RETRY);
        }
        Meaning::Restarted => {
            state.drop_order(settings);
            state.reports.report(Event::CncRestarted { stood: expected.unwrap_or(found) });
            if settings.is_shared {
                has_nothing_of_ours(state, found);
            }
            if found.abs_diff(settings.bias) > settings.limit.unsigned_abs() && !settings.is_shared {
                bar_foreign(state, settings.bias, found);
            }
        }
        Meaning::Foreign => bar_foreign(state, expected.unwrap_or(found), found),
        Meaning::Moved { by } => {
            state.evidence.was_like_our_own = state.unanswered_change == Some(by);
            if state.answered.is_some() {
                state.turns.ours();
            }
            let is_soon = asked.since(state.written_at) <= settings.every.saturating_mul(3);
            // The other client may have made two changes between two reads.
            state.turns.another(by.abs() <= settings.step + settings.step, is_soon);
            expected.into_iter().for_each(|expected| share_is(state, expected));
            let Some(account) = state.account else { return };
            let to = account.base + by;
            state.reports.report(Event::OperatorChanged { from: account.base, to });
            account_is(state, Account { base: to, ..account });
        }
        Meaning::Doubtful(why) => doubt(state, why, found),
    }
}

/// Records that a write failed in the way `how`. Reports `event`, unless a failure was already recorded since
/// the last verified write.
fn report_untaken(state: &mut State, how: WriteFailure, event: Event) {
    if state.write_failure.replace(how).is_none() {
        state.reports.report(event);
    }
}

/// Sets the gateway share: the register value `sum` minus the operator offset, which has not changed.
fn share_is(state: &mut State, sum: Counts) {
    if let Some(account) = state.account {
        account_is(state, Account { share: sum - account.base, ..account });
    }
}

fn account_is(state: &mut State, account: Account) {
    state.disk.is_unsaved |= state.account != Some(account);
    state.account = Some(account);
}

fn has_nothing_of_ours(state: &mut State, found: Counts) {
    account_is(state, Account { base: found, ..Account::default() });
}

fn doubt(state: &mut State, doubt: Doubt, found: Counts) {
    state.turns = Turns::default();
    let account = state.account.unwrap_or_default();
    account_is(state, Account { doubt: Some(doubt), ..account });
    state.reports.report(Event::Doubted { doubt, found, share: account.share });
    switch_off(state, ArmState::Barred);
}

fn bar_foreign(state: &mut State, expected: Counts, found: Counts) {
    if state.standing == ArmState::Armed {
        state.reports.report(Event::ForeignValue { expected, found });
        switch_off(state, ArmState::Barred);
    }
}

fn arm(state: &mut State, settings: &Settings, by: Who) {
    // Arming starts from the register value, so an earlier decision is void.
    state.drop_order(settings);
    let is_confirmed = state.account.is_some_and(|account| account.doubt.is_none());
    match (state.standing, by) {
        (ArmState::Armed | ArmState::Confirming(_), _) | (ArmState::Barred, Who::Policy) => {}
        _ if !settings.is_shared || is_confirmed => {
            if by == Who::Person {
                state.copies.pin();
            }
            state.standing = ArmState::Armed;
        }
        (_, Who::Policy) => {}
        (_, Who::Person) => {
            state.copies.pin();
            state.required_read.request();
            let shown = state.verified.map(|verified| ArmState::Confirming(verified.value));
            state.standing = shown.unwrap_or(state.standing);
        }
    }
}

/// Completes the confirmation that the operator began by arming. The gateway share is the assumed share. The difference
/// between `found` and this share is the operator offset.
///
/// The operator may have corrected the register after it was last read. A value that the gateway or a restarted CNC may
/// have caused is not accepted as a correction. The value from before the doubt is accepted, even if a late write of
/// the gateway has restored it.
fn confirm(state: &mut State, settings: &Settings, found: Counts) {
    let ArmState::Confirming(shown) = state.standing else { return };
    let account = state.account.unwrap_or_default();
    let is_ours = state.copies.of(found).is_some() || state.copies.expired_of(found).is_some();
    if settings.is_zero(found) && account.share != Counts::ZERO {
        doubt(state, Doubt::ZeroOrOurs, found);
    } else if found == shown || !is_ours || found == account.base + account.share {
        account_is(state, Account { base: found - account.share, share: account.share, doubt: None });
        state.standing = ArmState::Armed;
    } else {
        doubt(state, Doubt::ChangedWhileArming, found);
    }
}

fn restarted(state: &mut State, settings: &Settings, now: Moment) {
    state.drop_order(settings);
    if settings.verify == Verify::Reading {
        state.required_read = RequiredRead::PendingAfterRestart;
    } else {
        // A restarted control that cannot be read is assumed to hold the bias.
        let stood = state.verified.map_or(settings.bias, |verified| verified.value);
        state.reports.report(Event::CncRestarted { stood });
        state.verified = Some(TimedValue { value: settings.bias, asked: now });
        state.disk.is_unsaved = true;
    }
}

/// Handles a write that was sent. `answered` is the time at which the device answered that it has carried out the
/// write, or `None` if the result is unknown.
fn written(state: &mut State, settings: &Settings, answered: Option<Moment>, left: Moment, now: Moment) {
    let PendingAction::Writing { value, begun, read } = state.pending_action else { return };
    state.pending_action = PendingAction::Nothing;
    state.written_at = now;
    let stood = state.expected();
    if settings.verify == Verify::Echo && answered.is_some() {
        acknowledged(state, settings, value, begun, left);
        return;
    }
    let other_seen = read.filter(|asked| *asked > state.pairs_from);
    let sent = InFlightWrite { value, at: left, left, answered, other_seen, is_pinned: false };
    // A write is begun only if there is capacity for it.
    let _ = state.copies.add(sent);
    if settings.verify == Verify::Reading && (answered.is_none() || read.is_some()) {
        state.required_read.request();
    }
    if answered.is_some() {
        state.answered = Some(value);
    } else {
        state.unanswered_change = stood.map(|stood| value - stood);
        state.writes_from = now.after(RETRY);
        state.drop_order(settings);
        // A shared register is not written again as a test: reading it is sufficient.
        if state.standing == ArmState::Armed && !settings.is_shared {
            state.write_failure = Some(WriteFailure::Refused);
        }
    }
}

fn acknowledged(state: &mut State, settings: &Settings, value: Counts, begun: Moment, left: Moment) {
    state.copies.end_late(begun, settings.late, settings.remembered);
    state.verified = Some(TimedValue { value, asked: left });
    (state.disk.is_unsaved, state.write_failure) = (true, None);
    state.reports.report_acknowledged();
}

/// Handles a write that was refused or not sent. Returns the value of the write, or `None` if no write was pending.
fn not_written(state: &mut State, settings: &Settings, now: Moment) -> Option<Counts> {
    let PendingAction::Writing { value, .. } = state.pending_action else { return None };
    state.pending_action = PendingAction::Nothing;
    state.disk.is_unsaved |= settings.promises();
    state.writes_from = now.after(RETRY);
    state.drop_order(settings);
    Some(value)
}

fn switch_off(state: &mut State, to: ArmState) {
    if to == ArmState::Barred {
        // The operator may now enter any value, even a value that the gateway has sent and that may still arrive. A
        // read of such a value does not prove that the gateway's write has arrived.
        state.copies.pin();
    }
    state.standing = to;
    (state.order, state.write_failure) = (None, None);
    state.is_waiting = false;
    state.promised_until = None;
    if state.promised.take().is_some() {
        state.disk.is_unsaved = true;
    }
}

/// Ends the pending action if it equals `what`. Returns true if it has ended.
fn ends(state: &mut State, what: PendingAction) -> bool {
    let is_it = state.pending_action == what;
    if is_it {
        state.pending_action = PendingAction::Nothing;
    }
    is_it
}
