//! Requests to devices on a CAN line.

use std::fmt;

use crate::fieldbus::listed::Listed;
use isotherm_core::codec::{BitField, CanId, Object};

/// One request to one device on a CAN line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CanRequest<'a> {
    /// Read of an object of a node by SDO.
    Read {
        /// Object to read.
        object: Object,
    },
    /// Write of an object of a node by SDO.
    Write {
        /// Object to write.
        object: Object,
        /// New value, the most significant register first.
        values: &'a [u16],
    },
    /// Value to send in a CAN frame, together with the other values of this frame.
    Send {
        /// Identifier of the frame.
        id: CanId,
        /// Bits of the value in the frame.
        bits: BitField,
        /// New value, the most significant register first.
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
