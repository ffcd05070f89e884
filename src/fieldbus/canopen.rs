//! CANopen as a master needs it, and no more: frames in, frames and events out. No socket, no clock, no task.
//!
//! - [`sdo`] — one object of a node's dictionary read or written, with every reason why not in words ([`abort`]).
//! - [`node`] — what a node says of itself: boot-up, state, heartbeat; and the command that starts it.
//! - [`emergency`] — what a node complains of, without the words: those are the device's, see the profile.
//! - [`master`] — all nodes of an interface: started after every boot-up, missed when they fall silent, SYNC.
//!
//! The source is CiA 301 version 4.2.

use std::fmt;

use isotherm_core::codec::{CanId, Frame};

pub mod abort;
pub mod emergency;
pub mod master;
pub mod node;
pub mod sdo;
#[cfg(test)]
mod tests;

/// A node's number, 1 to 127.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(u8);

impl NodeId {
    /// `None` where there is no such node.
    pub const fn new(number: u8) -> Option<NodeId> {
        if number >= 1 && number <= 127 { Some(NodeId(number)) } else { None }
    }

    /// 1 to 127.
    pub const fn get(self) -> u8 {
        self.0
    }

    /// The identifier of one of its services in the predefined connection set: 0x080 EMCY, 0x580 SDO answers, …
    pub fn identifier(self, service: u16) -> CanId {
        CanId::of_11_bits(service + u16::from(self.0))
    }

    /// The node that sent a frame of this service; `None` where it is another service's.
    pub fn sender(frame: &Frame, service: u16) -> Option<NodeId> {
        let raw = frame.id().raw();
        let number = u8::try_from(raw.checked_sub(u32::from(service))?).ok()?;
        NodeId::new(number).filter(|_| !frame.id().is_extended())
    }
}

impl fmt::Display for NodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "node {}", self.0)
    }
}
