//! isotherm with a real CNC. LinuxCNC, without a screen, moves a simulated mill with its own planner. The component in
//! `profiles/linuxcnc` accepts the offsets. `tests/linuxcnc/run` provides the namespaces.
//!
//! Each servo period of a scenario is recorded: the offset, the requested offset, and the positions of the program and
//! the joint. In any scenario, neither the offset nor a joint without other motion moves by more than one step per
//! period.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::support::device;
use crate::support::process;

mod bench;
mod broken;
mod chapter;
mod mill;
mod modbus;
mod samples;
mod soak;
mod stopped;
mod walks;
