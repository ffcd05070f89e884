//! A gateway as a service: what it tells the service manager, and what its unit says.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "../device/mod.rs"]
mod device;
mod handed_over;
mod journal;
mod manager;
#[path = "../process/mod.rs"]
mod process;
mod replaced;
mod rig;
mod told;
mod unit;
