//! A whole gateway beside a real broker, mosquitto, and its own reader: what is published arrives, in the clear and inside TLS; the
//! broker dies, hangs and comes back; what arrives moves nothing.
//!
//! They need mosquitto, its clients and pysparkplug, which `tests/run mqtt` installs. Without them these tests fail and say so.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::support::certificates;
use crate::support::device;
use crate::support::process;

mod away;
mod broker;
mod commands;
mod machine;
mod published;
mod secured;
mod sparkplug;
