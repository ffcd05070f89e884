//! Nodes of the server: the tree in the address space of the library, their values, and the method `measured`.

use std::sync::Arc;

use ::opcua::nodes::{EventNotifier, MethodBuilder, ObjectBuilder, ReferenceDirection, VariableBuilder};
use ::opcua::server::CreateMonitoredItem;
use ::opcua::server::address_space::{AddressSpace, add_namespaces};
use ::opcua::server::diagnostics::NamespaceMetadata;
use ::opcua::server::node_manager::memory::{
    InMemoryNodeManager, InMemoryNodeManagerImpl, InMemoryNodeManagerImplBuilder,
};
use ::opcua::server::node_manager::{
    MethodCall, ParsedReadValueId, RequestContext, ServerContext, WriteNode,
};
use ::opcua::sync::RwLock;
use ::opcua::types::{
    Argument, DataTypeId, ExtensionObject, LocalizedText, NodeId, ObjectTypeId, QualifiedName,
    ReferenceTypeId, StatusCode, TimestampsToReturn, UAString, VariableTypeId,
};
use async_trait::async_trait;

use super::catalogue::Kind;
use super::convert::{data_type, subscribed};
use super::measured::Measured;
use super::tree::{Object, Role, Source, Tree, Variable, axis_id};
use super::units::engineering_unit;

/// Namespace of all nodes of the gateway. The namespace is the same for every machine, so that a client is configured
/// only once.
pub(super) const NAMESPACE: &str = "urn:isotherm:machine";
/// Name of the only method of the server, which accepts a measured error of an axis.
const MEASURED: &str = "measured";

/// Nodes of the gateway in the address space of the library.
pub(super) type Manager = InMemoryNodeManager<Nodes>;

/// Builder that inserts the nodes of the tree into the address space of the library.
pub(super) struct NodesBuilder {
    pub(super) tree: Arc<Tree>,
    /// Receiver of measured errors; `None` if no user may send them.
    pub(super) measured: Option<Measured>,
}

/// Behaviour of the nodes: all nodes are read only, and some axes have the method `measured`.
pub(super) struct Nodes {
    index: u16,
    /// Nodes of the methods, with the names of their axes.
    methods: Vec<(NodeId, String)>,
    measured: Option<Measured>,
}

impl InMemoryNodeManagerImplBuilder for NodesBuilder {
    type Impl = Nodes;

    fn build(self, context: ServerContext, space: &mut AddressSpace) -> Nodes {
        let index = add_namespaces(&context, space, &[NAMESPACE]).first().copied().unwrap_or_default();
        let NodesBuilder { tree, measured } = self;
        tree.objects.iter().for_each(|object| insert_object(space, index, object));
        tree.variables.iter().for_each(|variable| insert_variable(space, index, variable));
        let probed = tree.probed.iter().filter(|_| measured.is_some());
        let methods = probed.map(|axis| (insert_method(space, index, axis), axis.clone())).collect();
        Nodes { index, methods, measured }
    }
}

impl Nodes {
    /// Returns the index of the namespace of the nodes.
    pub(super) fn index(&self) -> u16 {
        self.index
    }
}

#[async_trait]
impl InMemoryNodeManagerImpl for Nodes {
    async fn init(&self, _space: &mut AddressSpace, _context: ServerContext) {}

    fn name(&self) -> &str {
        "isotherm"
    }

    fn namespaces(&self) -> Vec<NamespaceMetadata> {
        vec![NamespaceMetadata {
            namespace_uri: NAMESPACE.to_owned(),
            namespace_index: self.index,
            ..NamespaceMetadata::default()
        }]
    }

    async fn create_value_monitored_items(
        &self,
        context: &RequestContext,
        space: &RwLock<AddressSpace>,
        items: &mut [&mut &mut CreateMonitoredItem],
    ) {
        let nodes: Vec<&ParsedReadValueId> = items.iter().map(|item| item.item_to_monitor()).collect();
        let values = self.read_values(context, space, &nodes, 0.0, TimestampsToReturn::Both).await;
        for (value, item) in values.into_iter().zip(items.iter_mut()) {
            // A node without a value sends its first one later.
            if value.status != Some(StatusCode::BadAttributeIdInvalid) {
                item.set_initial_value(subscribed(value));
            }
            item.set_status(StatusCode::Good);
        }
    }

    async fn write(
        &self,
        _context: &RequestContext,
        _space: &RwLock<AddressSpace>,
        nodes: &mut [&mut WriteNode],
    ) -> Result<(), StatusCode> {
        nodes.iter_mut().for_each(|node| node.set_status(StatusCode::BadNotWritable));
        Ok(())
    }

