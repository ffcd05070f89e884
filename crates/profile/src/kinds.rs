//! Kinds of buses, one folder or file each: their keys and addresses, their checks, their read requests, and their
//! preview.
//!
//! A new kind is a file next to the others and a line in [`KINDS`].

use crate::tables::bus::transport::Transport;
use crate::tables::bus_kind::BusKind;

pub(crate) mod can;
pub(crate) mod modbus;
pub(crate) mod opcua;
mod sysfs;

/// All kinds of buses. A line whose type has an error counts as one of the first kind.
pub(crate) static KINDS: [&dyn BusKind; 4] = [&modbus::Modbus, &can::Can, &opcua::OpcUaServer, &sysfs::Sysfs];

/// Kind of a line with this transport.
pub(crate) fn of(transport: Transport) -> &'static dyn BusKind {
    let known = KINDS.into_iter().find(|kind| kind.line_type(transport.bus_type()).is_some());
    known.unwrap_or(KINDS[0])
}
