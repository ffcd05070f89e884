//! Writes that something on the way holds, denies or loses: the gateway over real sockets against a control of our own,
//! which keeps every value that really came to stand in its register.
#![allow(clippy::unwrap_used, reason = "a test may stop where it stands")]

use crate::support::device;
use crate::support::process;

mod applied;
mod arriving;
mod buffered;
mod control;
mod corrected;
mod denied;
mod rig;
mod shared;
mod stopped;
mod two;
mod windup;
