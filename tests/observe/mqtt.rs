//! Tests of a complete gateway with a real broker, mosquitto, and its client. Published messages arrive over plain TCP
//! and TLS. The broker dies, hangs and comes back. Received messages move no axis.
//!
//! These tests need mosquitto, its clients and pysparkplug, which `tests/run mqtt` installs. Without them the tests
//! fail with a hint.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::support::certificates;
use crate::support::device;
use crate::support::process;

mod away;
mod broker;
mod commands;
mod machine;
mod published;
mod refused;
mod scripted;
mod secured;
mod sparkplug;
