//! Boot-up and heartbeat of a node, and the command that starts it. A PDO (process data object) carries values without
//! a request. An SDO (service data object) reads or writes one object on request.

use std::fmt;

use super::NodeId;
use isotherm_core::codec::{CanId, Frame};

/// First CAN identifier of boot-up and heartbeat messages, to which the number of the node is added.
pub const HEARTBEAT: u16 = 0x700;

/// CAN identifier of NMT commands (network management).
const NMT: u16 = 0x000;

/// State of a node in its heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NodeState {
    /// The node has just booted, and continues to pre-operational by itself.
    BootedUp,
    /// The node sends only its heartbeat, and supports no PDO and no SDO.
    Stopped,
    /// The node supports all services.
    Operational,
    /// The node supports SDO, but no PDO.
    PreOperational,
    /// State that CiA 301 does not define.
    Unknown(u8),
}

impl NodeState {
    /// Returns the node and its state; `None` if the frame is not a heartbeat. The top bit of the state byte is
    /// ignored: in the older node-guarding protocol this bit alternates.
    pub fn of(frame: &Frame) -> Option<(NodeId, NodeState)> {
        let node = NodeId::sender(frame, HEARTBEAT)?;
        let state = match frame.data().first()? & 0x7f {
            0x00 => NodeState::BootedUp,
            0x04 => NodeState::Stopped,
            0x05 => NodeState::Operational,
            0x7f => NodeState::PreOperational,
            other => NodeState::Unknown(other),
        };
        Some((node, state))
    }
}

impl fmt::Display for NodeState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NodeState::BootedUp => write!(f, "booted up"),
            NodeState::Stopped => write!(f, "stopped"),
            NodeState::Operational => write!(f, "operational"),
            NodeState::PreOperational => write!(f, "pre-operational"),
            NodeState::Unknown(byte) => write!(f, "in an undefined state ({byte:02X}h)"),
        }
    }
}

/// Returns the NMT command that makes a node operational.
pub fn start(node: NodeId) -> Frame {
    Frame::short(CanId::of_11_bits(NMT), [0x01, node.get()])
}
