//! Parsing of answers about OPC UA servers and their nodes.

use crate::discovery::bus::OPC_UA;
use isotherm_core::codec::{Element, NodeId};
use isotherm_profile::{host_and_port, server_url};

const NOT_BUILT_IN: &str = "this program was built without OPC UA: use a packaged program, or build one with `cargo build \
                            --release --features opcua`";

const NOT_A_SERVER: &str = "the destination of Cz is a node of an OPC UA server: write the address of the server, such as \
                            opc.tcp://192.168.0.20:4840";

/// Note that is printed after a profile without OPC UA security was written.
pub(super) const UNSECURED: &str =
    "A line over OPC UA has security = \"none\": the profile shows how to secure the line.";

/// Returns host, port and path if the answer is the address of an OPC UA server. Such an address begins with a scheme
/// of OPC UA, or has the registered port of OPC UA. Returns `None` for any other address.
pub(super) fn place(text: &str) -> Option<&str> {
    match text.split_once("://") {
        Some((scheme, place)) => scheme.to_ascii_lowercase().starts_with("opc").then_some(place),
        None => host_and_port(text).is_ok_and(|(_, port)| port == Some(OPC_UA)).then_some(text),
    }
}

/// Returns the error message for the address of an OPC UA server, if the destination of Cz is a register.
pub(super) fn has_no_registers(place: &str) -> String {
    if !cfg!(feature = "opcua") {
        return NOT_BUILT_IN.to_owned();
    }
    format!(
        "opc.tcp://{place} is an OPC UA server, which has no registers: begin again, and write a node such as \
         ns=2;s=Offset.Z as the destination of Cz"
    )
}

/// Parses the address of the control's server, and returns its URL.
pub(super) fn server(text: &str) -> Result<String, String> {
    url(text).unwrap_or_else(|| Err(NOT_A_SERVER.to_owned()))
}

/// Parses the address of a server, and returns its URL. `None` if the answer is another address.
pub(super) fn url(text: &str) -> Option<Result<String, String>> {
    let place = place(text)?;
    if !cfg!(feature = "opcua") {
        return Some(Err(NOT_BUILT_IN.to_owned()));
    }
    let is_binary =
        |scheme: &str| ["opc.tcp", "opcua"].iter().any(|known| scheme.eq_ignore_ascii_case(known));
    let url = match text.split_once("://") {
        Some((scheme, _)) if !is_binary(scheme) => text.to_owned(),
        _ => format!("opc.tcp://{place}"),
    };
    Some(server_url(&url).map_err(|(why, help)| format!("{why}; {help}")))
}

/// Returns whether an answer is meant as a node: it contains `=`, which registers and names of templates never contain.
pub(super) fn is_node(text: &str) -> bool {
    text.contains('=')
}

/// Parses the identifier of a node, for example `ns=2;s=Temps`. Without the feature `opcua`, every answer is an error.
pub(super) fn node(text: &str) -> Result<NodeId, String> {
    if cfg!(feature = "opcua") { text.parse() } else { Err(NOT_BUILT_IN.to_owned()) }
}

/// Parses an element of an array; `None` for the answer `none`.
pub(super) fn element(text: &str) -> Result<Option<Element>, String> {
    if text == "none" {
        return Ok(None);
    }
    let indices: Option<Vec<u32>> = text.split(',').map(|index| index.trim().parse().ok()).collect();
    let help = "write an index from 0, such as 2, or 1,2 for an array of two dimensions, or none";
    indices.and_then(Element::new).map(Some).ok_or_else(|| help.to_owned())
}
