//! Tests that need a special kernel, namespaces or a control: `tests/vcan/run`, `tests/netns/run`,
//! `tests/linuxcnc/run`.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails")]

#[path = "../support/mod.rs"]
mod support;

mod can;
mod linuxcnc;
mod netns;
