//! The fieldbus: one owner per physical line, reads and writes in one order, every fault by its blame.
//!
//! - [`plan`] — pure: the signals of a device become the fewest read requests.
//! - [`wire`] — the border behind which the Modbus library lives; [`modbus`] is the library's side of it.
//! - [`rtu`] — frames of a serial line, on a port ([`serial`]) or through TCP.
//! - [`trace`] — the wire log: every frame, while somebody listens.
//! - [`canopen`] — what a CANopen master needs, frames in and frames out.
//! - [`can`] — one CAN interface: frames, error frames, its state, what is asked and written there.
//! - [`tls`] — Modbus TCP inside TLS.
//! - [`mod@line`] — one request at a time, timeout, breaker per device, reconnection.

pub mod backoff;
pub mod can;
pub mod canopen;
mod eager;
pub mod error;
pub mod line;
pub mod modbus;
pub mod plan;
pub mod rtu;
pub mod serial;
pub mod tls;
pub mod trace;
pub mod wire;

use crate::profile::{Bus, Transport};

/// What opens the connections of a bus, by what it is made of.
pub fn dial(bus: &Bus) -> Box<dyn wire::Dial> {
    match bus.transport {
        Transport::Tcp => match &bus.tls {
            Some(tls) => Box::new(tls::TlsDial::new(&bus.address, tls)),
            None => Box::new(modbus::TcpDial::new(&bus.address)),
        },
        Transport::RtuOverTcp => Box::new(rtu::RtuOverTcpDial::new(&bus.address)),
        Transport::Serial(serial) => Box::new(serial::SerialDial::new(&bus.address, serial)),
        Transport::Can => Box::new(NoLine),
    }
}

/// A line of a kind that cannot be opened.
struct NoLine;

impl wire::Dial for NoLine {
    fn dial(&mut self) -> wire::Boxed<'_, Result<wire::Connection, error::Fault>> {
        Box::pin(std::future::ready(Err(error::Fault::Link(error::LinkFault::Unsuited))))
    }
}
