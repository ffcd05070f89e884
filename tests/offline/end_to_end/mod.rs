//! Typical use of `identify`, `select` and `report` with logs, and the results.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod acted;
mod elsewhere;
mod plant;
use crate::support::process;
mod reported;
mod wrong;
