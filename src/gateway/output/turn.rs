//! Turn of an output on its line, and the limits of one turn.

use std::time::Duration;

use crate::fieldbus::line::DeviceLine;
use crate::gateway::shared::line_handle::LineHandle;
use isotherm_core::quantity::Moment;

/// Upper limit of the exchanges in one turn of an output. At this limit, the line continues with its next turn.
pub(super) const MOST_EXCHANGES: usize = 12;
/// Time for which an unanswered write is still recognised in the register, as a multiple of `late`.
pub(super) const REMEMBERED: u32 = 10;
/// Timeout of the disk. A longer wait is a fault.
pub(super) const DISK_PATIENCE: Duration = Duration::from_secs(5);

/// Context of a turn of an output: its line, and the state that all lines share.
pub(in crate::gateway) struct LineTurn<'a> {
    pub(in crate::gateway) line: &'a mut DeviceLine,
    pub(in crate::gateway) shared: &'a LineHandle,
    pub(in crate::gateway) now: Moment,
}
