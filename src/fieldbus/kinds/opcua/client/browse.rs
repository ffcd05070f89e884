//! Browsing of a server's nodes for users: child nodes and attributes. This module only reads.
//!
//! The browser requests the child nodes of one node at a time, and accepts them in several answers. It therefore never
//! exceeds a limit of the server on nodes, references or continuation points.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::time::Duration;

use ::opcua::client::UARequest;
use ::opcua::client::services::{Browse, BrowseNext, Read};
use ::opcua::types::{
    AttributeId, BrowseDescription, BrowseDirection, BrowseResult, ByteString, DataValue, Error, NodeId,
    ReadValueId, ReferenceDescription, ReferenceTypeId, TimestampsToReturn, Variant, VariantScalarTypeId,
};
use isotherm_core::codec::{self, DataType};
use isotherm_core::reading::Status;
use isotherm_profile::{Bus, one_line, safe_file};
use serde::{Serialize, Serializer};

use super::call_size::{Service, SizeRefusal, size_refusal};
use super::channel::Link;
use super::session::{Session, answered};
use super::status::call_fault;
use super::value::for_people;
use super::{OPENING, OpcUaDial, fault};
use crate::fieldbus::error::{CallerFault, Fault, PeerFault};
use crate::fieldbus::kinds::opcua::conversion::number_type;
use crate::fieldbus::kinds::opcua::fault::OpcUaFault;

/// Maximum number of attributes that are read in one call. The answer stays far below the largest permitted message.
const AT_ONCE: usize = 500;
/// Node classes to list, as bits: objects (1) and variables (2). Methods and types have no value to read.
const CLASSES: u32 = 1 | 2;
/// Result mask of a browse request: the server returns all fields of a reference.
const FIELDS: u32 = 63;
const VARIABLE: i32 = 2;
const SCALAR: i32 = -1;
/// Bit of the attribute UserAccessLevel that permits the user to read the value. `MAY_WRITE` is the bit that permits
/// writing.
const MAY_READ: u8 = 1;
const MAY_WRITE: u8 = 2;
/// Maximum number of characters of a displayed text; the rest is cut off.
const LONGEST: usize = 60;
/// Attributes that the browser reads of every node.
const ATTRIBUTES: [AttributeId; 5] = [
    AttributeId::NodeClass,
    AttributeId::DisplayName,
    AttributeId::DataType,
    AttributeId::ValueRank,
    AttributeId::UserAccessLevel,
];

/// Session with an OPC UA server for browsing.
pub struct Browser {
    dial: OpcUaDial,
    link: Link,
    session: Session,
    timeout: Duration,
    /// Maximum number of attributes that the server accepts in one read call.
    most: usize,
}

/// Node with the attributes that are displayed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Described {
    /// Node identifier, written as in a profile, for example `ns=2;i=5`.
    pub node: String,
    /// Depth of the node in the tree: number of levels below the first node.
    pub depth: usize,
    /// Display name of the node on the server.
    pub name: String,
    /// Value and type of a variable; `None` for other nodes.
    #[serde(flatten)]
    pub variable: Option<Value>,
    /// Status of the value, or of the attributes if these cannot be read.
    #[serde(serialize_with = "in_text")]
    pub status: Status,
}

/// Value and type of a variable.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Value {
    /// Name of the type in OPC UA, for example `Double`; empty if the type is unknown.
    pub kind: String,
    /// Type of the number, as a profile names it; `None` if the value is not a number.
    #[serde(rename = "type", serialize_with = "in_a_word")]
    pub data_type: Option<DataType>,
    /// Whether the variable is an array.
    pub is_array: bool,
    /// Whether the user of this session may read the variable.
    pub is_readable: bool,
    /// Whether the user of this session may write the variable.
    pub is_writable: bool,
    /// Value as text; `None` if the server sent no value.
    pub value: Option<String>,
}

/// Result of browsing: a node and its descendants.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tree {
    /// First node, followed by its descendants in depth-first order.
    pub nodes: Vec<Described>,
    /// Whether the list is incomplete, because the server has more nodes below the first node than the list contains.
    pub is_cut: bool,
    /// Namespace URIs of the nodes by index, except the namespace of OPC UA itself.
    pub namespaces: BTreeMap<u16, String>,
}

/// Node that was found while browsing, with its depth and the positions of its child nodes in the list.
struct FoundNode {
    id: NodeId,
    depth: usize,
    below: Vec<usize>,
}

