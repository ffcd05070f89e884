//! Choice of the next action of an output from its state.

use std::time::Duration;

use super::Action;
use super::event::Event;
use super::in_flight::{InFlightWrites, SendRange};
use super::settings::{Rule, Settings, Verify};
use super::state::{RETRY, State};
use super::state_parts::{ArmState, PendingAction, Setpoint, TimedValue, WriteFailure};
use crate::quantity::{Counts, Moment};

/// Result of the search for a value to send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Aim {
    /// The register holds the requested value.
    There,
    /// This value is nearer to the requested value than the register value, and may be sent.
    Send(Counts),
    /// Every value that is nearer to the requested value is too far from a write that may still arrive.
    Blocked,
}

/// Chooses the next action and records it. `fresh` is the request time of a read that has just shown the
/// expected value; `None` if there was no such read.
pub(super) fn act(state: &mut State, settings: &Settings, fresh: Option<Moment>, now: Moment) -> Action {
    match state.pending_action {
        PendingAction::Nothing => {}
        _ => return Action::Nothing { until: Moment::END },
    }
    // A wait ends if no change has been requested for a long time.
    let is_long_ago = now.since(state.waited_at) > settings.every * 2;
    state.is_waiting &= !is_long_ago || state.waits_until(settings).is_some();
    let aim = change(state, settings, now);
    if settings.is_shared && aim == Some(Aim::There) && fresh.is_some() {
        // The register holds the requested value, so it is not written again as a test.
        state.write_failure = None;
    }
    if aim.is_some() {
        note_waiting(state, settings, aim, now);
    }
    if state.required_read.is_pending() && now >= state.reads_from {
        return read(state);
    }
    saves_only_what_it_must(state, settings);
    if aim == Some(Aim::There) && state.promised.take().is_some() {
        (state.disk.is_unsaved, state.promised_until) = (true, None);
    }
    let keeps = now >= state.keeps_from;
    if keeps && state.disk.is_unsaved && !matches!(aim, Some(Aim::Send(_))) {
        return keep(state);
    }
    let writes = keeps && now >= state.writes_from;
    if writes && let Some(Aim::Send(value)) = aim {
        if let Some(asked) = fresh.or((settings.verify == Verify::Echo).then_some(now)) {
            return send(state, settings, value, asked, now);
        }
        if now >= state.reads_from && !state.disk.is_unsaved {
            return read(state);
        }
    }
    if keeps && state.disk.is_unsaved {
        return keep(state);
    }
    if let Some(seen) = state.verified
        && writes
        && repeats(state, settings, aim, now)
    {
        // A repeat follows a read, like every write. Otherwise it could overwrite an edit, or the zero of a restarted
        // CNC.
        if fresh.is_some() || settings.verify == Verify::Echo {
            return repeat(state, settings, seen, now);
        }
        if now >= state.reads_from {
            return read(state);
        }
    }
    if now >= next_read(state, settings) {
        return read(state);
    }
    Action::Nothing { until: until(state, settings, aim, now) }
}

/// Chooses the action if a request with the values of other outputs is sent. The register value of this
/// output is sent in the same request, unchanged. If a late write could then move the register by more than
/// one step, the value is not sent.
pub(super) fn piggyback(state: &mut State, settings: &Settings, now: Moment) -> Action {
    let Some(seen) = state.verified.filter(|_| state.pending_action == PendingAction::Nothing) else {
        return Action::Nothing { until: Moment::END };
    };
    saves_only_what_it_must(state, settings);
    let is_known = !state.required_read.is_pending() && state.answered.is_none() && !settings.is_shared;
    let may = now >= state.keeps_from || state.disk.has_begun;
    if is_known && may && state.copies.has_room() && is_repeatable(state, settings, seen) {
        return repeat(state, settings, seen, now);
    }
    Action::Nothing { until: until(state, settings, None, now) }
}

/// Limits the writes to disk. A register that can be read and is not shared needs no saved value. For such a
/// register, the gateway only saves, before the first write, that this run writes to the register.
fn saves_only_what_it_must(state: &mut State, settings: &Settings) {
    let has_to_begin = !state.disk.has_begun && state.standing == ArmState::Armed;
    state.disk.is_unsaved &= settings.promises() || has_to_begin;
}

/// Returns the value to send for the requested change. `Aim` also states why a requested change is not sent now. `None`
/// if no change is requested, or if the output is in a state in which nothing may be sent (for example not armed).
fn change(state: &State, settings: &Settings, now: Moment) -> Option<Aim> {
    let order =
        state.order.filter(|order| now <= order.not_after || !settings.rules.has(Rule::LastMoment))?;
    let current = state.expected()?;
    (state.standing == ArmState::Armed && !state.is_interlocked && !state.required_read.is_pending())
        .then_some(())?;
    if state.settles_at.is_some() && settings.rules.has(Rule::NearCopies) {
        return Some(Aim::Blocked);
    }
    Some(aim(state, settings, current, order, now))
}

