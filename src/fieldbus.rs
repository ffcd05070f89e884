//! Communication with devices. One task owns each physical line and sends its reads and writes in one sequence. Faults
//! are classified by their cause.
//!
//! - [`wire`] — interface of a transport; [`connection`] — an open connection of any transport, and its opening.
//! - [`modbus`] — frames of Modbus TCP; [`rtu`] — frames of a serial line, on a port ([`serial`]) or through TCP. The
//!   private module `pdu` builds and checks the content of both kinds of frames.
//! - [`trace`] — log of the frames on a line, written while a listener subscribes to it.
//! - [`canopen`] — CANopen master without its own input and output: it receives frames as arguments, and returns the
//!   frames to send.
//! - [`can`] — one CAN interface: its frames, its error frames, its state, and the requests and writes on it.
//! - `opcua` — OPC UA client, only with the feature `opcua`; [`namespaces`] — OPC UA namespaces that a profile names by
//!   index.
//! - [`opcua_fault`] — faults of a connection to an OPC UA server; [`opcua_check`] — check of the settings of such a
//!   connection in a profile.
//! - [`sysfs`] — sensors of this computer, each read on a separate thread.
//! - [`tcp`] — sockets without send delay, and Modbus TCP on them; [`tls`] — Modbus TCP inside TLS.
//! - [`mod@error`] — faults, by their cause; [`mod@explain`] — their explanations and advice for users, which depend on
//!   what was [`seen`] of a request.
//! - [`pending_replies`] — late replies that a serial unit may still send after a timeout, and the requests that may be
//!   sent before they arrive.
//! - [`reply_signature`] — features that distinguish the answers to two requests; `order_check` — test whether the
//!   answers of a unit behind a Modbus gateway belong to their requests.
//! - `pipeline` — decision whether the line sends two requests together, and when it stops doing so.
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

/// Returns the object that opens connections of this bus: Modbus, OPC UA, or the sensors of this computer. Returns
/// `None` for a CAN interface: the task that receives its frames opens the interface.
pub fn dial(bus: &Bus) -> Option<Box<dyn connection::Dial>> {
    (kinds::of(bus.transport).dial)(bus)
}
