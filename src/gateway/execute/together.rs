//! All of a set on its way to the device and back: in registers, or in nodes.

use super::LineTurn;
use super::{cells, nodes};
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{Fault, Outcome};
use isotherm_core::codec::Encoded;
use isotherm_core::output::OwnWords;
use isotherm_core::quantity::Moment;
use isotherm_profile::OutputSet;

/// What stands there.
#[derive(Clone, Debug)]
pub(super) struct Found {
    /// One for each member.
    pub(super) values: Vec<Encoded>,
    pub(super) sequence: Option<u16>,
    pub(super) heartbeat: Option<u16>,
    /// When the first question for it left.
    pub(super) asked: Moment,
}

/// Reads all of it.
pub(super) async fn read(turn: &mut LineTurn<'_>, set: &OutputSet) -> Result<Found, Fault> {
    match set.is_in_nodes(&turn.shared.profile) {
        true => nodes::read(turn, set).await,
        false => cells::read(turn, set).await,
    }
}

/// Writes all of it. What failed, and what that says of all of it.
pub(super) async fn write(
    turn: &mut LineTurn<'_>,
    set: &OutputSet,
    values: &[Encoded],
    own: OwnWords,
    leave: Leave,
) -> Result<(), (Fault, Outcome)> {
    match set.is_in_nodes(&turn.shared.profile) {
        true => nodes::write(turn, set, values, own, leave).await,
        false => cells::write_all(turn, set, values, own, leave).await,
    }
}

/// Writes heartbeat and control word alone.
pub(super) async fn write_own(
    turn: &mut LineTurn<'_>,
    set: &OutputSet,
    own: OwnWords,
) -> Result<(), (Fault, Outcome)> {
    match set.is_in_nodes(&turn.shared.profile) {
        true => nodes::write_own(turn, set, own).await,
        false => cells::write_own(turn, set, own).await,
    }
}
