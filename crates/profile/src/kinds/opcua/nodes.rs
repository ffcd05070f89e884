//! Keys of signals, outputs, sets and devices that are only for OPC UA: nodes, types, and the meaning of timestamps.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::schema_of::schema_of;
use crate::tables::KeyContext;
use crate::tables::register::{TypeWord, holding, is_of_registers};
use isotherm_core::codec::{Address, DataType, Element, Node, NodeId};

/// Meaning of the timestamps that a server sends with values: time of measurement, or time of the last change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "SourceTimeWord", description = "")]
pub enum SourceTime {
    /// Time of measurement, from which the gateway calculates the age of the reading.
    #[default]
    Sampled,
    /// Time of the last change, which does not affect the age of the reading.
    Changed,
}

/// How the signals of a server are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "ReadWord", description = "")]
pub enum ReadBy {
    /// The gateway requests the values in each poll period.
    #[default]
    Poll,
    /// The server sends the values when they change (OPC UA subscription).
    Subscription,
}

/// Address of a word or bit that is not the value of an output, for example of a strobe signal. It is a register, or a
/// node of an OPC UA server.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "WordPlace", description = "")]
pub(crate) enum Place {
    Register(String),
    Node(RawNode),
}

/// Element of an array, as the profile writes it: an index, or a list with one index for each dimension.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum ElementValue {
    Index(u32),
    Indices(Vec<u32>),
}

schema_of!(ElementValue as "Element": { "anyOf": [
    { "type": "integer", "minimum": 0, "maximum": 4_294_967_295u32 },
    {
        "type": "array",
        "items": { "type": "integer", "minimum": 0, "maximum": 4_294_967_295u32 },
        "minItems": 1,
    },
] });

impl ElementValue {
    fn resolve(&self, at: &KeyContext<'_>) -> Option<Element> {
        let indices = match self {
            ElementValue::Index(index) => vec![*index],
            ElementValue::Indices(indices) => indices.clone(),
        };
        let element = Element::new(indices);
        if element.is_none() {
            at.invalid(
                "an element has one to eight indices",
                "write 3, or [1, 2] for an array of two dimensions",
            );
        }
        element
    }
}

/// Node of an OPC UA server.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
// Inlined, because the schema check selects an alternative by its type, which a `$ref` hides.
#[schemars(rename = "NodePlace", inline)]
pub(crate) struct RawNode {
    /// Node of an OPC UA server, for example "ns=2;s=…".
    #[schemars(required)]
    pub(crate) node: Option<String>,
    /// Type of the node. Required for writing.
    #[serde(rename = "type")]
    pub(crate) kind: Option<TypeWord>,
}

impl Place {
    /// Resolves the register or node of a word that the gateway writes, such as a heartbeat or a control word. The type
    /// must be able to hold values up to `most`. `is_in_nodes` is true if the device is an OPC UA server.
    pub(crate) fn word(&self, at: &KeyContext<'_>, is_in_nodes: bool, most: u16) -> Option<Address> {
        match (self, is_in_nodes) {
            (Place::Register(text), false) => holding(at, Some(text)).map(Address::Modbus),
            (Place::Node(raw), true) => Some(Address::Node(raw.word(at, most)?)),
            _ => self.is_foreign(at, is_in_nodes),
        }
    }

    /// Reports an address of the wrong kind, and returns `None`. If `is_in_nodes` is true, the device is an OPC UA
    /// server and cannot have a register. Otherwise it cannot have a node.
    pub(crate) fn is_foreign<T>(&self, at: &KeyContext<'_>, is_in_nodes: bool) -> Option<T> {
        match is_in_nodes {
            true => at.reject(
                "registers are only for Modbus, but this device is an OPC UA server",
                "write { node = \"ns=2;s=…\" }, and its type",
            ),
            false => at.reject("a node is only for an OPC UA server", "write a register, as \"holding:100\""),
        }
    }
}

impl RawNode {
    /// Resolves the node of a word that the gateway writes, such as a heartbeat or a control word. The type must be
    /// able to hold values up to `most`.
    pub(crate) fn word(&self, at: &KeyContext<'_>, most: u16) -> Option<Node> {
        let node = written(at, self.node.as_ref(), self.kind)?;
        holds(at, &node, most)?;
        Some(node)
    }
}

