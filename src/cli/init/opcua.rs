//! OPC UA servers in the answers.

use crate::discovery::bus::OPC_UA;
use isotherm_profile::host_and_port;

/// Returns host, port and path of the address of an OPC UA server, with any scheme of OPC UA. A host with the registered
/// port of OPC UA is a server too. `None` if the answer is another address.
pub(super) fn place(text: &str) -> Option<&str> {
    match text.split_once("://") {
        Some((scheme, place)) => scheme.to_ascii_lowercase().starts_with("opc").then_some(place),
        None => host_and_port(text).is_ok_and(|(_, port)| port == Some(OPC_UA)).then_some(text),
    }
}

/// Returns what to do with a server at `place`, if an answer must be the address of another line.
pub(super) fn other_line(place: &str) -> String {
    format!(
        "opc.tcp://{place} is an OPC UA server: `isotherm scan --bus opc.tcp://{place}` prints its lines of a profile, \
         and the chapter on OPC UA has an example. As an answer, write 192.168.0.10:502, or /dev/ttyUSB0"
    )
}
