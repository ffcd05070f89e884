//! Writes that something on the way delays, denies or loses. The gateway runs over real sockets with a control of the
//! test, which records every value of its register.
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
