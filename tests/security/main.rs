//! What somebody tries who means no good, and what stands afterwards.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod another_user;
mod layers;
#[path = "../process/mod.rs"]
mod process;
mod unseen;