fn in_text<S: Serializer>(status: &Status, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(status)
}

fn in_a_word<S: Serializer>(data_type: &Option<DataType>, serializer: S) -> Result<S::Ok, S::Error> {
    data_type.map(DataType::name).serialize(serializer)
}

impl Browser {
    /// Opens a session with the server, with the settings and the user of this bus in the profile.
    ///
    /// # Errors
    /// The reason why no session could be opened.
    pub async fn open(bus: &Bus) -> Result<Browser, Fault> {
        let opening = tokio::time::timeout(bus.timeout + OPENING, Browser::opened(bus));
        opening.await.unwrap_or(Err(Fault::Timeout))
    }

    async fn opened(bus: &Bus) -> Result<Browser, Fault> {
        let dial = OpcUaDial::new(bus).ok_or(Fault::Caller(CallerFault::Function))?;
        let (link, session, most) = connected(&dial).await?;
        Ok(Browser { dial, link, session, timeout: bus.timeout.max(Duration::from_secs(1)), most })
    }

    /// Replaces the connection, which the server has closed because a message was too long. The sizes of calls that the
    /// server has refused stay known.
    async fn reconnect(&mut self) -> Result<(), Fault> {
        let connecting = tokio::time::timeout(self.timeout + OPENING, connected(&self.dial));
        (self.link, self.session, self.most) = connecting.await.unwrap_or(Err(Fault::Timeout))?;
        Ok(())
    }

    /// Browses the nodes from `first` down to `depth` levels, and lists at most `most` of them. Nodes that OPC UA
    /// itself defines (for example `Server`) are listed, but their child nodes are only browsed if `first` is such a
    /// node.
    ///
    /// # Errors
    /// The node `first` does not exist, or the connection fails.
    pub async fn tree(&mut self, first: &codec::NodeId, depth: usize, most: usize) -> Result<Tree, Fault> {
        let namespaces = self.session.namespaces();
        let first = namespaces.node_id(first)?.ok_or(Fault::Status(Status::NO_SUCH_NODE))?;
        let known = self.described(std::slice::from_ref(&first)).await?;
        let unknown = known.iter().find(|node| node.variable.is_none() && !node.status.is_good());
        if let Some(Described { status, .. }) = unknown {
            return Err(Fault::Status(*status));
        }
        let mut seen = HashSet::from([first.clone()]);
        let mut places = vec![FoundNode { id: first, depth: 0, below: Vec::new() }];
        let (mut at, mut is_cut) = (0, false);
        while let Some(FoundNode { id, depth: so_deep, .. }) = places.get(at) {
            let (id, so_deep, room) = (id.clone(), *so_deep, most.saturating_sub(places.len()));
            if so_deep < depth && (at == 0 || id.namespace != 0) {
                let (found, is_more) = match self.below(&id, room).await {
                    Err(Fault::Status(_)) if at > 0 => (Vec::new(), false),
                    found => found?,
                };
                is_cut |= is_more;
                for id in found {
                    if seen.insert(id.clone()) {
                        let place = places.len();
                        places[at].below.push(place);
                        places.push(FoundNode { id, depth: so_deep + 1, below: Vec::new() });
                    }
                }
            }
            at += 1;
        }
        let (mut order, mut left) = (Vec::with_capacity(places.len()), vec![0]);
        while let Some(place) = left.pop() {
            order.push(&places[place]);
            left.extend(places[place].below.iter().rev());
        }
        let ids: Vec<NodeId> = order.iter().map(|place| place.id.clone()).collect();
        let depths = order.iter().map(|place| place.depth);
        let nodes = self.described(&ids).await?.into_iter().zip(depths);
        let used: BTreeSet<u16> = ids.iter().map(|id| id.namespace).filter(|index| *index != 0).collect();
        let uri = |index: u16| Some((index, namespaces.uri(index)?.to_owned()));
        Ok(Tree {
            nodes: nodes.map(|(node, depth)| Described { depth, ..node }).collect(),
            is_cut,
            namespaces: used.into_iter().filter_map(uri).collect(),
        })
    }

