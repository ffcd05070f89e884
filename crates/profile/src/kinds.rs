//! Kinds of buses, one folder or file each: their keys and addresses, their checks, their read requests, and their
//! preview.
//!
//! A new kind is a file next to the others and a line in [`KINDS`].

use crate::tables::bus::LineType;
use crate::tables::bus::transport::Transport;
use crate::tables::bus_kind::BusKind;

pub(crate) mod can;
pub(crate) mod modbus;
pub(crate) mod opcua;
mod serial_ascii;
mod sysfs;

/// All kinds of buses. A line whose type has an error counts as one of the first kind.
pub(crate) static KINDS: [&BusKind; 5] =
    [&modbus::KIND, &can::KIND, &opcua::KIND, &sysfs::KIND, &serial_ascii::KIND];

/// Returns the kind of a line with this transport, and its type.
pub(crate) fn of(transport: Transport) -> (&'static BusKind, &'static LineType) {
    let typed = |kind: &'static BusKind| Some((kind, kind.line_type(transport.bus_type())?));
    KINDS.into_iter().find_map(typed).unwrap_or((KINDS[0], &KINDS[0].types[0]))
}
