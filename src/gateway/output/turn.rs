//! Turn of an output (work of the line task on the output), and the limits of one turn.

use std::time::Duration;

use crate::fieldbus::line::DeviceLine;
use crate::gateway::shared::line_handle::LineHandle;
use isotherm_core::quantity::Moment;

/// Upper limit of the exchanges in one turn of an output. At this limit, the line continues with its next turn.
pub(super) const MOST_EXCHANGES: usize = 12;
/// Time for which an unanswered write is still recognised in the register, as a multiple of `late`.
pub(super) const REMEMBERED: u32 = 10;
/// Longest time for saving the state of an output to disk. A longer time is reported as a fault of the disk.
pub(super) const DISK_PATIENCE: Duration = Duration::from_secs(5);

/// Context of a turn of an output: its line, and the state that all lines share.
pub(in crate::gateway) struct LineTurn<'a> {
    pub(in crate::gateway) line: &'a mut DeviceLine,
    pub(in crate::gateway) shared: &'a LineHandle,
    pub(in crate::gateway) now: Moment,
}
