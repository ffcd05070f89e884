//! Commands to a running gateway, from operators and programs. Each command is an event, and is executed within its
//! deadline or never. A command that waits is displayed as waiting. Events are known after a restart.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod backup;
mod bench;
mod deadline;
use crate::support::device;
mod kept;
mod left_off;
mod page;
use crate::support::process;
mod reported;
mod sign;
mod unmodelled;
mod waiting;
