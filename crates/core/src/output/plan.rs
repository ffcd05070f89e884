//! What to do next, from what is known.

use std::time::Duration;

use super::Action;
use super::copies::{Copies, Room};
use super::event::Event;
use super::settings::{Settings, Verify};
use super::standing::{ArmState, Doing, Order, Seen, Untaken};
use super::state::{RETRY, State};
use crate::quantity::{Counts, Moment};

/// Where a change can go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Aim {
    /// What stands there is what is wanted.
    There,
    /// This value is nearer, and may be sent.
    Send(Counts),
    /// Whatever is nearer is too far from what may still arrive.
    Blocked,
}

/// Chooses the next action and takes note of it. `fresh`: a read asked then has just shown nothing new.
pub(super) fn act(state: &mut State, settings: &Settings, fresh: Option<Moment>, now: Moment) -> Action {
    match state.doing {
        Doing::Nothing => {}
        _ => return Action::Nothing { until: Moment::END },
    }
    // Whoever waited and wants nothing any more does not wait.
    let is_long_ago = now.since(state.waited_at) > settings.every * 2;
    state.is_waiting &= !is_long_ago || state.waits_until(settings).is_some();
    let aim = change(state, settings, now);
    if settings.is_shared && aim == Some(Aim::There) && fresh.is_some() {
        // It is not written again to find out: what is wanted stands there.
        state.untaken = None;
    }
    if aim.is_some() {
        note_waiting(state, settings, aim, now);
    }
    if state.must_read && now >= state.reads_from {
        return read(state);
    }
    saves_only_what_it_must(state, settings);
    if aim == Some(Aim::There) && state.promised.take().is_some() {
        (state.is_unsaved, state.promised_until) = (true, None);
    }
    let keeps = now >= state.keeps_from;
    if keeps && state.is_unsaved && !matches!(aim, Some(Aim::Send(_))) {
        return keep(state);
    }
    let writes = keeps && now >= state.writes_from;
    if writes && let Some(Aim::Send(value)) = aim {
        if let Some(asked) = fresh.or((settings.verify == Verify::Echo).then_some(now)) {
            return send(state, settings, value, asked, now);
        }
        if now >= state.reads_from && !state.is_unsaved {
            return read(state);
        }
    }
    if keeps && state.is_unsaved {
        return keep(state);
    }
    if let Some(seen) = state.verified
        && writes
        && repeats(state, settings, aim, now)
    {
        // Nobody's edit and no zero of a restarted CNC is written over: a repeat follows a read as every write does.
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

/// In one request with others, in every state: what stands there, as it was just read. Nothing, where a late write could
/// then be too far from it.
pub(super) fn go_along(state: &mut State, settings: &Settings, now: Moment) -> Action {
    let Some(seen) = state.verified.filter(|_| state.doing == Doing::Nothing) else {
        return Action::Nothing { until: Moment::END };
    };
    saves_only_what_it_must(state, settings);
    let is_known = !state.must_read && state.answered.is_none() && !settings.is_shared;
    let may = now >= state.keeps_from || state.has_begun_on_disk;
    if is_known && may && state.copies.has_room() && is_repeatable(state, settings, seen) {
        return repeat(state, settings, seen, now);
    }
    Action::Nothing { until: until(state, settings, None, now) }
}

/// A whole register says itself what is in it: what else is known of it goes on disk whenever that is written. That the gateway writes
/// is on disk before the first write.
fn saves_only_what_it_must(state: &mut State, settings: &Settings) {
    let has_to_begin = !state.has_begun_on_disk && state.standing == ArmState::Armed;
    state.is_unsaved &= settings.promises() || has_to_begin;
}

/// Where the change that is wanted now can go; `None` where none is wanted, or may be made.
fn change(state: &State, settings: &Settings, now: Moment) -> Option<Aim> {
    let order = state.order.filter(|order| now <= order.not_after || !settings.rules.last_moment)?;
    let stands = state.expected()?;
    (state.standing == ArmState::Armed && !state.is_interlocked && !state.must_read).then_some(())?;
    if state.settles_at.is_some() && settings.rules.near_what_may_arrive {
        return Some(Aim::Blocked);
    }
    Some(aim(state, settings, stands, order, now))
}

/// Zero is what a restarted CNC shows: an operator's part is never hidden by it. The count beside it is near enough.
fn avoids(settings: &Settings, centre: Counts, value: Counts) -> bool {
    settings.is_shared && settings.rules.doubt && settings.is_zero(value) && value != centre
}

/// This offset from the operator's part, or from the bias, is what a register that holds `stands` has.
pub(super) fn is_there(state: &State, settings: &Settings, stands: Counts, offset: Counts) -> bool {
    let centre = state.centre(settings);
    let target = settings.target(centre, offset);
    stands == target || (avoids(settings, centre, target) && stands.abs_diff(target) == 1)
}

/// Lowest and highest value that a write may have: from the register value to the target. One count more if the target itself is a
/// zero that is avoided; the whole range if no target is known.
fn way(state: &State, settings: &Settings, stands: Counts, order: Order) -> (Counts, Counts) {
    let Some(target) = order.target.filter(|_| settings.rules.no_windup) else { return settings.range };
    let centre = state.centre(settings);
    let target = settings.target(centre, target);
    let beyond = Counts(i64::from(avoids(settings, centre, target)));
    (stands.min(target - beyond), stands.max(target + beyond))
}

fn aim(state: &State, settings: &Settings, stands: Counts, order: Order, now: Moment) -> Aim {
    if is_there(state, settings, stands, order.offset) {
        return Aim::There;
    }
    if !state.copies.has_room() {
        return Aim::Blocked;
    }
    let centre = state.centre(settings);
    let (low, high) = way(state, settings, stands, order);
    let wanted = settings.target(centre, order.offset);
    // The guard may still be on the other side of the register, which waits until the guard has passed it.
    let target = wanted.clamp(low, high);
    if target == stands {
        return Aim::There;
    }
    let (lowest, highest) = settings.range;
    let may_be_sent = |value: &Counts| {
        room(state, settings, stands).contains(*value)
            && (lowest..=highest).contains(value)
            && (low..=high).contains(value)
            && is_inside(settings, stands, *value, centre)
            && target.abs_diff(*value) < target.abs_diff(stands)
            && !avoids(settings, centre, *value)
    };
    let is_young = state.promised_until.is_none_or(|until| now <= until) || !settings.rules.last_moment;
    if let Some(promised) = state.promised.filter(|promised| is_young && may_be_sent(promised)) {
        return Aim::Send(promised);
    }
    let beside = |value: Counts| [value, value - Counts(1), value + Counts(1)];
    let candidates = room(state, settings, stands).nearest(target).into_iter().flat_map(beside);
    let nearest = candidates.filter(may_be_sent).min_by_key(|value| target.abs_diff(*value));
    nearest.map_or(Aim::Blocked, Aim::Send)
}

/// Within a step of what stands there and of everything that may still arrive.
fn room(state: &State, settings: &Settings, stands: Counts) -> Room {
    if settings.rules.near_what_may_arrive {
        state.copies.room(stands, settings.step, settings.reach())
    } else {
        Copies::default().room(stands, settings.step, settings.step)
    }
}

/// Within the limit, or nearer to it than what stands there.
fn is_inside(settings: &Settings, stands: Counts, value: Counts, centre: Counts) -> bool {
    let distance = value.abs_diff(centre);
    !settings.rules.limit || distance <= settings.limit.unsigned_abs() || distance < stands.abs_diff(centre)
}

/// A change that waits is reported once; what was decided before a wait is not sent after it.
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

/// Directly after a read that showed nothing new: the promise, or the write that it was for.
fn send(state: &mut State, settings: &Settings, value: Counts, asked: Moment, now: Moment) -> Action {
    if settings.promises() && (state.promised != Some(value) || state.is_unsaved) {
        if state.promised != Some(value) {
            state.promised_until = state.order.map(|order| order.not_after);
        }
        state.promised = Some(value);
        return keep(state);
    }
    if !state.has_begun_on_disk {
        return keep(state);
    }
    let promised_until = state.promised.take().and(state.promised_until.take());
    let read = (settings.verify == Verify::Reading).then_some(asked);
    state.doing = Doing::Writing { value, begun: now, read };
    let not_after = state.order.map_or(now, |order| order.not_after);
    let not_after = promised_until.map_or(not_after, |until| until.min(not_after));
    // One decision moves the register once: how fast it may go is the axis's to say.
    state.drop_order(settings);
    Action::Write { value, not_after, is_repeat: false }
}

/// What stands there is due to be sent again: because it is refreshed; because only that shows that a register which
/// did not take what was written can be written again; or because of an output that cannot be read nothing else says
/// that what was under way has not arrived.
fn repeats(state: &State, settings: &Settings, aim: Option<Aim>, now: Moment) -> bool {
    let Some(seen) = state.verified else { return false };
    let rests = !state.is_waiting && aim.is_none_or(|aim| aim == Aim::There) && state.answered.is_none();
    let is_due = settings.refresh.is_some_and(|refresh| now >= state.written_at.after(refresh));
    let clears = settings.verify == Verify::Echo
        && state.copies.first_over(settings.late).is_some_and(|over| now > over);
    let may = state.standing == ArmState::Armed && !state.is_interlocked && !state.must_read;
    let is_settled = state.settles_at.is_none() && state.copies.has_room();
    let shows = match state.untaken {
        None => false,
        Some(Untaken::Refused) => true,
        Some(Untaken::Ignored) => aim == Some(Aim::There),
    };
    may && (rests && (is_due || shows) || clears)
        && is_settled
        && !settings.is_shared
        && is_repeatable(state, settings, seen)
}

/// A late one that arrives after it would be at most one step away from it.
fn is_repeatable(state: &State, settings: &Settings, seen: Seen) -> bool {
    let room = state.copies.room(seen.value, settings.step, settings.step);
    room.contains(seen.value) || !settings.rules.near_what_may_arrive
}

fn repeat(state: &mut State, settings: &Settings, seen: Seen, now: Moment) -> Action {
    if !state.has_begun_on_disk || state.is_unsaved {
        return keep(state);
    }
    state.doing = Doing::Writing { value: seen.value, begun: now, read: None };
    debug_assert!(!settings.is_shared, "a shared register is never refreshed");
    Action::Write { value: seen.value, not_after: Moment::END, is_repeat: true }
}

fn keep(state: &mut State) -> Action {
    state.doing = Doing::Keeping;
    state.is_unsaved = false;
    Action::Keep
}

fn read(state: &mut State) -> Action {
    state.doing = Doing::Reading;
    Action::Read
}

/// When the register is read next, if nothing else comes before.
fn next_read(state: &State, settings: &Settings) -> Moment {
    if settings.verify == Verify::Echo {
        return Moment::END;
    }
    let Some(seen) = state.verified else { return state.reads_from };
    if state.is_interlocked {
        // What is behind an interlock may be off, or starting: it is read when that is over.
        return Moment::END;
    }
    let is_certain = state.copies.under_way().next().is_none() && state.settles_at.is_none();
    let span = if is_certain { settings.every } else { settings.every.min(RETRY) };
    let over = state.copies.first_over(settings.late).into_iter().chain(state.settles_at).min();
    let ends = over.map_or(Moment::END, |over| over.after(Duration::from_nanos(1)));
    seen.asked.after(span).min(ends.max(seen.asked)).max(state.reads_from)
}

fn until(state: &State, settings: &Settings, aim: Option<Aim>, now: Moment) -> Moment {
    let read = if state.must_read { state.reads_from } else { next_read(state, settings) };
    let has_to_write = state.is_unsaved || matches!(aim, Some(Aim::Send(_)));
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
