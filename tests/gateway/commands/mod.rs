//! Commands to a running gateway, as people and programs give them: each is an event, is carried out within its deadline or
//! never, and one that waits is seen to wait. What happened is known after a restart.
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
