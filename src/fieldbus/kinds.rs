//! Types of bus. Each has a folder with its requests, its connection, its faults and its description, a [`BusKind`].
//!
//! - [`modbus`] — Modbus TCP, also inside TLS; Modbus RTU and ASCII on a serial port or through TCP.
//! - [`can`] — a CAN interface of this computer, with CANopen.
//! - [`opcua`] — an OPC UA server. The connection requires the feature `opcua`.
//! - [`sysfs`] — sensors of this computer, each read on a separate thread.
//! - [`serial_ascii`] — devices that send lines of text, on a serial port or through TCP.
//!
//! A new type of bus needs a folder, an entry in [`of`] and in [`KINDS`], and its requests in `request.rs`.

pub mod can;
pub mod kind;
pub mod modbus;
pub mod opcua;
pub mod serial_ascii;
pub mod sysfs;
mod target;

use isotherm_profile::Transport;
use kind::BusKind;

pub use target::baud;

/// All types of bus, in the order in which messages list examples of their addresses.
pub const KINDS: [&BusKind; 10] = [
    &modbus::TCP,
    &modbus::SERIAL,
    &modbus::RTU_OVER_TCP,
    &modbus::ASCII,
    &modbus::ASCII_OVER_TCP,
    &opcua::KIND,
    &sysfs::KIND,
    &can::KIND,
    &serial_ascii::SERIAL,
    &serial_ascii::OVER_TCP,
];

/// Returns the type of bus that has this transport.
pub const fn of(transport: Transport) -> &'static BusKind {
    match transport {
        Transport::Tcp => &modbus::TCP,
        Transport::RtuOverTcp => &modbus::RTU_OVER_TCP,
        Transport::Serial(_) => &modbus::SERIAL,
        Transport::ModbusAscii { .. } => &modbus::ASCII,
        Transport::ModbusAsciiOverTcp => &modbus::ASCII_OVER_TCP,
        Transport::Can => &can::KIND,
        Transport::OpcUa => &opcua::KIND,
        Transport::Sysfs => &sysfs::KIND,
        Transport::Ascii { .. } => &serial_ascii::SERIAL,
        Transport::AsciiOverTcp => &serial_ascii::OVER_TCP,
    }
}
