//! Sensors of this computer, in a tree of files that looks like the kernel's, and in a named pipe that hangs as a driver does.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::support::device;
mod held;
mod line;
mod names;
use crate::support::process;
use crate::support::tree;
mod words;
