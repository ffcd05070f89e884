//! Tests of lines and devices: the bytes on the wire, and which replies are accepted.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails")]

#[path = "../support/mod.rs"]
mod support;

mod fairness;
mod interop;
mod line;
mod modbus_ascii;
#[cfg(feature = "opcua")]
mod opcua;
mod pipeline;
mod serial;
mod serial_ascii;
mod sysfs;
mod tls;
mod wrong_replies;
