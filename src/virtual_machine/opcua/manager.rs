//! Address space of the OPC UA library: a variable for each node that the profile names.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use ::opcua::nodes::VariableBuilder;
use ::opcua::server::CreateMonitoredItem;
use ::opcua::server::address_space::{AddressSpace, add_namespaces};
use ::opcua::server::diagnostics::NamespaceMetadata;
use ::opcua::server::node_manager::memory::{InMemoryNodeManagerImpl, InMemoryNodeManagerImplBuilder};
use ::opcua::server::node_manager::{
    MonitoredItemRef, MonitoredItemUpdateRef, ParsedReadValueId, RequestContext, ServerContext, SyncSampler,
    WriteNode,
};
use ::opcua::sync::RwLock;
use ::opcua::types::{
    AttributeId, DataTypeId, DataValue, LocalizedText, MonitoringMode, NodeId, NumericRange, QualifiedName,
    StatusCode, TimestampsToReturn, VariableTypeId, Variant,
};
use async_trait::async_trait;

use super::line::NodeLine;
use super::nodes::{Access, ServerNode};
use crate::fieldbus::kinds::opcua::conversion::{node_id, scalar, variant};
use isotherm_core::codec::Scalar;

/// Interval at which nodes with a subscription are checked for the time of their next sample.
const SAMPLED_EVERY: Duration = Duration::from_millis(100);

/// Builder with which the library creates the nodes of a server.
pub(super) struct NodesBuilder {
    pub(super) line: Arc<NodeLine>,
}

/// Nodes of a server. The virtual hardware executes each read, sample and write.
pub(super) struct Nodes {
    line: Arc<NodeLine>,
    /// Index of each node in the node list of the server.
    places: HashMap<NodeId, usize>,
    namespaces: Vec<NamespaceMetadata>,
    sampler: SyncSampler,
}

impl InMemoryNodeManagerImplBuilder for NodesBuilder {
    type Impl = Nodes;

    fn build(self, context: ServerContext, space: &mut AddressSpace) -> Nodes {
        let server = &self.line.server;
        let uris: Vec<&str> = server.namespaces.iter().map(String::as_str).collect();
        let indices = add_namespaces(&context, space, &uris);
        let namespace = |(uri, index): (&&str, &u16)| NamespaceMetadata {
            namespace_uri: (*uri).to_owned(),
            namespace_index: *index,
            ..NamespaceMetadata::default()
        };
        let namespaces = uris.iter().zip(&indices).map(namespace).collect();
        let mut places = HashMap::new();
        for (place, node) in server.nodes.iter().enumerate() {
            let index = server.index(&node.id.namespace);
            let Some(id) = index.and_then(|index| node_id(index, &node.id.identifier)) else { continue };
            insert(space, &id, node);
            places.insert(id, place);
        }
        Nodes { line: self.line.clone(), places, namespaces, sampler: SyncSampler::new() }
    }
}

fn insert(space: &mut AddressSpace, id: &NodeId, node: &ServerNode) {
    let name = node.name();
    let zero = variant(Scalar { data_type: node.data_type(), bits: 0 });
    let data_type = zero.and_then(|zero| zero.data_type()).map(|data_type| data_type.node_id);
    let rank = node.dimensions().map_or(-1, |lengths| i32::try_from(lengths.len()).unwrap_or(1));
    let builder = VariableBuilder::new(
        id,
        QualifiedName::new(id.namespace, name.as_str()),
        LocalizedText::from(name.as_str()),
    )
    .organized_by(NodeId::objects_folder_id())
    .has_type_definition(VariableTypeId::BaseDataVariableType)
    .data_type(data_type.unwrap_or_else(|| NodeId::from(DataTypeId::Double)))
    .value_rank(rank);
    match node.access {
        Access::Read => builder.insert(space),
        Access::Write => builder.writable().insert(space),
    };
}

impl Nodes {
    /// Reads nodes in one call. For an array, all elements are read.
    async fn read_whole(&self, nodes: &[&ParsedReadValueId]) -> Vec<DataValue> {
        let place = |node: &&ParsedReadValueId| self.places.get(&node.node_id).copied();
        let places: Vec<Option<usize>> = nodes.iter().map(place).collect();
        let (values, fault) = self.line.read(&places);
        self.line.obey(fault).await;
        values
    }
}

