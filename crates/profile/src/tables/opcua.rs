//! What is written of OPC UA at signals, outputs, sets and devices: nodes, their types, and what their time stamps mean.

use schemars::JsonSchema;
use serde::Deserialize;

use super::At;
use super::register::{TypeWord, holding};
use isotherm_core::codec::{Address, DataType, Node, NodeId};

/// What the time says that a server stamps a value with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "SourceTimeWord", description = "")]
pub enum SourceTime {
    /// When it was measured: the reading is as old as that.
    #[default]
    Sampled,
    /// When it changed last, which says nothing of its age.
    Changed,
}

/// How the signals of a server come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "ReadWord", description = "")]
pub enum ReadBy {
    /// They are asked for.
    #[default]
    Poll,
    /// They are sent when they change.
    Subscription,
}

/// Where a word or a bit is that is no output's value: in a register, or in a node of an OPC UA server.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "WordPlace", description = "")]
pub(super) enum Place {
    Register(String),
    Node(RawNode),
}

/// A node of an OPC UA server.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
// The walk chooses among alternatives by the types that it sees: not a `$ref` to it.
#[schemars(rename = "NodePlace", inline)]
pub(super) struct RawNode {
    /// A node of an OPC UA server: "ns=2;s=…".
    #[schemars(required)]
    pub(super) node: Option<String>,
    /// The node's own type; required where it is written.
    #[serde(rename = "type")]
    pub(super) kind: Option<TypeWord>,
}

impl Place {
    /// The register or node of a word that is written and counts up to this.
    pub(super) fn word(&self, at: &At<'_>, is_in_nodes: bool, most: u16) -> Option<Address> {
        match (self, is_in_nodes) {
            (Place::Register(text), false) => holding(at, Some(text)).map(Address::Modbus),
            (Place::Node(raw), true) => Some(Address::Node(raw.word(at, most)?)),
            _ => self.is_foreign(at, is_in_nodes),
        }
    }

    /// It is on another kind of line.
    pub(super) fn is_foreign<T>(&self, at: &At<'_>, is_in_nodes: bool) -> Option<T> {
        match is_in_nodes {
            true => at.wrong(
                "a register is on Modbus, and this is an OPC UA server",
                "write { node = \"ns=2;s=…\" }, and its type",
            ),
            false => at.wrong("a node belongs to an OPC UA server", "write a register, as \"holding:100\""),
        }
        None
    }
}

impl RawNode {
    /// The node of a word that is written and counts up to this.
    pub(super) fn word(&self, at: &At<'_>, most: u16) -> Option<Node> {
        let node = written(at, self.node.as_ref(), self.kind)?;
        holds(at, &node, most)?;
        Some(node)
    }
}

/// A whole number up to this fits a node.
pub(super) fn holds(at: &At<'_>, node: &Node, most: u16) -> Option<()> {
    let name = node.taken_as().name();
    let message = match node.taken_as().integer_range() {
        Some((_, highest)) if highest >= i128::from(most) => return Some(()),
        Some(_) => format!("{name} does not hold {most}"),
        None => format!("{name} is no type for whole numbers"),
    };
    at.key("type")
        .wrong(message, "it must be the node's own: name another node, as of type u16, i16, u32 or i32");
    None
}

/// What a scale is the worth of: a node with a floating-point number has no counts.
pub(super) fn one_of(address: &Address) -> &'static str {
    match address.node().map(|node| node.taken_as().integer_range()) {
        Some(None) => "unit",
        _ => "count",
    }
}

/// The types that a node may have, as a profile names them.
pub(super) const TYPES: &str =
    "allowed: bool, u8, i8, u16, i16, u32, i32, u64, i64, f32, f64; a browser of the server shows which";

/// The node at the key `node`.
pub(super) fn id(at: &At<'_>, text: Option<&String>, what: &str) -> Option<NodeId> {
    let at = at.key("node");
    let help = "write the server's name for it, as \"ns=2;s=/Nck/State\" or \"nsu=http://plc.example;s=/Nck/State\"; `isotherm read --browse` shows it";
    let Some(text) = text else {
        at.missing(format!("`node` is missing: {what}"), help);
        return None;
    };
    text.parse().map_err(|why: String| at.wrong(why, help)).ok()
}

/// The type at the key `type`, as a node has it.
pub(super) fn node_type(at: &At<'_>, kind: Option<TypeWord>) -> Result<Option<DataType>, ()> {
    match kind {
        Some(TypeWord(DataType::Decimal24(_))) => {
            at.key("type").wrong("decimal24 is a type of Modbus displays", TYPES);
            Err(())
        }
        Some(TypeWord(data_type)) => Ok(Some(data_type)),
        None => Ok(None),
    }
}

/// The node of a signal: where it names no type, whatever number it has is taken.
pub(super) fn read(at: &At<'_>, text: Option<&String>, kind: Option<TypeWord>) -> Option<Node> {
    let (id, data_type) = (id(at, text, "which node is read?"), node_type(at, kind));
    Some(Node { id: id?, data_type: data_type.ok()? })
}

/// The node of an output, which is written in its own type.
pub(super) fn written(at: &At<'_>, text: Option<&String>, kind: Option<TypeWord>) -> Option<Node> {
    typed(at, text, kind, ("which node is written?", "a server takes a value in the node's own type only"))
}

/// The node of a check, which is read in its own type.
pub(super) fn compared(at: &At<'_>, text: Option<&String>, kind: Option<TypeWord>) -> Option<Node> {
    typed(at, text, kind, ("which node is read?", "it is compared in the node's own type"))
}

fn typed(
    at: &At<'_>,
    text: Option<&String>,
    kind: Option<TypeWord>,
    (which, why): (&str, &str),
) -> Option<Node> {
    if kind.is_none() {
        at.key("type").missing(format!("`type` is missing: {why}"), TYPES);
    }
    let (id, data_type) = (id(at, text, which), node_type(at, kind));
    Some(Node { id: id?, data_type: Some(data_type.ok()??) })
}
