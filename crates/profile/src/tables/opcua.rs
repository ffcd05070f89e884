//! What is written of OPC UA at signals, outputs and devices: nodes, their types, and what their time stamps mean.

use schemars::JsonSchema;
use serde::Deserialize;

use super::At;
use super::register::TypeWord;
use isotherm_core::codec::{DataType, Node, NodeId};

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

/// The types that a node may have, as a profile names them.
pub(super) const TYPES: &str =
    "allowed: bool, u8, i8, u16, i16, u32, i32, u64, i64, f32, f64; a browser of the server shows which";

/// The node at the key `node`.
pub(super) fn id(at: &At<'_>, text: Option<&String>, what: &str) -> Option<NodeId> {
    let at = at.key("node");
    let help =
        "write the server's name for it, as \"ns=2;s=/Nck/State\" or \"ns=3;i=1005\"; a browser shows it";
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
    if kind.is_none() {
        let message = "`type` is missing: a server takes a value in the node's own type only";
        at.key("type").missing(message, TYPES);
    }
    let (id, data_type) = (id(at, text, "which node is written?"), node_type(at, kind));
    Some(Node { id: id?, data_type: Some(data_type.ok()??) })
}
