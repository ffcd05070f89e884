//! Sensors that others stand in for, for people and for programs.

use crate::observe::events::{Event, StandIn};
use crate::observe::status::StoodInStatus;
use isotherm_core::compensation::{Decision, StoodIn};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_profile::Profile;

/// `bed frozen, taken from 5 others`.
pub(super) fn message(profile: &Profile, found: &StoodIn) -> String {
    let is = if found.frozen { "frozen" } else { "lost" };
    format!("{} {is}, taken from {} others", profile.signal(found.signal).name, found.others)
}

/// What is to be reported: when it begins, and when it ends or is another sensor. While no model can be used, nothing is known of
/// either.
pub(super) fn events(
    profile: &Profile,
    axis: &str,
    decision: &Decision,
    reported: &mut Option<SignalId>,
) -> impl Iterator<Item = Event> {
    let found = decision.stood_in.filter(|found| *reported != Some(found.signal));
    let is_over = decision.model.is_some()
        && reported.is_some_and(|signal| decision.stood_in.is_none_or(|found| found.signal != signal));
    let name = |signal| profile.signal(signal).name.clone();
    let over = reported
        .filter(|_| is_over)
        .map(|signal| StandIn::Over { axis: axis.to_owned(), signal: name(signal) });
    let taken = found.map(|found| StandIn::Taken {
        axis: axis.to_owned(),
        signal: name(found.signal),
        frozen: found.frozen,
        span: decision.at.since(found.since),
        others: found.others,
    });
    if is_over || found.is_some() {
        *reported = decision.stood_in.map(|found| found.signal);
    }
    over.into_iter().chain(taken).map(Event::StandIn)
}

/// The same for programs; `stamp`: of a counted moment.
pub(super) fn status(profile: &Profile, found: &StoodIn, stamp: impl Fn(Moment) -> Moment) -> StoodInStatus {
    StoodInStatus {
        signal: profile.signal(found.signal).name.clone(),
        frozen: found.frozen,
        since: stamp(found.since).to_string(),
        others: found.others,
    }
}