/// Checks that the type of a node can hold integers up to `most`. Otherwise reports an error and returns `None`.
pub(crate) fn holds(at: &KeyContext<'_>, node: &Node, most: u16) -> Option<()> {
    let name = node.taken_as().name();
    let message = match node.taken_as().integer_range() {
        Some((_, highest)) if highest >= i128::from(most) => return Some(()),
        Some(_) => format!("{name} cannot contain {most}"),
        None => format!("{name} is not an integer type"),
    };
    let help = "`type` must be the node's type on the server: use a node with another type, for example u16, i16, \
                u32 or i32";
    at.key("type").reject(message, help)
}

/// Description, for messages, of the devices for which the key `node` is allowed.
pub(super) const OWNER: &str = "an OPC UA server";
/// Hint if the key `node` is written for another device.
pub(super) const ELSEWHERE: &str = "remove this key, or put the device on an opcua line";

/// Hint that lists the types of nodes, as a profile writes them.
pub(crate) const TYPES: &str =
    "allowed: bool, u8, i8, u16, i16, u32, i32, u64, i64, f32, f64; an OPC UA browser shows the node's type";

/// Parses the node identifier at the key `node`. If the key is missing, the error message ends with `what`, for example
/// "which node is read?".
pub(crate) fn id(at: &KeyContext<'_>, text: Option<&String>, what: &str) -> Option<NodeId> {
    let at = at.key("node");
    let help = "write the server's name of the node, as \"ns=2;s=/Nck/State\" or \
                \"nsu=http://plc.example;s=/Nck/State\"; `isotherm read --browse` shows it";
    at.missing(format!("`node` is missing: {what}"), help);
    text?.parse().map_err(|why: String| at.invalid(why, help)).ok()
}

/// Checks the type of a node at the key `type`. Returns `None` if the profile states no type, and `Err` if OPC UA nodes
/// cannot have the type, which is then reported.
pub(crate) fn node_type(at: &KeyContext<'_>, kind: Option<TypeWord>) -> Result<Option<DataType>, ()> {
    match kind {
        Some(TypeWord(DataType::Decimal24(_))) => {
            at.key("type").invalid("decimal24 is a type of Modbus displays", TYPES);
            Err(())
        }
        Some(TypeWord(data_type)) if data_type.width() == 24 || is_of_registers(data_type) => {
            at.key("type").invalid(format!("OPC UA has no type {}", data_type.name()), TYPES);
            Err(())
        }
        Some(TypeWord(data_type)) => Ok(Some(data_type)),
        None => Ok(None),
    }
}

/// Resolves the node of a signal. If the profile states no type, the gateway accepts any numeric type.
pub(crate) fn read(
    at: &KeyContext<'_>,
    text: Option<&String>,
    kind: Option<TypeWord>,
    element: Option<&ElementValue>,
) -> Option<Node> {
    let (id, data_type) = (id(at, text, "which node is read?"), node_type(at, kind));
    let element = match element {
        None => None,
        Some(element) => Some(element.resolve(&at.key("element"))?),
    };
    Some(Node { element, ..Node::new(id?, data_type.ok()?) })
}

/// Resolves the node of an output. The profile must state the type of the node, because the server accepts no other
/// type.
pub(crate) fn written(at: &KeyContext<'_>, text: Option<&String>, kind: Option<TypeWord>) -> Option<Node> {
    typed(at, text, kind, ("which node is written?", "a server accepts a value only in the node's own type"))
}

/// Resolves the node of a check (`verify`). The profile must state the type of the node, because the value is
/// compared in this type.
pub(crate) fn compared(at: &KeyContext<'_>, text: Option<&String>, kind: Option<TypeWord>) -> Option<Node> {
    typed(at, text, kind, ("which node is read?", "the value is compared in the node's own type"))
}

fn typed(
    at: &KeyContext<'_>,
    text: Option<&String>,
    kind: Option<TypeWord>,
    (which, why): (&str, &str),
) -> Option<Node> {
    at.key("type").missing(format!("`type` is missing: {why}"), TYPES);
    let (id, data_type) = (id(at, text, which), node_type(at, kind));
    Some(Node::new(id?, Some(data_type.ok()??)))
}

/// Reports an error if an output has the key `node`, but its device is not an OPC UA server.
pub(crate) fn not_here(at: &KeyContext<'_>) {
    at.not_applicable(&["node"], OWNER, ELSEWHERE);
}
