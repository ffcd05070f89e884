//! Reads and writes of all values of an output set (outputs that are written together). The values are in Modbus
//! registers or in OPC UA nodes.

use super::turn::LineTurn;
use super::{set_modbus, set_opcua};
use crate::fieldbus::error::{Fault, Outcome};
use crate::fieldbus::send_guard::SendDeadline;
use isotherm_core::codec::Encoded;
use isotherm_core::output::OwnWords;
use isotherm_core::quantity::Moment;
use isotherm_profile::OutputSet;

/// Values of an output set from one read.
#[derive(Clone, Debug)]
pub(super) struct SetReadings {
    /// Value of each output.
    pub(super) values: Vec<Encoded>,
    pub(super) sequence: Option<u16>,
    pub(super) heartbeat: Option<u16>,
    /// Time at which the first request of the read was sent.
    pub(super) asked: Moment,
}

/// Result of a write. In an error, the outcome applies to all values of the set.
pub(super) type Written = Result<(), (Fault, Outcome)>;

/// Reads all values of the output set.
pub(super) async fn read(turn: &mut LineTurn<'_>, set: &OutputSet) -> Result<SetReadings, Fault> {
    match set.is_in_nodes(&turn.shared.profile) {
        true => set_opcua::read(turn, set).await,
        false => set_modbus::read(turn, set).await,
    }
}

/// Writes all values of the output set. In an error, the [`Outcome`] applies to the whole set.
pub(super) async fn write(
    turn: &mut LineTurn<'_>,
    set: &OutputSet,
    values: &[Encoded],
    own: OwnWords,
    leave: SendDeadline,
) -> Written {
    match set.is_in_nodes(&turn.shared.profile) {
        true => set_opcua::write(turn, set, values, own, leave).await,
        false => set_modbus::write_all(turn, set, values, own, leave).await,
    }
}

/// Writes only the heartbeat and the control word of the output set, without its values.
pub(super) async fn write_own(turn: &mut LineTurn<'_>, set: &OutputSet, own: OwnWords) -> Written {
    match set.is_in_nodes(&turn.shared.profile) {
        true => set_opcua::write_own(turn, set, own).await,
        false => set_modbus::write_own(turn, set, own).await,
    }
}
