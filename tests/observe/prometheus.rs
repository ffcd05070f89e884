//! Tests with Prometheus itself. It accepts the configuration of the manual, scrapes a gateway over TLS with the scrape
//! token, and answers every query of the dashboard. Its `promtool` checks names, rules and alarms.
//!
//! The tests need Debian's package prometheus, which `tests/run tools` unpacks. Without it these tests fail with a
//! hint.

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
