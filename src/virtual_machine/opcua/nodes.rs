//! Nodes that a profile names, with their types, arrays and namespaces.

use std::collections::HashMap;

use isotherm_core::codec::{Address, DataType, Identifier, Namespace, Node, NodeId};
use isotherm_profile::{Bit, DeviceId, Profile};

/// Application URI of the server. It is also the URI of namespace 1, as on every OPC UA server.
pub(super) const APPLICATION: &str = "urn:isotherm:virtual";
/// Largest namespace index that a profile may use at a virtual server.
const MOST_NAMESPACES: u16 = 200;
/// Largest number of elements of an array at a virtual server.
const MOST_ELEMENTS: usize = 10_000;

/// Access rights of clients to a node: only read, or also write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Access {
    Read,
    Write,
}

/// Node of a virtual OPC UA server: its identifier, the access rights of clients, and the values that the profile uses.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ServerNode {
    pub(super) id: NodeId,
    pub(super) access: Access,
    /// The node itself, or the elements of its array that the profile names.
    pub(super) parts: Vec<Node>,
}

/// Nodes and namespaces of a virtual OPC UA server.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::virtual_machine) struct ServerNodes {
    pub(super) nodes: Vec<ServerNode>,
    /// URIs of the namespaces from index 1 on.
    pub(super) namespaces: Vec<String>,
}

impl ServerNode {
    /// Returns the type of the node, or of the elements of its array.
    pub(super) fn data_type(&self) -> DataType {
        self.parts.first().map_or(DataType::F64, Node::taken_as)
    }

    /// Returns the name of the node for display: its text identifier, otherwise the complete node identifier.
    pub(super) fn name(&self) -> String {
        match &self.id.identifier {
            Identifier::Text(text) => text.clone(),
            _ => self.id.to_string(),
        }
    }

    /// Returns the length of the node's array in each dimension, large enough for all elements that the profile names;
    /// `None` for a single value.
    pub(super) fn dimensions(&self) -> Option<Vec<u32>> {
        let rank = self.parts.first()?.element.as_ref()?.indices().len();
        let mut lengths = vec![1; rank];
        for element in self.parts.iter().filter_map(|part| part.element.as_ref()) {
            for (length, index) in lengths.iter_mut().zip(element.indices()) {
                *length = index.saturating_add(1).max(*length);
            }
        }
        Some(lengths)
    }

    /// Returns the number of values of the node; `None` if there are too many to simulate.
    pub(super) fn size(&self) -> Option<usize> {
        let lengths = self.dimensions().unwrap_or_default();
        let size =
            lengths.iter().try_fold(1_usize, |size, length| size.checked_mul(usize::try_from(*length).ok()?));
        size.filter(|size| *size <= MOST_ELEMENTS)
    }

    /// Adds another mention of the node in the profile. Ignores a mention that is already known, or that does
    /// not fit the first mention. For example, the whole node does not fit an array element, and an element
    /// does not fit an element with another number of dimensions.
    fn add(&mut self, part: Node) {
        let rank = |part: &Node| part.element.as_ref().map(|element| element.indices().len());
        let fits = self.parts.first().is_some_and(|first| rank(first) == rank(&part));
        let is_known = self.parts.iter().any(|known| known.element == part.element);
        if fits && !is_known {
            self.parts.push(part);
        }
    }
}

impl ServerNodes {
    /// Returns the nodes of the server at the address of this bus. Nodes of OPC UA itself are not among them, because
    /// every server has them.
    ///
    /// # Errors
    /// A node cannot be simulated; the error is a sentence.
    pub(in crate::virtual_machine) fn of(profile: &Profile, bus: usize) -> Result<ServerNodes, String> {
        let address = &profile.buses[bus].address;
        let (mut nodes, mut places) = (Vec::<ServerNode>::new(), HashMap::<NodeId, usize>::new());
        for (device, node, access) in named(profile) {
            let is_here = profile.bus(profile.device(device).bus).address == *address;
            if !is_here || node.id.namespace == Namespace::Index(0) {
                continue;
            }
            match places.get(&node.id) {
                Some(place) => nodes[*place].add(node),
                None => {
                    places.insert(node.id.clone(), nodes.len());
                    nodes.push(ServerNode { id: node.id.clone(), access, parts: vec![node] });
                }
            }
        }
        if let Some(node) = nodes.iter().find(|node| node.size().is_none()) {
            return Err(format!("the array of node {} has more than {MOST_ELEMENTS} elements", node.id));
        }
        let namespaces = namespaces(&nodes)?;
        Ok(ServerNodes { nodes, namespaces })
    }

