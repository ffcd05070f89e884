//! CANopen master with the services that a gateway needs. It receives frames as arguments and returns frames and
//! events; it has no socket, no clock and no task.
//!
//! - [`sdo`] — reads or writes one object of a node's dictionary; [`abort`] — reasons for which a node
//!   refuses this.
//! - [`node`] — boot-up, state and heartbeat of a node, and the command that starts it.
//! - [`emergency`] — emergency messages of a node. The profile has the texts of error codes, because they depend on the
//!   device.
//! - [`master`] — supervises all nodes of an interface: starts them after every boot-up, checks their heartbeats, sends
//!   SYNC.
//!
//! All services follow CiA 301 version 4.2.

use std::fmt;

use isotherm_core::codec::{CanId, Frame};

pub mod abort;
pub mod emergency;
pub mod master;
pub mod node;
pub mod sdo;
#[cfg(test)]
mod tests;

/// Number of a CANopen node, 1 to 127.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(u8);

impl NodeId {
    /// Returns the node with this number; `None` if the number is invalid.
    pub const fn new(number: u8) -> Option<NodeId> {
        if number >= 1 && number <= 127 { Some(NodeId(number)) } else { None }
    }

    /// Returns the node number, 1 to 127.
    pub const fn get(self) -> u8 {
        self.0
    }

    /// Returns the CAN identifier of a service of this node: `service`, for example `0x080` (EMCY) or `0x580` (SDO
    /// answers), plus the node number. CiA 301 calls this the predefined connection set.
    pub fn identifier(self, service: u16) -> CanId {
        CanId::of_11_bits(service + u16::from(self.0))
    }

    /// Returns the node that sent a frame, if the identifier belongs to this service; `None` if the identifier belongs
    /// to another service.
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
