//! The two pure steps: no file, no socket, no clock.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails")]

#[path = "../support/mod.rs"]
mod support;

mod continuity;
mod healthy_days;
mod output;
mod places;
mod step_allocates_nothing;
