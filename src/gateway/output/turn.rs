//! Context of a turn of an output (work of the line task on the output), and the maximum number of exchanges in a
//! turn.

use crate::fieldbus::line::DeviceLine;
use crate::gateway::shared::line_handle::LineHandle;
use isotherm_core::quantity::Moment;

/// Maximum number of exchanges in one turn of an output. Then the line task continues with its next action.
pub(super) const MOST_EXCHANGES: usize = 12;

/// Context of a turn of an output: its bus line, and the state that all lines share.
pub(in crate::gateway) struct LineTurn<'a> {
    pub(in crate::gateway) line: &'a mut DeviceLine,
    pub(in crate::gateway) shared: &'a LineHandle,
    pub(in crate::gateway) now: Moment,
}
