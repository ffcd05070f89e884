//! isotherm beside a real CNC: LinuxCNC, without a screen, moves a simulated mill with its own planner, and the component
//! of `profiles/linuxcnc` takes the offsets. `tests/linuxcnc/run` gives it namespaces of its own.
//!
//! Each servo period of a scenario is recorded: what the offset is, what it is asked to be, where the program and where
//! the joint is. Whatever happens, neither the offset nor a joint that nobody else moves goes further than a step in one of
//! them.

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
