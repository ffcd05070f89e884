//! What a node says of itself, and the command that starts it.

use std::fmt;

use super::NodeId;
use isotherm_core::codec::{CanId, Frame};

/// The identifiers of boot-up and heartbeat: this and the node's number.
pub const HEARTBEAT: u16 = 0x700;

/// The identifier of NMT commands.
const NMT: u16 = 0x000;

/// The state that a heartbeat tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NodeState {
    /// It has just come up, and goes on to pre-operational by itself.
    BootedUp,
    /// Silent but for its heartbeat: neither PDO nor SDO.
    Stopped,
    /// Everything.
    Operational,
    /// SDO, but no PDO.
    PreOperational,
    /// None that CiA 301 knows.
    Unknown(u8),
}

impl NodeState {
    /// The node and its state; `None` where the frame is no heartbeat. The top bit, which alternates where nodes are
    /// guarded, is no part of the state.
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
            NodeState::Unknown(byte) => write!(f, "in a state that does not exist ({byte:02X}h)"),
        }
    }
}

/// The NMT command by which a node becomes operational.
pub fn start(node: NodeId) -> Frame {
    Frame::short(CanId::of_11_bits(NMT), [0x01, node.get()])
}
