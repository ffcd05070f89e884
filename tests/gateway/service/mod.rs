//! A gateway as a service: its notifications to the service manager, and its unit file.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod checked;
mod claimed;
use crate::support::device;
mod handed_over;
mod journal;
mod manager;
use crate::support::process;
mod released;
mod replaced;
mod rig;
mod slow_disk;
mod told;
mod unit;
