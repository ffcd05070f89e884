//! Sensors of this computer: a directory tree like that of the kernel, and a named pipe that hangs like a driver.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::support::device;
mod held;
mod line;
mod names;
use crate::support::process;
use crate::support::tree;
mod words;