/// Returns whether this value must be avoided: in a shared register, zero looks like a restarted CNC, and would hide
/// the operator offset. The gateway then writes the adjacent count.
fn avoids(settings: &Settings, centre: Counts, value: Counts) -> bool {
    settings.is_shared && settings.rules.has(Rule::Doubt) && settings.is_zero(value) && value != centre
}

/// Returns whether a register with the value `current` contains this offset: the value minus the operator offset of a
/// shared register, or minus the bias.
pub(super) fn is_there(state: &State, settings: &Settings, current: Counts, offset: Counts) -> bool {
    let centre = state.centre(settings);
    let target = settings.target(centre, offset);
    current == target || (avoids(settings, centre, target) && current.abs_diff(target) == 1)
}

/// Returns the lowest and the highest value that a write may have: between the register value and the target.
/// One more count is allowed beyond a target that is a zero to avoid. Without a target, the whole range of
/// the register is allowed.
fn way(state: &State, settings: &Settings, current: Counts, order: Setpoint) -> (Counts, Counts) {
    let Some(target) = order.target.filter(|_| settings.rules.has(Rule::NoWindup)) else {
        return settings.range;
    };
    let centre = state.centre(settings);
    let target = settings.target(centre, target);
    let beyond = Counts(i64::from(avoids(settings, centre, target)));
    (current.min(target - beyond), current.max(target + beyond))
}

fn aim(state: &State, settings: &Settings, current: Counts, order: Setpoint, now: Moment) -> Aim {
    if is_there(state, settings, current, order.offset) {
        return Aim::There;
    }
    if !state.copies.has_room() {
        return Aim::Blocked;
    }
    let centre = state.centre(settings);
    let (low, high) = way(state, settings, current, order);
    let wanted = settings.target(centre, order.offset);
    // The decided offset may be on the other side of the register value than the target. The register then keeps its
    // value until the decided offset has passed it.
    let target = wanted.clamp(low, high);
    if target == current {
        return Aim::There;
    }
    let (lowest, highest) = settings.range;
    let may_be_sent = |value: &Counts| {
        room(state, settings, current).contains(*value)
            && (lowest..=highest).contains(value)
            && (low..=high).contains(value)
            && is_inside(settings, current, *value, centre)
            && target.abs_diff(*value) < target.abs_diff(current)
            && !avoids(settings, centre, *value)
    };
    let is_young =
        state.promised_until.is_none_or(|until| now <= until) || !settings.rules.has(Rule::LastMoment);
    if let Some(promised) = state.promised.filter(|promised| is_young && may_be_sent(promised)) {
        return Aim::Send(promised);
    }
    let beside = |value: Counts| [value, value - Counts(1), value + Counts(1)];
    let candidates = room(state, settings, current).nearest(target).into_iter().flat_map(beside);
    let nearest = candidates.filter(may_be_sent).min_by_key(|value| target.abs_diff(*value));
    nearest.map_or(Aim::Blocked, Aim::Send)
}

/// Returns the values within one step of the register value and of every value that may still arrive.
fn room(state: &State, settings: &Settings, current: Counts) -> SendRange {
    if settings.rules.has(Rule::NearCopies) {
        state.copies.room(current, settings.step, settings.reach())
    } else {
        InFlightWrites::default().room(current, settings.step, settings.step)
    }
}

/// Returns whether a value is within the limit, or nearer to the limit than the register value.
fn is_inside(settings: &Settings, current: Counts, value: Counts, centre: Counts) -> bool {
    let distance = value.abs_diff(centre);
    !settings.rules.has(Rule::Limit)
        || distance <= settings.limit.unsigned_abs()
        || distance < current.abs_diff(centre)
}

/// Reports a waiting change once, and drops its decision, which must not be sent after the wait.
fn note_waiting(state: &mut State, settings: &Settings, aim: Option<Aim>, now: Moment) {
    if aim != Some(Aim::Blocked) {
        state.is_waiting = false;
        return;
    }
    state.drop_order(settings);
    state.waited_at = now;
    if !std::mem::replace(&mut state.is_waiting, true) {
        let until = state.waits_until(settings).unwrap_or(now);
        state.reports.report(Event::WaitingForLateWrite { seconds: until.since(now).as_secs() });
    }
}

