//! Requests to devices on a CAN line. SDO is the CANopen service that reads or writes one object of a node.

use std::fmt;

use crate::fieldbus::listed::Listed;
use isotherm_core::codec::{BitField, CanId, Object};

/// One request to one device on a CAN line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CanRequest<'a> {
    /// Read of an object of a node by SDO.
    Read {
        /// Object to read: index, sub-index and type.
        object: Object,
    },
    /// Write of an object of a node by SDO.
    Write {
        /// Object to write: index, sub-index and type.
        object: Object,
        /// New value as 16-bit registers, the most significant register first.
        values: &'a [u16],
    },
    /// Value to send in a CAN frame, together with the other values of this frame.
    Send {
        /// CAN identifier of the frame.
        id: CanId,
        /// Bits of the frame that contain the value.
        bits: BitField,
        /// New value as 16-bit registers, the most significant register first.
        values: &'a [u16],
    },
}

/// Formats the request: `read 6150:01`, `write 6150:01 = 1`.
impl fmt::Display for CanRequest<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            CanRequest::Read { object } => write!(f, "read {object}"),
            CanRequest::Write { object, values } => write!(f, "write {object} ={}", Listed(values)),
            CanRequest::Send { id, bits, values } => write!(f, "send {id}, {bits} ={}", Listed(values)),
        }
    }
}
