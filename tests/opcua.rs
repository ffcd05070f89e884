//! The line to an OPC UA server, and a whole gateway on it, beside a server that is not ours: asyncua, in Python, over real sockets.
//!
//! `tests/run opcua` installs it, and builds the feature. Without asyncua these tests fail and say so.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "device/gateway.rs"]
mod gateway;
#[path = "opcua/grinder.rs"]
mod grinder;
#[path = "opcua/held.rs"]
mod held;
#[path = "opcua/hostile.rs"]
mod hostile;
#[path = "opcua/nodes.rs"]
mod nodes;
mod process;
#[path = "opcua/rig.rs"]
mod rig;
#[path = "opcua/secured.rs"]
mod secured;
#[path = "opcua/sessions.rs"]
mod sessions;
#[path = "opcua/sets.rs"]
mod sets;
#[path = "opcua/shared.rs"]
mod shared;
#[path = "opcua/storm.rs"]
mod storm;
#[path = "opcua/subscribed.rs"]
mod subscribed;
#[path = "opcua/values.rs"]
mod values;
#[path = "opcua/words.rs"]
mod words;
