//! Tests of the command line and of the manual.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails")]

#[path = "../support/mod.rs"]
mod support;

mod advice;
mod cli;
mod demo;
mod discovery;
mod manual;
mod messages;
mod preview;
mod unread_output;
