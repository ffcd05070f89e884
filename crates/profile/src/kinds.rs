//! Kinds of buses, for example Modbus and CAN. Each kind has a folder or file with its keys and addresses, checks, read
//! requests, and preview. A bus is also called a line.
//!
//! A new kind needs a file in the directory of this module, and an entry in [`KINDS`].

use crate::tables::bus::LineType;
use crate::tables::bus::transport::Transport;
use crate::tables::bus_kind::BusKind;

pub(crate) mod can;
pub(crate) mod modbus;
pub(crate) mod opcua;
mod serial_ascii;
mod sysfs;

/// All kinds of buses. A bus with an invalid type is treated as a bus of the first kind.
pub(crate) static KINDS: [&BusKind; 5] =
    [&modbus::KIND, &can::KIND, &opcua::KIND, &sysfs::KIND, &serial_ascii::KIND];

/// Returns the kind and the type of the buses that use this transport.
pub(crate) fn of(transport: Transport) -> (&'static BusKind, &'static LineType) {
    let typed = |kind: &'static BusKind| Some((kind, kind.line_type(transport.bus_type())?));
    KINDS.into_iter().find_map(typed).unwrap_or((KINDS[0], &KINDS[0].types[0]))
}
