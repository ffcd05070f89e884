//! Communication with devices. One task owns each physical line and sends its reads and writes in one sequence. Faults
//! are classified by their cause.
//!
//! - [`kinds`] — types of bus, one folder each: their requests, connections, frames and faults.
//! - [`wire`] — interface of a transport; [`connection`] — an open connection of any transport, and its opening.
//! - [`trace`] — log of the frames on a line, written while a listener subscribes to it.
//! - [`serial`] — serial ports; [`tcp`] — sockets without send delay; [`tls`] — Modbus TCP inside TLS. [`port`] is the
//!   interface of all of them.
//! - [`mod@error`] — faults, by their cause; [`mod@explain`] — their explanations and advice for users. The advice
//!   depends on the description of the failed request ([`seen`]).
//! - [`mod@line`] — sends requests to devices: one at a time, with timeout, send deadline, back-off and reconnection.

pub mod backoff;
pub mod connection;
pub mod error;
pub mod explain;
pub mod kinds;
pub mod line;
mod listed;
mod local_tcp;
pub mod port;
mod request;
pub mod seen;
pub mod send_guard;
pub mod serial;
pub mod tcp;
pub mod tls;
pub mod trace;
pub mod wire;

use isotherm_profile::Bus;

/// Returns the object that opens connections of this bus: Modbus, OPC UA, lines of text, or the sensors of this
/// computer. Returns `None` for a CAN interface: the task that receives its CAN frames opens the interface.
pub fn dial(bus: &Bus) -> Option<Box<dyn connection::Dial>> {
    (kinds::of(bus.transport).dial)(bus)
}
