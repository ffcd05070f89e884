//! Tests of the OPC UA server of a whole gateway, with asyncua and node-opcua as clients: what is browsed, read and
//! subscribed to, who may log in, and clients that do harm.
//!
//! `tests/run opcua` installs asyncua and node-opcua. Without them these tests fail with a message.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::support::device;
use crate::support::process;

mod many;
mod node;
mod read;
mod rig;
mod secured;
