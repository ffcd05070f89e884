//! Nodes of virtual OPC UA servers: their values, reads and writes.

use super::Hardware;
use crate::virtual_machine::fault::{NodeFault, ReplyFault};
use crate::virtual_machine::journal::SeenRequest;
use isotherm_core::codec::{Address, Node, Scalar};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Status;
use isotherm_profile::DeviceId;

/// Content of a node: a value, or a status without a value.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::virtual_machine) enum NodeValue {
    Number(Scalar),
    Text(String),
    /// The node has this status and no value.
    Status(Status),
}

/// Result for each node of a call, and the fault of the answer.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::virtual_machine) struct NodeReply<T> {
    pub(in crate::virtual_machine) results: Vec<T>,
    pub(in crate::virtual_machine) fault: Option<ReplyFault>,
}

impl Hardware {
    /// Returns how often the unit of a device was switched on or restarted.
    pub(in crate::virtual_machine) fn boots(&mut self, device: DeviceId, now: Moment) -> u16 {
        self.advance_to(now);
        self.units[self.unit_of[device.0]].boots
    }

    /// Returns whether the unit of a device sends nothing at all now.
    pub(in crate::virtual_machine) fn is_silent(&mut self, device: DeviceId, now: Moment) -> bool {
        self.advance_to(now);
        self.faults.is_silent(self.units[self.unit_of[device.0]].device, now)
    }

    /// Executes one call of a client that reads OPC UA nodes. Returns the content of each node, and the fault
    /// of the answer.
    pub(in crate::virtual_machine) fn read_nodes(
        &mut self,
        device: DeviceId,
        nodes: &[Node],
        now: Moment,
    ) -> NodeReply<NodeValue> {
        let place = self.unit_of[device.0];
        self.units[place].requests += 1;
        let values = self.sample_nodes(device, nodes, now);
        let fault = self.faults.reply(self.units[place].device, false, now);
        let results = match fault {
            Some(ReplyFault::Status(status)) => vec![NodeValue::Status(status); nodes.len()],
            _ => values,
        };
        NodeReply { results, fault }
    }

    /// Returns the content of each node, for a subscription. Such a sample does not count as a call.
    pub(in crate::virtual_machine) fn sample_nodes(
        &mut self,
        device: DeviceId,
        nodes: &[Node],
        now: Moment,
    ) -> Vec<NodeValue> {
        let place = self.unit_of[device.0];
        let device = self.units[place].device;
        self.advance_to(now);
        self.measure(place, now, None);
        let broken: Vec<_> = self.faults.nodes(device, now).collect();
        let value = |node: &Node| {
            let address = Address::Node(node.clone());
            let fault = broken.iter().find(|(id, _)| self.profile.signal(*id).address == address);
            let words = self.units[place].bank.read(&address, node.taken_as().registers());
            match (fault, words) {
                (Some((_, NodeFault::Status(status))), _) => NodeValue::Status(*status),
                (_, None) => NodeValue::Status(Status::NO_SUCH_NODE),
                (Some((_, NodeFault::Text)), Some(words)) => {
                    NodeValue::Text(node.scalar(words).value().to_string())
                }
                (None, Some(words)) => NodeValue::Number(node.scalar(words)),
            }
        };
        let values = nodes.iter().map(value).collect();
        let profile = &self.profile;
        let is_shown = |id| nodes.iter().any(|node| profile.signal(id).address.node() == Some(node));
        self.faults.count_shown(device, now, is_shown);
        values
    }

    /// Executes one call of a client that writes OPC UA nodes. A value of `None` means that the client has
    /// written a value that is not a number. Returns the status of each write.
    pub(in crate::virtual_machine) fn write_nodes(
        &mut self,
        device: DeviceId,
        values: &[(Node, Option<Scalar>)],
        now: Moment,
    ) -> NodeReply<Status> {
        let place = self.unit_of[device.0];
        let device = self.units[place].device;
        self.units[place].requests += 1;
        self.advance_to(now);
        let fault = self.faults.reply(device, true, now);
        let write = |(node, value): &(Node, Option<Scalar>)| self.write_node(place, node, *value, fault, now);
        let results = values.iter().map(write).collect();
        self.check_controls(place, now);
        NodeReply { results, fault }
    }

    fn write_node(
        &mut self,
        place: usize,
        node: &Node,
        value: Option<Scalar>,
        fault: Option<ReplyFault>,
        at: Moment,
    ) -> Status {
        let Some(value) = value.filter(|value| value.data_type == node.taken_as()) else {
            return Status::TYPE_MISMATCH;
        };
        match fault {
            Some(ReplyFault::Status(status)) => return status,
            Some(ReplyFault::Silent | ReplyFault::HalfOpen | ReplyFault::IgnoredWrite) => {
                return Status::GOOD;
            }
            _ => {}
        }
        let (address, count) = (Address::Node(node.clone()), node.taken_as().registers());
        let wanted = node.taken_as().encode(value.bits).registers().to_vec();
        let unit = &mut self.units[place];
        let before = unit.bank.read(&address, count).unwrap_or_default().to_vec();
        if unit.bank.write(&address, &wanted).is_none() {
            return Status::NO_SUCH_NODE;
        }
        let device = unit.device;
        self.note_corrections(place, &address, count);
        if let Some(journal) = &mut self.journal {
            let after = wanted.clone();
            journal.push(SeenRequest { at, device, function: 0, address, count, before, after, wanted });
        }
        Status::GOOD
    }
}