/// Chooses the next action to send `value`: first to save the value to disk as a promise, if that is
/// necessary, then to write it. If the register can be read, the caller has just read the expected value.
fn send(state: &mut State, settings: &Settings, value: Counts, asked: Moment, now: Moment) -> Action {
    if settings.promises() && (state.promised != Some(value) || state.disk.is_unsaved) {
        if state.promised != Some(value) {
            state.promised_until = state.order.map(|order| order.not_after);
        }
        state.promised = Some(value);
        return keep(state);
    }
    if !state.disk.has_begun {
        return keep(state);
    }
    let promised_until = state.promised.take().and(state.promised_until.take());
    let read = (settings.verify == Verify::Reading).then_some(asked);
    state.pending_action = PendingAction::Writing { value, begun: now, read };
    let not_after = state.order.map_or(now, |order| order.not_after);
    let not_after = promised_until.map_or(not_after, |until| until.min(not_after));
    // One decision moves the register once. The axis decides the rate.
    state.drop_order(settings);
    Action::Write { value, not_after, is_repeat: false }
}

/// Returns whether the register value must be sent again, for one of three reasons:
/// - its period `refresh` is over;
/// - a register that did not take the last write must be tested;
/// - the output cannot be read, and only another acknowledged write ends an unanswered write.
fn repeats(state: &State, settings: &Settings, aim: Option<Aim>, now: Moment) -> bool {
    let Some(seen) = state.verified else { return false };
    let rests = !state.is_waiting && aim.is_none_or(|aim| aim == Aim::There) && state.answered.is_none();
    let is_due = settings.refresh.is_some_and(|refresh| now >= state.written_at.after(refresh));
    let clears = settings.verify == Verify::Echo
        && state.copies.first_over(settings.late).is_some_and(|over| now > over);
    let may = state.standing == ArmState::Armed && !state.is_interlocked && !state.required_read.is_pending();
    let is_settled = state.settles_at.is_none() && state.copies.has_room();
    let shows = match state.write_failure {
        None => false,
        Some(WriteFailure::Refused) => true,
        Some(WriteFailure::Ignored) => aim == Some(Aim::There),
    };
    may && (rests && (is_due || shows) || clears)
        && is_settled
        && !settings.is_shared
        && is_repeatable(state, settings, seen)
}

/// Returns whether the register value may be sent again. A late write that arrives after this repetition must
/// change the register by one step at most.
fn is_repeatable(state: &State, settings: &Settings, seen: TimedValue) -> bool {
    let room = state.copies.room(seen.value, settings.step, settings.step);
    room.contains(seen.value) || !settings.rules.has(Rule::NearCopies)
}

fn repeat(state: &mut State, settings: &Settings, seen: TimedValue, now: Moment) -> Action {
    if !state.disk.has_begun || state.disk.is_unsaved {
        return keep(state);
    }
    state.pending_action = PendingAction::Writing { value: seen.value, begun: now, read: None };
    debug_assert!(!settings.is_shared, "a shared register is never refreshed");
    Action::Write { value: seen.value, not_after: Moment::END, is_repeat: true }
}

fn keep(state: &mut State) -> Action {
    state.pending_action = PendingAction::Keeping;
    state.disk.is_unsaved = false;
    Action::Keep
}

fn read(state: &mut State) -> Action {
    state.pending_action = PendingAction::Reading;
    Action::Read
}

/// Returns the time of the next read, if no other action comes first.
fn next_read(state: &State, settings: &Settings) -> Moment {
    if settings.verify == Verify::Echo {
        return Moment::END;
    }
    let Some(seen) = state.verified else { return state.reads_from };
    if state.is_interlocked {
        // While the interlock is open, the device may be off or starting. The register is read when the interlock
        // closes.
        return Moment::END;
    }
    let is_certain = state.copies.under_way().next().is_none() && state.settles_at.is_none();
    let span = if is_certain { settings.every } else { settings.every.min(RETRY) };
    let over = state.copies.first_over(settings.late).into_iter().chain(state.settles_at).min();
    let ends = over.map_or(Moment::END, |over| over.after(Duration::from_nanos(1)));
    seen.asked.after(span).min(ends.max(seen.asked)).max(state.reads_from)
}

fn until(state: &State, settings: &Settings, aim: Option<Aim>, now: Moment) -> Moment {
    let read = if state.required_read.is_pending() { state.reads_from } else { next_read(state, settings) };
    let has_to_write = state.disk.is_unsaved || matches!(aim, Some(Aim::Send(_)));
    let write = if has_to_write {
        state.writes_from.max(state.keeps_from).max(state.reads_from)
    } else {
        Moment::END
    };
    let is_armed = state.standing == ArmState::Armed;
    let refresh = settings.refresh.filter(|_| is_armed).map(|refresh| state.written_at.after(refresh));
    let clears = state.copies.first_over(settings.late).filter(|_| is_armed);
    let later = |moment: Moment| if moment > now { moment } else { now.after(RETRY) };
    [Some(read), Some(write), refresh.map(later), clears.map(later)]
        .into_iter()
        .flatten()
        .min()
        .unwrap_or(Moment::END)
}
