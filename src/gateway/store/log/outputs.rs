//! Log of the outputs: CSV with one row for each input of an output controller. [`OutputReplay`] calculates the same
//! actions from the log.
//!
//! ```text
//! time, output, fact, value, moment, action, action_value, action_until, detail
//! ```
//!
//! - `time`: when the controller received the input; RFC 3339 in UTC with every nanosecond, like all moments here.
//! - `output`: name of the output in the profile.
//! - `fact`: the input ([`Input`](isotherm_core::output::Input)), with `value` and `moment` if it has them. Values
//!   are counts of the register. An empty moment means that there is no time limit.
//! - `action`: the next action ([`Action`](isotherm_core::output::Action)): nothing, until `action_until`; read; keep;
//!   write `action_value`; or repeat, which writes the present register value again. The first byte of a write may be
//!   sent until `action_until`.
//!
//! | fact | value | moment |
//! |---|---|---|
//! | `demand`; `detail` (JSON) contains who armed the axis, the interlock if it is not met, the decision (target, time, mode), restarts and pauses | the offset, if there is a decision | a change may be sent until then |
//! | `look`, `goes-along`, `no-answer`, `refused`, `not-sent`, `kept`, `not-kept`, `restarted`, `interlocked`, `released`, `armed-by-person`, `armed-by-policy`, `off`, `paused`, `lapsed` | | |
//! | `on-disk`, `turn-ends`; `too-late`, `unreachable`, `rejected`, `backs-off`: why a write was not sent; `set-taken`, `set-open`, `set-failed`: whether the control took the set | | |
//! | `decided`; `detail` (JSON) contains the target of the offset, if it is known | the offset | a change may be sent until then |
//! | `read` | the register value | time of the request |
//! | `done`, `unknown` | | time at which the write was sent |
//! | `went-along`, `went-along-unknown` | the value that was sent along | time at which the value was sent |
//! | `applied` | the value that the control applies, in thousandths of a count; empty if it is no number | time of the request |
//! | `applied-no-answer` | | time of the request |
//!
//! `begin` is not an input: the controller continues from the settings and the state in `detail` (JSON). `begin` is
//! the first row of each output in a file and in a run. It is also the first row after rows that the disk did not
//! store. Therefore each file can be replayed by itself. An input that changed nothing and caused no action is left
//! out.
//!
//! Outputs of an output set (outputs that are written together) have rows under the name of the set. `set-begin` has
//! settings and state of the set in `detail`. `set` has the input of its controller
//! ([`SetInput`](isotherm_core::output::SetInput)) and the action in `detail` (JSON). `action` is the name of the
//! action: nothing, keep, read, write, write-own, acknowledge, raise, drop.
//!
//! A corrected position has the rows `position-begin` and `position`, with demand, action and result of a turn in
//! `detail`. A turn is one call of a controller by the line task. The Cz in `detail` and the decision to write are
//! replayed; the position itself is not in the log. A heartbeat in a separate register has the rows `heartbeat-begin`
//! and `heartbeat`. A turn has no row if it only repeats the previous one, with a newer position or the next count.
//! `value` of the next row contains the number of such turns, after one minute at the latest.
//!
//! Positions, heartbeats and control words are written repeatedly, after a success and after a failure. They
//! also have the rows `fault` (the fault in `detail`, once until a write is answered), `writes` and
//! `failures`. A row `writes` contains the number of answered writes since `moment` in `value`, and a row
//! `failures` the number of failed writes. The counting takes at least one minute, except at the end of a
//! run. If a file begins because the computer's clock was set, its first row is `clock`, with the old and the
//! new time.
//!
//! Earlier versions wrote two more kinds of rows, which a replay ignores. A row `cz` of a corrected position
//! contains a changed Cz in `value`, µm. A row `sealed` has no output, and contains the save numbers of state
//! and register ledger.

mod cells;
mod controllers;
mod reader;
mod recorder;
mod replay;
#[cfg(test)]
mod tests;

pub use cells::{ENDING, HEADER, ResumeState};
pub use controllers::{
    ControllerSnapshot, ControllerState, HeartbeatSnapshot, HeartbeatTurn, PositionSnapshot, SetSnapshot,
    SetTurn, Turn,
};
pub use reader::{Entry, OutputLogReader, OutputRow};
pub use recorder::OutputRecorder;
pub use replay::{OutputReplay, Replayed};
