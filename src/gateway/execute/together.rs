//! Requests for all values of a set, which are in registers or in nodes.

use super::LineTurn;
use super::{cells, nodes};
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{Fault, Outcome};
use isotherm_core::codec::Encoded;
use isotherm_core::output::OwnWords;
use isotherm_core::quantity::Moment;
use isotherm_profile::OutputSet;

/// Values of a set, as they were read.
#[derive(Clone, Debug)]
pub(super) struct Found {
    /// Value of each member.
    pub(super) values: Vec<Encoded>,
    pub(super) sequence: Option<u16>,
    pub(super) heartbeat: Option<u16>,
    /// Time at which the first request was sent.
    pub(super) asked: Moment,
}

/// Result of a write. An error contains the outcome for all values.
pub(super) type Written = Result<(), (Fault, Outcome)>;

/// Reads all values of the set.
pub(super) async fn read(turn: &mut LineTurn<'_>, set: &OutputSet) -> Result<Found, Fault> {
    match set.is_in_nodes(&turn.shared.profile) {
        true => nodes::read(turn, set).await,
        false => cells::read(turn, set).await,
    }
}

/// Writes all values of the set. After an error, [`Outcome`] applies to the set as a whole.
pub(super) async fn write(
    turn: &mut LineTurn<'_>,
    set: &OutputSet,
    values: &[Encoded],
    own: OwnWords,
    leave: Leave,
) -> Written {
    match set.is_in_nodes(&turn.shared.profile) {
        true => nodes::write(turn, set, values, own, leave).await,
        false => cells::write_all(turn, set, values, own, leave).await,
    }
}

/// Writes heartbeat and control word alone.
pub(super) async fn write_own(turn: &mut LineTurn<'_>, set: &OutputSet, own: OwnWords) -> Written {
    match set.is_in_nodes(&turn.shared.profile) {
        true => nodes::write_own(turn, set, own).await,
        false => cells::write_own(turn, set, own).await,
    }
}
