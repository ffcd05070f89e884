//! Record of the requests that reached the virtual devices. Tests use it to check a client.

use isotherm_core::codec::Address;
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

/// One request as it reached a virtual device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeenRequest {
    /// Time of the request.
    pub at: Moment,
    /// Device that received the request. If several devices share a unit, this is the first of them.
    pub device: DeviceId,
    /// Modbus function code; 0 for a write on a CAN line or to a node.
    pub function: u8,
    /// First register or bit that the request addresses. On a CAN line, this is the object or the field of a frame. For
    /// an OPC UA server, this is the node.
    pub address: Address,
    /// Number of cells (registers or bits) that the request addresses.
    pub count: u16,
    /// Content of these registers or bits before the request.
    pub before: Vec<u16>,
    /// Content of these registers or bits after the request. A fault can make the client receive another answer.
    pub after: Vec<u16>,
    /// Values that a write requested for these registers or bits; empty for a read.
    pub wanted: Vec<u16>,
}

impl SeenRequest {
    /// Returns whether the request is a write.
    pub fn is_write(&self) -> bool {
        !self.wanted.is_empty()
    }
}