    /// Reads the attributes and the values of these nodes.
    ///
    /// # Errors
    /// The connection fails.
    pub async fn describe(&mut self, nodes: &[codec::NodeId]) -> Result<Vec<Described>, Fault> {
        let namespaces = self.session.namespaces();
        let ids: Result<Vec<Option<NodeId>>, Fault> =
            nodes.iter().map(|node| namespaces.node_id(node)).collect();
        let ids = ids?;
        let known: Vec<NodeId> = ids.iter().flatten().cloned().collect();
        let mut found = self.described(&known).await?.into_iter();
        let not_there = |node: &codec::NodeId| {
            let (node, name) = (node.to_string(), String::new());
            Described { node, depth: 0, name, variable: None, status: Status::NO_SUCH_NODE }
        };
        let each = nodes.iter().zip(&ids).map(|(node, id)| {
            let found = id.as_ref().and_then(|_| found.next());
            found.unwrap_or_else(|| not_there(node))
        });
        Ok(each.collect())
    }

    /// Closes the session, so that another client can use a session of the server.
    pub async fn close(mut self) {
        self.session.close(&mut self.link).await;
        self.link.close().await;
    }

    /// Returns at most `room` child nodes of a node. The `bool` is true if the server has more child nodes of this
    /// node.
    async fn below(&mut self, id: &NodeId, room: usize) -> Result<(Vec<NodeId>, bool), Fault> {
        let browse = BrowseDescription {
            node_id: id.clone(),
            browse_direction: BrowseDirection::Forward,
            reference_type_id: ReferenceTypeId::HierarchicalReferences.into(),
            include_subtypes: true,
            node_class_mask: CLASSES,
            result_mask: FIELDS,
        };
        let (channel, token) = (self.link.channel.clone(), self.session.token());
        // Without room, one reference is enough to show that there are more.
        let wanted = u32::try_from(room.max(1)).unwrap_or(u32::MAX);
        let request = Browse::new_manual(0, self.timeout, token.clone(), channel.request_handle())
            .max_references_per_node(wanted)
            .browse_node(browse);
        let answer = self.link.ask(request.send(&channel)).await.map_err(|error| call_fault(&error))?;
        let mut result = only(answer.results)?;
        let mut found = Vec::new();
        loop {
            found.extend(result.references.into_iter().flatten().filter_map(of_this_server));
            let point = result.continuation_point;
            let is_over = point.is_null_or_empty();
            if found.len() > room || (found.len() == room && !is_over) {
                self.release(point).await?;
                found.truncate(room);
                return Ok((found, true));
            }
            if is_over {
                return Ok((found, false));
            }
            let request = BrowseNext::new_manual(0, self.timeout, token.clone(), channel.request_handle())
                .continuation_point(point);
            let answer = self.link.ask(request.send(&channel)).await.map_err(|error| call_fault(&error))?;
            result = only(answer.results)?;
        }
    }

    /// Releases a continuation point. Without the release, the server would keep the state of an unfinished browse.
    async fn release(&mut self, point: ByteString) -> Result<(), Fault> {
        if point.is_null_or_empty() {
            return Ok(());
        }
        let channel = self.link.channel.clone();
        let request = BrowseNext::new_manual(0, self.timeout, self.session.token(), channel.request_handle())
            .continuation_point(point)
            .release_continuation_points(true);
        let released = self.link.ask(request.send(&channel)).await;
        released.map(|_| ()).map_err(|error: Error| call_fault(&error))
    }

    async fn described(&mut self, ids: &[NodeId]) -> Result<Vec<Described>, Fault> {
        let asked = ids.iter().flat_map(|id| ATTRIBUTES.map(|attribute| attribute_of(id, attribute)));
        let found = self.read(asked.collect()).await?;
        let mut nodes: Vec<Described> =
            ids.iter().zip(found.chunks(ATTRIBUTES.len())).map(|(id, found)| described(id, found)).collect();
        let has_value = |node: &Described| {
            node.variable.as_ref().is_some_and(|variable| variable.is_readable && !variable.is_array)
        };
        let asked = ids.iter().zip(&nodes).filter(|(_, node)| has_value(node));
        let asked = asked.map(|(id, _)| attribute_of(id, AttributeId::Value));
        let values = self.read(asked.collect()).await?;
        for (node, value) in nodes.iter_mut().filter(|node| has_value(node)).zip(values) {
            hold(node, value);
        }
        Ok(nodes)
    }

