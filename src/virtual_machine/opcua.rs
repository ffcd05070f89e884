//! Virtual OPC UA servers, with the server of the library async-opcua.
//!
//! ```text
//! client ─► server (bytes and their faults) ─► library (loopback) ─► manager ─► line ─► hardware
//! ```
//!
//! The hardware of the virtual machine has a value for each node that the profile names. Plant, faults and
//! counters of requests apply to this value as to any other value.
//!
//! - `nodes` — nodes that a profile names, with their types, arrays and namespaces. `content` — conversion of
//!   node contents to values of the library.
//! - `line` — calls to the hardware, and faults that end or delay an answer.
//! - `manager` — address space of the library. `library` — its configuration and start.
//! - `server` — connections of clients. A restart ends them, and the library starts again without its sessions.

mod content;
mod library;
mod line;
mod manager;
mod nodes;
mod server;
#[cfg(test)]
mod tests;

pub(super) use library::Endpoint;
pub(super) use line::NodeLine;
pub(super) use nodes::{ServerNodes, with_types};
pub(super) use server::NodeServer;
