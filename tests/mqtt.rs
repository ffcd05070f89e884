//! A whole gateway beside a real broker, mosquitto, and its own reader: what is published arrives, in the clear and inside TLS; the
//! broker dies, hangs and comes back; what arrives moves nothing.
//!
//! They need mosquitto, its clients and pysparkplug, which `tests/run mqtt` installs. Without them these tests fail and say so.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod certificates;
mod device;
mod process;

#[path = "mqtt/away.rs"]
mod away;
#[path = "mqtt/broker.rs"]
mod broker;
#[path = "mqtt/commands.rs"]
mod commands;
#[path = "mqtt/machine.rs"]
mod machine;
#[path = "mqtt/published.rs"]
mod published;
#[path = "mqtt/secured.rs"]
mod secured;
#[path = "mqtt/sparkplug.rs"]
mod sparkplug;
