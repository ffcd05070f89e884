//! What really came over the wire, request by request: what a test holds a client to.

use isotherm_core::codec::Address;
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

/// One request as it reached a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seen {
    /// When.
    pub at: Moment,
    /// To whom; devices of one unit go by the first one's name.
    pub device: DeviceId,
    /// The function code; 0 for what was written on a CAN line.
    pub function: u8,
    /// Where: the first register or bit, the object, the place in a frame.
    pub address: Address,
    /// How many.
    pub count: u16,
    /// What stood there when it came.
    pub before: Vec<u16>,
    /// What stood there when it had been dealt with. The client may have been told something else.
    pub after: Vec<u16>,
    /// What a write wanted to stand there; empty for a read.
    pub wanted: Vec<u16>,
}

impl Seen {
    /// It wanted to change something.
    pub fn is_write(&self) -> bool {
        !self.wanted.is_empty()
    }
}
