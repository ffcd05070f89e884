//! Prometheus itself: it takes the configuration of the manual, scrapes a gateway over TLS with the token for that, and has an answer to
//! every query of the dashboard; its `promtool` looks at names, rules and alarms.
//!
//! Needs Debian's package prometheus, unpacked by `tests/run tools`. Without it these tests fail and say so.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::support::certificates;
mod dashboard;
use crate::support::fake;
mod fleet;
mod names;
use crate::support::process;
mod rules;
mod scraped;
mod server;
