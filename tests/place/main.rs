//! `isotherm place` as a person starts it, on a column of our own.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "../calculix/mod.rs"]
mod calculix;
mod column;
mod found;
#[path = "../process/mod.rs"]
mod process;
mod wrong;