    /// Reads these attributes, in several calls if the server does not accept them in one call.
    async fn read(&mut self, asked: Vec<ReadValueId>) -> Result<Vec<DataValue>, Fault> {
        let mut found = Vec::with_capacity(asked.len());
        while let Some(rest) = asked.get(found.len()..).filter(|rest| !rest.is_empty()) {
            let count = self.session.sizes().next(Service::Read, rest.len().min(self.most));
            let channel = self.link.channel.clone();
            let read = Read::new_manual(0, self.timeout, self.session.token(), channel.request_handle())
                .timestamps_to_return(TimestampsToReturn::Neither)
                .max_age(0.0)
                .nodes_to_read(rest[..count].to_vec());
            match self.link.ask(read.send(&channel)).await {
                Ok(answer) => found.extend(answered(answer, count)?.0),
                Err(error) => match self.session.smaller(count, &error) {
                    Err(_) if count > 1 && size_refusal(&error) == Some(SizeRefusal::Closed) => {
                        self.reconnect().await?;
                    }
                    smaller => found.extend(smaller?),
                },
            }
        }
        Ok(found)
    }
}

/// Opens a session with the server. Returns it with its connection, and with the largest number of attributes in one
/// call.
async fn connected(dial: &OpcUaDial) -> Result<(Link, Session, usize), Fault> {
    let files = dial.files.as_ref().ok_or(fault(OpcUaFault::OurFiles))?;
    files.own_is_valid().map_err(fault)?;
    let (mut link, known) = dial.begin(files).await?;
    let limits = dial.prepare(&mut link, &known.session).await?;
    Ok((link, known.session, limits.read.min(AT_ONCE)))
}

fn only(results: Option<Vec<BrowseResult>>) -> Result<BrowseResult, Fault> {
    let result = results.unwrap_or_default().pop().ok_or(Fault::Peer(PeerFault::Length))?;
    match result.status_code {
        status if status.is_bad() => Err(Fault::Status(Status(status.bits()))),
        _ => Ok(result),
    }
}

fn of_this_server(reference: ReferenceDescription) -> Option<NodeId> {
    let id = reference.node_id;
    (id.server_index == 0 && id.namespace_uri.is_null()).then_some(id.node_id)
}

fn attribute_of(id: &NodeId, attribute: AttributeId) -> ReadValueId {
    ReadValueId { node_id: id.clone(), attribute_id: attribute as u32, ..Default::default() }
}

/// Builds the description of a node from its [`ATTRIBUTES`]. The value is not read yet.
fn described(id: &NodeId, found: &[DataValue]) -> Described {
    let value = |place: usize| found.get(place).and_then(|found| found.value.as_ref());
    let number = |place: usize| match value(place) {
        Some(Variant::Int32(number)) => Some(*number),
        Some(Variant::Byte(number)) => Some(i32::from(*number)),
        _ => None,
    };
    let status = found.first().and_then(|found| found.status).unwrap_or_default();
    let rights = number(4).and_then(|rights| u8::try_from(rights).ok());
    let kind = match value(2) {
        Some(Variant::NodeId(id)) => VariantScalarTypeId::try_from(id.as_ref()).ok(),
        _ => None,
    };
    let variable = (number(0) == Some(VARIABLE)).then(|| Value {
        kind: kind.map_or(String::new(), |kind| format!("{kind:?}")),
        data_type: kind.and_then(number_type),
        is_array: number(3).is_some_and(|rank| rank > SCALAR),
        // If the server does not report the access level, the value is read anyway.
        is_readable: rights.is_none_or(|rights| rights & MAY_READ != 0),
        is_writable: rights.is_some_and(|rights| rights & MAY_WRITE != 0),
        value: None,
    });
    let name = match value(1) {
        Some(Variant::LocalizedText(name)) => text(name.text.as_ref()),
        _ => String::new(),
    };
    Described { node: id.to_string(), depth: 0, name, variable, status: Status(status.bits()) }
}

/// Sets the value of a node, and the type of that value. This type is more reliable than the attribute DataType, which
/// may name a derived type.
fn hold(node: &mut Described, value: DataValue) {
    node.status = Status(value.status.unwrap_or_default().bits());
    let (Some(variable), Some(value)) = (&mut node.variable, value.value) else { return };
    if let Some(kind) = value.scalar_type_id() {
        variable.kind = format!("{kind:?}");
        variable.data_type = number_type(kind);
    }
    variable.is_array |= value.is_array();
    variable.value = (!value.is_array() && !value.is_empty()).then(|| text(&for_people(&value)));
}

fn text(text: &str) -> String {
    safe_file::cut(&one_line(text), LONGEST).into_owned()
}
