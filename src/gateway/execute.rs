//! Executes the actions of the controllers of outputs, and gives them the results. Decides nothing about a register.
//!
//! One [`Single`] for each output that is written by itself, one [`Set`] for outputs that land together, and one [`Position`] for each
//! corrected position, owned by the task of their line. The first two have a [`register::Register`] for each output and a
//! [`Controller`](isotherm_core::output::Controller) or [`SetController`](isotherm_core::output::SetController): the turn begins with the
//! demand of the axis, then each action is one exchange, whose result is the next input, until there is nothing to do. A reference
//! position is an output without a step or a limit.

use std::time::Duration;

use super::line_handle::LineHandle;
use crate::fieldbus::line::DeviceLine;
use isotherm_core::quantity::Moment;

mod cells;
mod demand;
mod failures;
mod nodes;
mod position;
mod register;
mod report;
mod set;
mod single;
mod strobe;
mod together;

pub(super) use position::Position;
pub(super) use set::Set;
pub(super) use single::Single;

/// An output is done after fewer exchanges than this; whatever happens, its line goes on then.
const MOST_EXCHANGES: usize = 12;
/// A value whose answer never came is recognised for so many times as long as it may take to arrive.
const REMEMBERED: u32 = 10;
/// A disk that has not answered for this long is a fault.
const DISK_PATIENCE: Duration = Duration::from_secs(5);

/// The turn of an output: its line, and what the lines share.
pub(super) struct LineTurn<'a> {
    pub(super) line: &'a mut DeviceLine,
    pub(super) shared: &'a LineHandle,
    pub(super) now: Moment,
}
