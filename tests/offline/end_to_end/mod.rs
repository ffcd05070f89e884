//! What a newcomer does with logs, and what `identify`, `select` and `report` answer.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod acted;
mod elsewhere;
mod plant;
use crate::support::process;
mod reported;
mod wrong;
