//! Words of an output set that are not values of outputs, such as heartbeat and version.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::kinds::opcua::nodes::{holds, written};
use crate::tables::KeyContext;
use crate::tables::register::{TypeWord, holding};
use isotherm_core::codec::Address;

/// Largest count of an output set's heartbeat.
pub(super) const HIGHEST_BEAT: u16 = 32767;
/// Largest value of a control word, with all bits set.
pub(super) const EVERY_BIT: u16 = 15;

/// Version number for a check by the control.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Version")]
pub(super) struct RawVersion {
    /// Holding register of the version number.
    register: Option<String>,
    /// Node of an OPC UA server, for example "ns=2;s=…".
    node: Option<String>,
    /// Type of the node.
    #[serde(rename = "type")]
    kind: Option<TypeWord>,
    /// Version number that is written.
    #[schemars(required)]
    value: Option<u16>,
}

impl RawVersion {
    pub(super) fn resolve(&self, at: &KeyContext<'_>, is_in_nodes: bool) -> Option<(Address, u16)> {
        if is_in_nodes {
            at.not_applicable(
                &["register"],
                "a Modbus device",
                "write node = \"ns=2;s=…\" instead of `register`",
            );
            let (node, number) = (written(at, self.node.as_ref(), self.kind)?, self.value?);
            holds(at, &node, number)?;
            return Some((Address::Node(node), number));
        }
        let help = "remove this key, and write register = \"holding:100\"";
        at.not_applicable(&["node", "type"], "an OPC UA server", help);
        let place = at.key("register");
        let help = "write a holding register, as \"holding:100\"";
        place.missing("`register` is missing: where is the version number written?", help);
        holding(&place, self.register.as_ref()).map(Address::from).zip(self.value)
    }
}

/// Reports keys that are not allowed for an output set in OPC UA nodes. In one write call, the server chooses the order
/// of the writes, so no word is reliably the last.
pub(super) fn foreign_to_nodes(at: &KeyContext<'_>) {
    for key in ["sequence", "complement"].into_iter().filter(|key| at.has(key)) {
        let message = format!(
            "`{key}` has no meaning over OPC UA: a server may write the nodes of a call in any order"
        );
        let help = "use a `handshake`: its strobe signal is set after the whole set was read back";
        at.key(key).wrong_key(message, help);
    }
    at.not_applicable(&["zeros"], "registers", "remove `zeros`: there are no unused registers between nodes");
}