    /// Returns the index of a namespace; `None` if the server does not have this namespace.
    pub(super) fn index(&self, namespace: &Namespace) -> Option<u16> {
        match namespace {
            Namespace::Index(index) => Some(*index),
            Namespace::Uri(uri) => {
                let place = self.namespaces.iter().position(|known| known == uri)?;
                u16::try_from(place + 1).ok()
            }
        }
    }
}

/// Returns the URIs of the namespaces from index 1 on. First there is one URI for each index, up to the
/// highest that the profile names. The URIs that the profile names follow. The error is a sentence about an
/// index that is too high.
fn namespaces(nodes: &[ServerNode]) -> Result<Vec<String>, String> {
    let mut highest = 1;
    for node in nodes {
        if let Namespace::Index(index) = node.id.namespace {
            highest = index.max(highest);
        }
    }
    if highest > MOST_NAMESPACES {
        return Err(format!("ns={highest} is more than {MOST_NAMESPACES} namespaces"));
    }
    let numbered = (2..=highest).map(|index| format!("{APPLICATION}:{index}"));
    let mut namespaces: Vec<String> = std::iter::once(APPLICATION.to_owned()).chain(numbered).collect();
    for node in nodes {
        if let Namespace::Uri(uri) = &node.id.namespace
            && !namespaces.contains(uri)
        {
            namespaces.push(uri.clone());
        }
    }
    Ok(namespaces)
}

/// Returns the profile with a type for each node. A node without a type gets the type that another key of the profile
/// states for the same node. If no key states one, an acknowledge node is a Boolean, and a signal node a Double.
pub(in crate::virtual_machine) fn with_types(mut profile: Profile) -> Profile {
    let lines: Vec<String> =
        profile.devices.iter().map(|device| profile.bus(device.bus).address.clone()).collect();
    let mut types: HashMap<(&str, NodeId), DataType> = HashMap::new();
    for (device, node, _) in named(&profile) {
        if let Some(data_type) = node.data_type {
            types.entry((lines[device.0].as_str(), node.id)).or_insert(data_type);
        }
    }
    let stated = |device: DeviceId, id: &NodeId| types.get(&(lines[device.0].as_str(), id.clone())).copied();
    for set in &mut profile.sets {
        if let Some(handshake) = &mut set.handshake
            && let Bit::Node(node) = &mut handshake.acknowledge
        {
            node.data_type = node.data_type.or(stated(set.device, &node.id)).or(Some(DataType::Bool));
        }
    }
    for signal in &mut profile.signals {
        if let Address::Node(node) = &mut signal.address {
            let data_type = node.data_type.or(stated(signal.device, &node.id)).unwrap_or(DataType::F64);
            node.data_type = Some(data_type);
            signal.encoding.data_type = data_type;
        }
    }
    profile
}

/// Returns the node of each key that names one in the profile. Nodes of outputs, output sets and the heartbeat come
/// first.
fn named(profile: &Profile) -> Vec<(DeviceId, Node, Access)> {
    let outputs = profile.outputs.iter();
    let mut found: Vec<(DeviceId, Address, Access)> =
        outputs.map(|output| (output.device, output.address.clone(), Access::Write)).collect();
    for set in &profile.sets {
        let words = set.own_nodes();
        found.extend(words.map(|(_, node)| (set.device, Address::Node(node.clone()), Access::Write)));
        if let Some(handshake) = &set.handshake {
            found.push((set.device, handshake.strobe.address(), Access::Write));
            found.push((set.device, handshake.acknowledge.address(), Access::Read));
        }
    }
    let heartbeat = profile.heartbeat.iter();
    found.extend(heartbeat.map(|beat| (beat.device, beat.address.clone(), Access::Write)));
    for (index, device) in profile.devices.iter().enumerate() {
        let checked = device.verify.iter();
        found.extend(checked.map(|check| (DeviceId(index), check.address.clone(), Access::Read)));
    }
    let signals = profile.signals.iter();
    found.extend(signals.map(|signal| (signal.device, signal.address.clone(), Access::Read)));
    let node = |(device, address, access): (DeviceId, Address, Access)| match address {
        Address::Node(node) => Some((device, node, access)),
        _ => None,
    };
    found.into_iter().filter_map(node).collect()
}
