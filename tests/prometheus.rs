//! Prometheus itself: it takes the configuration of the manual, scrapes a gateway over TLS with the token for that, and has an answer to
//! every query of the dashboard; its `promtool` looks at names, rules and alarms.
//!
//! Needs Debian's package prometheus, unpacked by `tests/run tools`. Without it these tests fail and say so.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod certificates;
#[path = "prometheus/dashboard.rs"]
mod dashboard;
#[path = "http/fake.rs"]
mod fake;
#[path = "prometheus/fleet.rs"]
mod fleet;
#[path = "prometheus/names.rs"]
mod names;
mod process;
#[path = "prometheus/rules.rs"]
mod rules;
#[path = "prometheus/scraped.rs"]
mod scraped;
#[path = "prometheus/server.rs"]
mod server;
