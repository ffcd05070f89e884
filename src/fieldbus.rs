//! The fieldbus: one owner per physical line, reads and writes in one order, every fault by its blame.
//!
//! - [`wire`] — the border behind which a transport lives; [`connection`] — any of them, open, and what opens one.
//! - [`modbus`] — frames of Modbus TCP; [`rtu`] — frames of a serial line, on a port ([`serial`]) or through TCP; what both
//!   carry is made and compared in one place, by the Modbus library.
//! - [`trace`] — the wire log: every frame, while somebody listens.
//! - [`canopen`] — what a CANopen master needs, frames in and frames out.
//! - [`can`] — one CAN interface: frames, error frames, its state, what is asked and written there.
//! - `opcua` — an OPC UA server, by feature; [`namespaces`] — those that a profile names by index; [`opcua_fault`] — why none can be spoken to;
//!   [`opcua_check`] — what is wrong with such a line in a profile.
//! - [`sysfs`] — the sensors of this computer, each read on a thread of its own.
//! - [`tcp`] — sockets that keep nothing back, and Modbus TCP on them; [`tls`] — the same inside TLS.
//! - [`mod@error`] — what can be wrong, by who is to blame; [`mod@explain`] — what to do about it, in the words that people read.
//! - [`owed`] — what a unit may still say after a miss on a serial line, and what it may be asked meanwhile.
//! - `pipeline` — whether two questions go out together, and when that is given up.
//! - [`mod@line`] — the one way to ask a device: one request at a time, timeout, last moment, breaker, reconnection.

pub mod backoff;
pub mod can;
pub mod canopen;
pub mod connection;
pub mod departure;
mod eager;
pub mod error;
pub mod explain;
pub mod line;
pub mod modbus;
pub mod namespaces;
#[cfg(feature = "opcua")]
pub mod opcua;
pub mod opcua_check;
pub mod opcua_fault;
pub mod owed;
mod pdu;
mod pipeline;
pub mod port;
mod request;
pub mod rtu;
pub mod serial;
pub mod sysfs;
pub mod tcp;
pub mod tls;
pub mod trace;
pub mod wire;

use isotherm_profile::{Bus, Transport};

/// What opens the connections of a Modbus line, to an OPC UA server or to the sensors of this computer, by what the line is made of. `None` for a CAN
/// interface: it is listened to before anything is asked there, and who listens opens it.
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
