//! Tests of the line to an OPC UA server, and of a whole gateway on it. The server is asyncua, in Python, over real
//! sockets; in `virtual_server` it is that of the virtual machine.
//!
//! `tests/run opcua` installs asyncua, and builds the feature. Without asyncua its tests fail with a message.

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
mod virtual_server;
mod words;
