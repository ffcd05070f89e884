//! Meaning of a register value that was read. The functions do not change the state of the output.

use super::event::Doubt;
use super::settings::{Rule, Settings};
use super::state::State;
use crate::quantity::{Counts, Moment};

/// Meaning of a register value that was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Meaning {
    /// Result of the first read of the register: any value is accepted.
    First,
    /// The register holds the expected value.
    Same,
    /// Value of a write of the gateway that was sent at `sent`. `is_late`: a read after that time did not yet
    /// show the value.
    Ours { sent: Moment, is_late: bool },
    /// Unexpected value soon after a start of the gateway. It may come from a late write of the previous run.
    FromBefore,
    /// A write was acknowledged, but the register still holds the earlier value.
    NotTaken,
    /// Value that a restarted CNC may show: zero or the bias, the register value for an offset of zero. After a
    /// reported restart, any value within the limit.
    Restarted,
    /// Another client wrote to a register that belongs to the gateway.
    Foreign,
    /// The operator changed the operator offset of a shared register by this difference.
    Moved { by: Counts },
    /// The cause of the value cannot be determined.
    Doubtful(Doubt),
}

/// Determines the meaning of the value `found` that was requested at `asked`.
pub(super) fn meaning(state: &State, settings: &Settings, found: Counts, asked: Moment) -> Meaning {
    let Some(expected) = state.expected() else { return Meaning::First };
    if found == expected {
        return Meaning::Same;
    }
    if state.answered.is_some() && state.verified.is_some_and(|verified| verified.value == found) {
        return Meaning::NotTaken;
    }
    if settings.is_shared {
        shared(state, settings, expected, found, asked)
    } else {
        whole(state, settings, found)
    }
}

fn whole(state: &State, settings: &Settings, found: Counts) -> Meaning {
    let is_inside = found.abs_diff(settings.bias) <= settings.limit.unsigned_abs();
    match ours(state, settings, found) {
        Some(ours) => ours,
        None if settings.rules.has(Rule::OwnWrites)
            && let Some(sent) = state.copies.expired_of(found) =>
        {
            Meaning::Ours { sent: sent.at, is_late: true }
        }
        None if settings.is_zero(found) || (state.required_read.is_after_restart() && is_inside) => {
            Meaning::Restarted
        }
        None if state.settles_at.is_some() && is_inside => Meaning::FromBefore,
        None => Meaning::Foreign,
    }
}

fn shared(state: &State, settings: &Settings, expected: Counts, found: Counts, asked: Moment) -> Meaning {
    let doubts = settings.rules.has(Rule::Doubt);
    let ours = ours(state, settings, found);
    let is_expired = state.copies.expired_of(found).is_some();
    if settings.is_zero(found) {
        let is_base = state.account.is_none_or(|account| account.base == found);
        return match ours {
            _ if doubts && !is_base && (ours.is_some() || is_expired) => Meaning::Doubtful(Doubt::ZeroOrOurs),
            Some(ours) => ours,
            None => Meaning::Restarted,
        };
    }
    match ours {
        Some(_) if doubts && is_no_share(state, settings, found) => Meaning::Doubtful(Doubt::YoursOrOurs),
        Some(ours) => ours,
        None if is_expired && settings.rules.has(Rule::OwnWrites) => Meaning::Doubtful(Doubt::YoursOrOurs),
        None if doubts && state.required_read.is_after_restart() && state.has_anything_of_ours() => {
            Meaning::Doubtful(Doubt::Rebooted)
        }
        None if doubts && hides_a_step(state, settings, expected, asked) => {
            Meaning::Doubtful(Doubt::ChangedMeanwhile)
        }
        None if doubts && state.is_like_our_own_again(found - expected) => {
            Meaning::Doubtful(Doubt::LikeOurOwn)
        }
        None if doubts && state.answered.is_some() && state.evidence.was_unsteady => {
            Meaning::Doubtful(Doubt::Unsteady)
        }
        None => Meaning::Moved { by: found - expected },
    }
}

/// Returns whether `found` minus the operator offset exceeds both the limit and the present gateway share.
/// Two causes are possible. The operator has entered a value that the gateway sent with another operator
/// offset. Or this write of the gateway has arrived, and has overwritten a change by the operator.
fn is_no_share(state: &State, settings: &Settings, found: Counts) -> bool {
    state.account.is_some_and(|account| {
        let share = found.abs_diff(account.base);
        share > settings.limit.unsigned_abs() && share > account.share.unsigned_abs()
    })
}

fn ours(state: &State, settings: &Settings, found: Counts) -> Option<Meaning> {
    let sent = state.copies.of(found).filter(|_| settings.rules.has(Rule::OwnWrites))?;
    let is_late = state.verified.is_some_and(|verified| verified.asked > sent.left);
    Some(Meaning::Ours { sent: sent.at, is_late })
}

/// Returns whether an unanswered write may have arrived after the last read, and the operator may then have
/// changed the value before this read. The operator offset would then be wrong by one step.
fn hides_a_step(state: &State, settings: &Settings, expected: Counts, asked: Moment) -> bool {
    let mut others =
        state.copies.under_way().filter(|sent| sent.answered.is_none() && sent.value != expected);
    let Some(before) = state.verified.map(|verified| verified.asked) else { return others.next().is_some() };
    let is_long_ago = asked.since(before) > settings.every.saturating_mul(2);
    others.any(|sent| is_long_ago || sent.left >= before)
}