/// Returns those elements of an array value that a client requests by an index range. A value with a bad status is
/// returned unchanged.
pub(super) fn part(mut value: DataValue, range: &NumericRange) -> DataValue {
    let is_good = value.status.is_none_or(|status| status.is_good());
    let Some(whole) = value.value.as_ref().filter(|_| is_good && *range != NumericRange::None) else {
        return value;
    };
    match whole.range_of(range) {
        Ok(part) => value.value = Some(part),
        Err(status) => (value.value, value.status) = (Some(Variant::Empty), Some(status)),
    }
    value
}

#[async_trait]
impl InMemoryNodeManagerImpl for Nodes {
    async fn init(&self, _space: &mut AddressSpace, context: ServerContext) {
        self.sampler.run(SAMPLED_EVERY, context.subscriptions.clone());
    }

    fn name(&self) -> &str {
        "virtual"
    }

    fn namespaces(&self) -> Vec<NamespaceMetadata> {
        self.namespaces.clone()
    }

    async fn read_values(
        &self,
        _context: &RequestContext,
        _space: &RwLock<AddressSpace>,
        nodes: &[&ParsedReadValueId],
        _max_age: f64,
        _timestamps: TimestampsToReturn,
    ) -> Vec<DataValue> {
        let values = self.read_whole(nodes).await;
        values.into_iter().zip(nodes).map(|(value, node)| part(value, &node.index_range)).collect()
    }

    async fn write(
        &self,
        _context: &RequestContext,
        _space: &RwLock<AddressSpace>,
        nodes: &mut [&mut WriteNode],
    ) -> Result<(), StatusCode> {
        let mut values = Vec::with_capacity(nodes.len());
        for node in nodes.iter() {
            let wanted = node.value();
            let is_value = wanted.attribute_id == AttributeId::Value;
            let place = self.places.get(&wanted.node_id).copied().filter(|_| is_value);
            values.push((place, wanted.value.value.as_ref().and_then(scalar)));
        }
        let (statuses, fault) = self.line.write(&values);
        self.line.obey(fault).await;
        for (node, status) in nodes.iter_mut().zip(statuses) {
            node.set_status(StatusCode::from(status.0));
        }
        Ok(())
    }

    async fn create_value_monitored_items(
        &self,
        _context: &RequestContext,
        _space: &RwLock<AddressSpace>,
        items: &mut [&mut &mut CreateMonitoredItem],
    ) {
        let nodes: Vec<&ParsedReadValueId> = items.iter().map(|item| item.item_to_monitor()).collect();
        // The library takes the range out of each value itself.
        let values = self.read_whole(&nodes).await;
        for (value, item) in values.into_iter().zip(items.iter_mut()) {
            let id = item.item_to_monitor().node_id.clone();
            let Some(place) = self.places.get(&id).copied() else {
                item.set_status(StatusCode::BadNodeIdUnknown);
                continue;
            };
            item.set_initial_value(value);
            item.set_status(StatusCode::Good);
            let line = self.line.clone();
            let every = milliseconds(item.sampling_interval());
            let (mode, handle) = (item.monitoring_mode(), item.handle());
            let sample = move || line.sample(place);
            self.sampler.add_sampler(id, AttributeId::Value, sample, mode, handle, every);
        }
    }

    async fn modify_monitored_items(&self, _context: &RequestContext, items: &[&MonitoredItemUpdateRef]) {
        for item in items {
            let every = milliseconds(item.update().revised_sampling_interval);
            self.sampler.update_sampler(item.node_id(), item.attribute(), item.handle(), every);
        }
    }

    async fn set_monitoring_mode(
        &self,
        _context: &RequestContext,
        mode: MonitoringMode,
        items: &[&MonitoredItemRef],
    ) {
        for item in items {
            self.sampler.set_sampler_mode(item.node_id(), item.attribute(), item.handle(), mode);
        }
    }

    async fn delete_monitored_items(&self, _context: &RequestContext, items: &[&MonitoredItemRef]) {
        for item in items {
            self.sampler.remove_sampler(item.node_id(), item.attribute(), item.handle());
        }
    }
}

fn milliseconds(interval: f64) -> Duration {
    Duration::try_from_secs_f64(interval / 1000.0).unwrap_or_default()
}
