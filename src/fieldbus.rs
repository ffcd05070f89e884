//! Communication with devices. One task owns each physical line, reads and writes have one order, and faults are
//! classified by their cause.
//!
//! - [`wire`] — interface of a transport; [`connection`] — an open connection of any transport, and how it is opened.
//! - [`modbus`] — frames of Modbus TCP; [`rtu`] — frames of a serial line, on a port ([`serial`]) or through TCP. The
//!   private module `pdu` builds and checks the content of both.
//! - [`trace`] — log of the frames on a line, while there is a listener.
//! - [`canopen`] — CANopen master, without input or output: frames in and frames out.
//! - [`can`] — one CAN interface: frames, error frames, its state, requests and writes.
//! - `opcua` — OPC UA server, by feature; [`namespaces`] — namespaces that a profile names by index.
//! - [`opcua_fault`] — faults of a connection to an OPC UA server; [`opcua_check`] — check of such a line in a profile.
//! - [`sysfs`] — sensors of this computer, each read on a separate thread.
//! - [`tcp`] — sockets without send delay, and Modbus TCP on them; [`tls`] — Modbus TCP inside TLS.
//! - [`mod@error`] — faults, by their cause; [`mod@explain`] — their explanations and advice for users.
//! - [`pending_replies`] — late replies that a serial unit may still send after a timeout, and requests that are safe
//!   meanwhile.
//! - [`reply_signature`] — what distinguishes the answers to two requests; `order_check` — whether the answers of a
//!   unit behind a Modbus gateway belong to their requests.
//! - `pipeline` — whether two requests are sent together, and when the line stops doing so.
//! - [`mod@line`] — sends requests to devices: one at a time, with timeout, send deadline, back-off and reconnection.

pub mod backoff;
pub mod can;
pub mod canopen;
pub mod connection;
pub mod error;
pub mod explain;
pub mod line;
mod local_tcp;
pub mod modbus;
pub mod namespaces;
#[cfg(feature = "opcua")]
pub mod opcua;
pub mod opcua_check;
pub mod opcua_fault;
mod order_check;
mod pdu;
pub mod pending_replies;
mod pipeline;
pub mod port;
pub mod reply_signature;
mod request;
pub mod rtu;
pub mod send_guard;
pub mod serial;
pub mod sysfs;
pub mod tcp;
pub mod tls;
pub mod trace;
pub mod wire;

use isotherm_profile::{Bus, Transport};

/// Returns the object that opens connections of this bus: Modbus, OPC UA, or the sensors of this computer. Returns
/// `None` for a CAN interface, because the task that receives its frames opens it.
pub fn dial(bus: &Bus) -> Option<Box<dyn connection::Dial>> {
    if bus.transport == Transport::OpcUa {
        #[cfg(feature = "opcua")]
        return Some(Box::new(opcua::OpcUaDial::new(bus)?));
        #[cfg(not(feature = "opcua"))]
        return Some(Box::new(connection::NotBuiltIn));
    }
    if bus.transport == Transport::Sysfs {
        return Some(Box::new(sysfs::SysfsDial::new(bus)));
    }
    Some(Box::new(connection::ModbusDial::new(bus)?))
}