    async fn call(
        &self,
        context: &RequestContext,
        _space: &RwLock<AddressSpace>,
        calls: &mut [&mut &mut MethodCall],
    ) -> Result<(), StatusCode> {
        for call in calls.iter_mut() {
            let axis = self.methods.iter().find(|(method, _)| method == call.method_id());
            let (Some((_, axis)), Some(measured)) = (axis, &self.measured) else {
                call.set_status(StatusCode::BadMethodInvalid);
                continue;
            };
            match measured.call(axis, call.arguments(), &context.token.0) {
                Ok(answer) => {
                    call.set_outputs(answer);
                    call.set_status(StatusCode::Good);
                }
                Err(status) => call.set_status(status),
            }
        }
        Ok(())
    }
}

/// Makes the OPC UA node identifier from the index of the namespace and the identifier in the tree.
pub(super) fn node(index: u16, id: &str) -> NodeId {
    NodeId::new(index, id)
}

fn insert_object(space: &mut AddressSpace, index: u16, object: &Object) {
    let id = node(index, &object.id);
    let name = QualifiedName::new(index, object.name.as_str());
    let builder = ObjectBuilder::new(&id, name, LocalizedText::from(object.label.as_str()));
    let builder = match (&object.parent, object.role) {
        (None, _) => builder.organized_by(NodeId::objects_folder_id()),
        (Some(parent), Role::Folder) => builder.organized_by(node(index, parent)),
        (Some(parent), Role::AddIn) => {
            builder.reference(node(index, parent), ReferenceTypeId::HasAddIn, ReferenceDirection::Inverse)
        }
        (Some(parent), _) => builder.component_of(node(index, parent)),
    };
    let builder = match object.role {
        Role::Folder | Role::AddIn => builder.is_folder(),
        Role::Object => builder.has_type_definition(ObjectTypeId::BaseObjectType),
        Role::EventSource => builder
            .has_type_definition(ObjectTypeId::BaseObjectType)
            .event_notifier(EventNotifier::SUBSCRIBE_TO_EVENTS),
    };
    builder.insert(space);
}

fn insert_variable(space: &mut AddressSpace, index: u16, variable: &Variable) {
    let id = node(index, &variable.id);
    let name = QualifiedName::new(index, variable.name);
    let (parent, unit) = (node(index, &variable.parent), engineering_unit(&variable.unit));
    let rank = if variable.kind == Kind::Texts { 1 } else { -1 };
    let builder = VariableBuilder::new(&id, name, LocalizedText::from(variable.name))
        // The table of the manual escapes this character.
        .description(LocalizedText::from(variable.about.replace("\\|", "|")))
        .data_type(data_type(variable.kind))
        .value_rank(rank);
    let builder = match (&variable.source, &unit) {
        (Source::Nameplate(_), _) => {
            builder.property_of(parent).has_type_definition(VariableTypeId::PropertyType)
        }
        (_, Some(_)) => builder.component_of(parent).has_type_definition(VariableTypeId::AnalogUnitType),
        (_, None) => builder.component_of(parent).has_type_definition(VariableTypeId::BaseDataVariableType),
    };
    builder.insert(space);
    if let Some(unit) = unit {
        let property = node(index, &format!("{}.EngineeringUnits", variable.id));
        VariableBuilder::new(&property, "EngineeringUnits", "EngineeringUnits")
            .property_of(id)
            .has_type_definition(VariableTypeId::PropertyType)
            .data_type(DataTypeId::EUInformation)
            .value(ExtensionObject::from_message(unit))
            .insert(space);
    }
}

fn insert_method(space: &mut AddressSpace, index: u16, axis: &str) -> NodeId {
    let of = format!("{}.{MEASURED}", axis_id(axis));
    let id = node(index, &of);
    let inputs = [
        argument("error_um", DataTypeId::Double, "Actual minus commanded position of the axis, in µm."),
        argument("time", DataTypeId::String, "Time of the measurement, RFC 3339. May be empty."),
        argument("id", DataTypeId::String, "Identifier of the measurement. May be empty."),
    ];
    let outputs = [
        argument("done", DataTypeId::Boolean, "Whether the error is used for the correction."),
        argument("answer", DataTypeId::String, "Sentence with the result, or with the reason."),
    ];
    let about = "Sends a measured error of the axis, which corrects its models.";
    MethodBuilder::new(&id, QualifiedName::new(index, MEASURED), LocalizedText::from(MEASURED))
        .description(LocalizedText::from(about))
        .component_of(node(index, &axis_id(axis)))
        .executable(true)
        .user_executable(true)
        .input_args(space, &node(index, &format!("{of}.InputArguments")), &inputs)
        .output_args(space, &node(index, &format!("{of}.OutputArguments")), &outputs)
        .insert(space);
    id
}

fn argument(name: &str, kind: DataTypeId, about: &str) -> Argument {
    Argument {
        name: UAString::from(name),
        data_type: NodeId::from(kind),
        value_rank: -1,
        array_dimensions: None,
        description: LocalizedText::from(about),
    }
}
