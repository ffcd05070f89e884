//! Carries out what [`output::step`](isotherm_core::output::step) asks for, and tells it what came of that.
//!
//! One [`Single`] for each output that is written by itself, one [`Set`] for outputs that land together, and one
//! [`Position`] for each corrected position, owned by the task of their line. The first two have a
//! [`register::Register`] for each output: what has happened elsewhere since the last turn (armed, switched off, restarted,
//! stood still, decided) goes in as facts; then each action is one exchange, whose end is the next fact, until there is
//! nothing to do. A reference position is an output without a step or a limit.

use std::time::Duration;

use isotherm_core::codec::Encoded;

mod applied;
mod cells;
mod interlock;
mod order;
mod position;
mod register;
mod report;
mod requests;
mod sequence;
mod set;
mod single;
mod strobe;
mod units;

pub(super) use position::Position;
pub(super) use set::Set;
pub(super) use single::Single;
pub(super) use units::Units;

/// An output is done after fewer exchanges than this; whatever happens, its line goes on then.
const MOST_EXCHANGES: usize = 12;
/// A value whose answer never came is recognised for so many times as long as it may take to arrive.
const REMEMBERED: u32 = 10;
/// What failed is tried again after this long at the earliest.
const RETRY: Duration = Duration::from_secs(1);
/// So many writes in a row that were not answered by a device whose reads are, are told.
const DEAF: u64 = 3;
/// A disk that has not answered for this long is a fault.
const DISK_PATIENCE: Duration = Duration::from_secs(5);

/// The registers of one value.
type Words = Encoded;

/// Why the register is not what was decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    /// The device did not answer.
    Link,
    /// It did not answer a write, and nothing was written since.
    Unanswered,
    /// It answered, and did not do what it was told.
    Untaken,
    /// What must be on disk is not.
    Disk,
}

/// What a device was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Asked {
    Read,
    Write,
}
