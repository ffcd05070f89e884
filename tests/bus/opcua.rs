//! The line to an OPC UA server, and a whole gateway on it, beside a server that is not ours: asyncua, in Python, over real sockets.
//!
//! `tests/run opcua` installs it, and builds the feature. Without asyncua these tests fail and say so.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::support::device::gateway;
mod grinder;
mod held;
mod hostile;
mod namespaces;
mod nodes;
use crate::support::process;
mod rig;
mod secured;
mod sessions;
mod sets;
mod shared;
mod storm;
mod subscribed;
mod values;
mod words;
