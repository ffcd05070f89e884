//! Record of the requests that reached the devices, with which tests check a client.

use isotherm_core::codec::Address;
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

/// One request as it reached a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeenRequest {
    /// Time of the request.
    pub at: Moment,
    /// Device that received it. Devices of one unit are recorded as the first of them.
    pub device: DeviceId,
    /// Function code; 0 for a write on a CAN line.
    pub function: u8,
    /// First register or bit, object, or field of a frame.
    pub address: Address,
    /// Number of cells that the request addresses.
    pub count: u16,
    /// Content of the cells before the request.
    pub before: Vec<u16>,
    /// Content of the cells after the request. The client may have received another answer.
    pub after: Vec<u16>,
    /// Content that a write requested; empty for a read.
    pub wanted: Vec<u16>,
}

impl SeenRequest {
    /// Returns whether the request is a write.
    pub fn is_write(&self) -> bool {
        !self.wanted.is_empty()
    }
}
