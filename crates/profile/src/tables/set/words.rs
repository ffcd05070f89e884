//! The words of a set that are no output's value.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::tables::At;
use crate::tables::opcua::{holds, written};
use crate::tables::register::{TypeWord, holding};
use isotherm_core::codec::Address;

/// The heartbeat of a set goes so far.
pub(super) const HIGHEST_BEAT: u16 = 32767;
/// All that a control word says at once.
pub(super) const EVERY_BIT: u16 = 15;

/// A number that control and profile agree on.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Version")]
pub(super) struct RawVersion {
    /// A holding register.
    register: Option<String>,
    /// A node of an OPC UA server: "ns=2;s=…".
    node: Option<String>,
    /// The node's own type.
    #[serde(rename = "type")]
    kind: Option<TypeWord>,
    /// The number.
    #[schemars(required)]
    value: Option<u16>,
}

impl RawVersion {
    pub(super) fn resolve(&self, at: &At<'_>, is_in_nodes: bool) -> Option<(Address, u16)> {
        if is_in_nodes {
            at.foreign(&["register"], "a Modbus device", "remove it, and write node = \"ns=2;s=…\"");
            let (node, number) = (written(at, self.node.as_ref(), self.kind)?, self.value?);
            holds(at, &node, number)?;
            return Some((Address::Node(node), number));
        }
        at.foreign(&["node", "type"], "an OPC UA server", "remove it, and write register = \"holding:100\"");
        let place = at.key("register");
        if self.register.is_none() {
            place.missing(
                "`register` is missing: where is the number written?",
                "write a holding register, as \"holding:100\"",
            );
        }
        holding(&place, self.register.as_ref()).map(Address::from).zip(self.value)
    }
}

/// What nodes cannot have. The specification leaves it to a server in which order it carries out a call: nothing in it
/// comes last.
pub(super) fn foreign_to_nodes(at: &At<'_>) {
    for key in ["sequence", "complement"].into_iter().filter(|key| at.has(key)) {
        let message =
            format!("`{key}` says nothing over OPC UA: a server may write the nodes of a call in any order");
        let help = "take a `handshake`: its strobe rises after all of the set was read back";
        at.key(key).wrong_key(message, help);
    }
    at.foreign(&["zeros"], "registers", "remove it: between nodes there is nothing");
}
