//! Sensors of this computer, in a tree of files that looks like the kernel's, and in a named pipe that hangs as a driver does.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod device;
#[path = "sysfs/held.rs"]
mod held;
#[path = "sysfs/line.rs"]
mod line;
#[path = "sysfs/names.rs"]
mod names;
mod process;
#[path = "sysfs/tree.rs"]
mod tree;
#[path = "sysfs/words.rs"]
mod words;
