//! Calls from OPC UA clients to the virtual hardware, and faults that end or delay an answer.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use ::opcua::types::DataValue;
use tokio::sync::watch;

use super::content::{data_value, without_value};
use super::nodes::{Access, ServerNode, ServerNodes};
use crate::clock::Clock;
use crate::virtual_machine::fault::ReplyFault;
use crate::virtual_machine::hardware::Hardware;
use isotherm_core::codec::{Node, Scalar};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Status;
use isotherm_profile::DeviceId;

/// Time after which an answer that a fault holds back is sent. No client waits so long.
const HELD_BACK: Duration = Duration::from_secs(60);

/// Fault of a connection, which replaces its next answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cut {
    None,
    /// The connection is closed.
    Close,
    /// The server answers no further request of the connection.
    Mute,
    /// The client gets random bytes.
    Garbage,
}

/// Nodes of a server, and the virtual hardware that contains their values.
pub(in crate::virtual_machine) struct NodeLine {
    pub(super) server: ServerNodes,
    hardware: Arc<Mutex<Hardware>>,
    clock: Clock,
    /// First device of the profile at this server. Calls to the hardware are made for this device.
    device: DeviceId,
    cut: watch::Sender<Cut>,
}

impl NodeLine {
    pub(in crate::virtual_machine) fn new(
        server: ServerNodes,
        (hardware, clock): (Arc<Mutex<Hardware>>, Clock),
        device: DeviceId,
    ) -> NodeLine {
        NodeLine { server, hardware, clock, device, cut: watch::Sender::new(Cut::None) }
    }

    fn with<T>(&self, act: impl FnOnce(&mut Hardware, Moment) -> T) -> T {
        // The lock is also used after a panic in another task, as for every line.
        let mut hardware = self.hardware.lock().unwrap_or_else(PoisonError::into_inner);
        let now = self.clock.now();
        act(&mut hardware, now)
    }

    /// Returns how often the device was switched on or restarted.
    pub(super) fn boots(&self) -> u16 {
        self.with(|hardware, now| hardware.boots(self.device, now))
    }

    /// Returns whether the device sends nothing at all now.
    pub(super) fn is_silent(&self) -> bool {
        self.with(|hardware, now| hardware.is_silent(self.device, now))
    }

    /// Returns a receiver of the faults of connections from now on.
    pub(super) fn cuts(&self) -> watch::Receiver<Cut> {
        self.cut.subscribe()
    }

    fn node(&self, place: Option<usize>) -> Option<&ServerNode> {
        self.server.nodes.get(place?)
    }

    /// Reads nodes in one call, and returns their values and the fault of the answer. `places` are the indices of the
    /// nodes in the list of the server; `None` for a node that the server does not have.
    pub(super) fn read(&self, places: &[Option<usize>]) -> (Vec<DataValue>, Option<ReplyFault>) {
        let nodes: Vec<Option<&ServerNode>> = places.iter().map(|place| self.node(*place)).collect();
        let parts: Vec<Node> = nodes.iter().flatten().flat_map(|node| node.parts.iter().cloned()).collect();
        let reply = self.with(|hardware, now| hardware.read_nodes(self.device, &parts, now));
        let mut rest = reply.results.as_slice();
        let mut values = Vec::with_capacity(nodes.len());
        for node in nodes {
            let Some(node) = node else {
                values.push(without_value(Status::NO_SUCH_NODE));
                continue;
            };
            let (own, after) = rest.split_at(node.parts.len().min(rest.len()));
            values.push(data_value(node, own));
            rest = after;
        }
        (values, reply.fault)
    }

    /// Samples a node for a subscription; `None` if the server does not have it.
    pub(super) fn sample(&self, place: usize) -> Option<DataValue> {
        let node = self.server.nodes.get(place)?;
        let parts = self.with(|hardware, now| hardware.sample_nodes(self.device, &node.parts, now));
        Some(data_value(node, &parts))
    }

    /// Writes nodes in one call. Returns the status of each write, and the fault of the answer.
    pub(super) fn write(
        &self,
        values: &[(Option<usize>, Option<Scalar>)],
    ) -> (Vec<Status>, Option<ReplyFault>) {
        let refusal = |place: Option<usize>| match self.node(place).map(|node| node.access) {
            None => Some(Status::NO_SUCH_NODE),
            Some(Access::Read) => Some(Status::NOT_WRITABLE),
            Some(Access::Write) => None,
        };
        let mut accepted: Vec<(Node, Option<Scalar>)> = Vec::new();
        for (place, value) in values.iter().filter(|(place, _)| refusal(*place).is_none()) {
            accepted.extend(self.node(*place).and_then(|node| Some((node.parts.first()?.clone(), *value))));
        }
        let reply = self.with(|hardware, now| hardware.write_nodes(self.device, &accepted, now));
        let mut results = reply.results.into_iter();
        let status = |(place, _): &(Option<usize>, Option<Scalar>)| {
            refusal(*place).or_else(|| results.next()).unwrap_or(Status::NO_SUCH_NODE)
        };
        (values.iter().map(status).collect(), reply.fault)
    }

    /// Executes the fault of an answer: delays the answer, or sets the fault that replaces it on the
    /// connections.
    pub(super) async fn obey(&self, fault: Option<ReplyFault>) {
        match fault {
            Some(ReplyFault::Late(delay)) => tokio::time::sleep(delay).await,
            Some(ReplyFault::Silent) => tokio::time::sleep(HELD_BACK).await,
            Some(ReplyFault::Close) => self.cut.send_modify(|cut| *cut = Cut::Close),
            Some(ReplyFault::HalfOpen) => self.cut.send_modify(|cut| *cut = Cut::Mute),
            Some(ReplyFault::Garbage) => self.cut.send_modify(|cut| *cut = Cut::Garbage),
            _ => {}
        }
    }
}
