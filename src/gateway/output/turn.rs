//! Turn of an output (work of the line task on the output), and the limits of one turn.

use crate::fieldbus::line::DeviceLine;
use crate::gateway::shared::line_handle::LineHandle;
use isotherm_core::quantity::Moment;

/// Upper limit of the exchanges in one turn of an output. At this limit, the line continues with its next turn.
pub(super) const MOST_EXCHANGES: usize = 12;

/// Context of a turn of an output: its line, and the state that all lines share.
pub(in crate::gateway) struct LineTurn<'a> {
    pub(in crate::gateway) line: &'a mut DeviceLine,
    pub(in crate::gateway) shared: &'a LineHandle,
    pub(in crate::gateway) now: Moment,
}
