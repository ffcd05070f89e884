//! Tests of whole gateways with devices, operators, disks and processes that misbehave.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails")]

#[path = "../support/mod.rs"]
mod support;

mod bad_files;
mod commands;
mod disks;
mod event_floods;
mod faketime;
mod faults;
mod killed;
mod late_writes;
mod process_stops;
mod service;
mod sixty_axes;
mod suspended;
