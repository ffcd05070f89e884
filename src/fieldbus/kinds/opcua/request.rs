//! Requests to an OPC UA server.

use std::fmt;

use crate::fieldbus::listed::Listed;
use isotherm_core::codec::Node;
use isotherm_profile::plan::Subscription;

/// One request to an OPC UA server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeRequest<'a> {
    /// Read of the values of these nodes.
    Read(&'a [Node]),
    /// Request for the latest values of a subscription, which the server sends by itself.
    Latest(&'a Subscription),
    /// Read of the namespaces of the server.
    Namespaces,
    /// Write of the values of several nodes, in one call.
    Write {
        /// Nodes to write.
        nodes: &'a [Node],
        /// New values in the order of the nodes, each with its most significant register first.
        values: &'a [u16],
    },
}

impl NodeRequest<'_> {
    /// Returns whether the request is complete: it has nodes, and a value for each node that it writes.
    pub fn fits(self) -> bool {
        match self {
            NodeRequest::Read(nodes) => !nodes.is_empty(),
            NodeRequest::Latest(sent) => !sent.nodes.is_empty(),
            NodeRequest::Namespaces => true,
            NodeRequest::Write { nodes, values } => {
                let registers: usize =
                    nodes.iter().map(|node| usize::from(node.taken_as().registers())).sum();
                !nodes.is_empty() && registers == values.len()
            }
        }
    }
}

/// Formats the request: `read ns=2;i=5`, `write ns=2;i=5 = 17395 4660`.
impl fmt::Display for NodeRequest<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            NodeRequest::Read(nodes) => write!(f, "read{}", Listed(nodes)),
            NodeRequest::Latest(sent) => write!(f, "latest{}", Listed(&sent.nodes)),
            NodeRequest::Namespaces => f.write_str("namespaces"),
            NodeRequest::Write { nodes, values } => write!(f, "write{} ={}", Listed(nodes), Listed(values)),
        }
    }
}
